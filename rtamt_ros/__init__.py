"""Robustness monitors as nodes of ROS 1 and ROS 2.

What a node does is in `rtamt_ros.core` and `rtamt_ros.node`, which know no ROS; `rtamt_ros.ros1`
and `rtamt_ros.ros2` run it on rospy and rclpy. Nothing here imports ROS before a node is made.
"""

import rtamt_gym  # noqa: F401 - refuses the released library over this one
