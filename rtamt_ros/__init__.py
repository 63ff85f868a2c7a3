"""Robustness monitors as nodes of ROS 1 and ROS 2.

`rtamt_ros.core` and `rtamt_ros.node` are independent of ROS; `rtamt_ros.ros1` and `rtamt_ros.ros2`
run them on rospy and rclpy. ROS is imported when a node is created.
"""

import rtamt_gym  # noqa: F401 - raises an error if the released library hides this one
