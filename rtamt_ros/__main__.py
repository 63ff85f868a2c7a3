"""``python -m rtamt_ros`` is ``ros_stl_monitor.py``."""

import sys

from rtamt_ros.process import run_module


def main() -> int:
    """Runs the command; returns the exit code."""
    return run_module("rtamt_ros.command")


if __name__ == "__main__":
    sys.exit(main())
