#!/usr/bin/env python3
"""Monitors the topics that specifications name: what ``roslaunch`` starts on ROS 1."""

import sys

from rtamt_ros.command import main

sys.exit(main())
