"""The monitors of a node, independent of ROS."""
