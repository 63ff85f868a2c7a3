"""Puts the programs of rtamt_ros where ``ros2 run`` and ``ros2 launch`` find them.

The Python package itself comes with rtamt, which pip installs: a second copy would hide it. The
folder ``ros1`` is not installed: ROS 1 finds it where it is, through ``ROS_PACKAGE_PATH``.

To add a file that colcon installs, list it here. ``tests/rtamt_ros/test_colcon_packages.py``
compares the list with the files that are there.
"""

from setuptools import setup

setup(
    name="rtamt_ros",
    version="0.5.0",
    packages=[],
    scripts=["scripts/stl_monitor", "scripts/simulator", "scripts/screen"],
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/rtamt_ros"]),
        ("share/rtamt_ros", ["package.xml"]),
        (
            "share/rtamt_ros/config",
            ["config/aggregator.yaml", "config/follows.stl", "config/stl_monitor.yaml"],
        ),
        ("share/rtamt_ros/launch", ["launch/stl_monitor.launch.py"]),
        ("share/rtamt_ros/layouts", ["layouts/foxglove.json", "layouts/plotjuggler.xml"]),
        (
            "share/rtamt_ros/systemd",
            ["systemd/follows.env", "systemd/rtamt-monitor@.service"],
        ),
    ],
)
