"""``python -m rtamt_ros`` is ``ros_stl_monitor.py``."""

import sys

from rtamt_ros.command import main

if __name__ == "__main__":
    sys.exit(main())
