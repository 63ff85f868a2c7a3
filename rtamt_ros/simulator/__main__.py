"""``python -m rtamt_ros.simulator``: a robot and its controller as nodes."""

import sys

from rtamt_ros.process import run_module


def main() -> int:
    """Runs the robot, the controller or both; returns the exit code."""
    return run_module("rtamt_ros.simulator.command")


if __name__ == "__main__":
    sys.exit(main())
