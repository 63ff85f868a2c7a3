"""``python -m rtamt_ros`` is ``ros_stl_monitor.py``."""

import signal
import sys


def main() -> int:
    """Runs the command; Ctrl-C ends it quietly, also while its modules are loaded."""
    # Modules in C make other errors of an interrupt while they are loaded.
    handler = signal.signal(signal.SIGINT, signal.SIG_DFL)
    from rtamt_ros import command

    signal.signal(signal.SIGINT, handler)
    try:
        return command.main()
    except KeyboardInterrupt:  # before the node spins
        return 130


if __name__ == "__main__":
    sys.exit(main())
