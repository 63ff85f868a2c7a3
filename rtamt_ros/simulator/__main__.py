"""``python -m rtamt_ros.simulator``: simulated robots and their controllers as nodes."""

import sys

from rtamt_ros.process import run_module


def main() -> int:
    """Run the command; return the exit code."""
    return run_module("rtamt_ros.simulator.robots")


if __name__ == "__main__":
    sys.exit(main())
