"""``python -m rtamt_ros`` runs ``ros_stl_monitor.py``."""

import sys

from rtamt_ros.process import run_module


def main() -> int:
    """Run the command; return the exit code."""
    return run_module("rtamt_ros.command")


if __name__ == "__main__":
    sys.exit(main())
