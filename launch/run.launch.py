"""Start a run: trajectory, plant, controller, and a recorder and a monitor if asked."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    'scenario': ('paper_circle', 'a file of config/scenarios'),
    'law': ('s_fotsmc', 'a file of config/laws'),
    'time_mode': ('wall', 'wall or lockstep'),
    'namespace': ('', 'of the nodes, so that several robots share a domain'),
    'record': ('false', 'true: write a bag'),
    'monitor': ('false', 'true: publish figures of merit'),
}


def generate_launch_description() -> LaunchDescription:
    """Describe the nodes of one run; `--show-args` lists the arguments."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    parameters = {name: LaunchConfiguration(name) for name in ('scenario', 'law', 'time_mode')}
    optional = {'recorder': 'record', 'monitor': 'monitor'}
    nodes = [
        Node(
            package='parallel_robot',
            executable=executable,
            namespace=LaunchConfiguration('namespace'),
            parameters=[parameters],
            output='screen',
            condition=IfCondition(LaunchConfiguration(optional[executable]))
            if executable in optional
            else None,
        )
        for executable in ('recorder', 'monitor', 'plant', 'controller', 'trajectory')
    ]
    return LaunchDescription([*arguments, *nodes])
