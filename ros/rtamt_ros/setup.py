"""Installs the programs of rtamt_ros for ``ros2 run`` and ``ros2 launch``.

pip installs the Python package itself; a second copy would hide it. ROS 1 finds the folder ``ros1``
through ``ROS_PACKAGE_PATH``, so it is not installed.

To add a file that colcon installs, list it here. ``tests/rtamt_ros/test_colcon_packages.py``
compares the list with the files of the folder.
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
