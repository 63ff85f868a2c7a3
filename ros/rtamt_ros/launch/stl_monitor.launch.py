"""Starts a monitor: ``ros2 launch rtamt_ros stl_monitor.launch.py spec_file:=/PATH/spec.stl``.

Without a specification it monitors the robot of ``ros2 run rtamt_ros simulator``.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue


def generate_launch_description() -> LaunchDescription:
    """Return the node; arguments override the parameters of the file."""
    config = Path(get_package_share_directory("rtamt_ros"), "config")
    follows, parameters = str(config / "follows.stl"), str(config / "stl_monitor.yaml")
    return LaunchDescription(
        [
            DeclareLaunchArgument("spec_file", default_value=follows),
            DeclareLaunchArgument("parameters", default_value=parameters),
            DeclareLaunchArgument("combined", default_value=""),
            DeclareLaunchArgument("use_sim_time", default_value="false"),
            Node(
                package="rtamt_ros",
                executable="stl_monitor",
                name="stl_monitor",
                output="screen",
                parameters=[
                    LaunchConfiguration("parameters"),
                    {
                        "spec_file": ParameterValue(
                            LaunchConfiguration("spec_file"), value_type=str
                        ),
                        "combined": ParameterValue(LaunchConfiguration("combined"), value_type=str),
                        "use_sim_time": ParameterValue(
                            LaunchConfiguration("use_sim_time"), value_type=bool
                        ),
                    },
                ],
            ),
        ]
    )
