"""``python -m rtamt_ros`` is ``ros_stl_monitor.py``."""

import sys


def main() -> int:
    """Runs the command; Ctrl-C ends it quietly, also while its modules are loaded."""
    try:
        from rtamt_ros import command

        return command.main()
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
