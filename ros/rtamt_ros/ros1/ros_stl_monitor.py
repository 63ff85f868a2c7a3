#!/usr/bin/env python3
"""Monitors the topics that specifications name; ``roslaunch`` of ROS 1 starts this program."""

import sys

from rtamt_ros.command import main

sys.exit(main())
