"""Start what moves a real robot: trajectory and controller; recorder, monitor, page if asked."""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription

HERE = Path(__file__).parent
STRICT = HERE.parent / 'config' / 'hardware' / 'strict.yaml'


def generate_launch_description() -> LaunchDescription:
    """Describe a run without a plant; `--show-args` lists the arguments."""
    limits = DeclareLaunchArgument(
        'limits',
        default_value=str(STRICT),
        description='time-outs of a machine, and a controller that begins in emergency stop',
    )
    run = IncludeLaunchDescription(
        str(HERE / 'run.launch.py'), launch_arguments=[('plant', 'false')]
    )
    return LaunchDescription([limits, run])
