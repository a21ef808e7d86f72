"""Start a run: trajectory, plant, controller, and a recorder if asked."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    'scenario': ('paper_circle', 'a file of config/scenarios'),
    'law': ('s_fotsmc', 'a file of config/laws'),
    'time_mode': ('wall', 'wall or lockstep'),
    'record': ('false', 'true: write a bag'),
}


def generate_launch_description() -> LaunchDescription:
    """Describe the nodes of one run; `--show-args` lists the arguments."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    parameters = {name: LaunchConfiguration(name) for name in ('scenario', 'law', 'time_mode')}
    record = LaunchConfiguration('record')
    nodes = [
        Node(
            package='parallel_robot',
            executable=executable,
            parameters=[parameters],
            output='screen',
            condition=IfCondition(record) if executable == 'recorder' else None,
        )
        for executable in ('recorder', 'plant', 'controller', 'trajectory')
    ]
    return LaunchDescription([*arguments, *nodes])
