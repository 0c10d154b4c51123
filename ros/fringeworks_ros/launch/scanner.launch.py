"""Start the scanner with the parameters of a file: ``params:=scanner.yaml``."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare


def generate_launch_description() -> LaunchDescription:
    """One node."""
    usual = PathJoinSubstitution([FindPackageShare("fringeworks_ros"), "config", "scanner.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("params", default_value=usual),
            Node(
                package="fringeworks_ros",
                executable="scanner",
                name="scanner",
                parameters=[LaunchConfiguration("params")],
            ),
        ]
    )
