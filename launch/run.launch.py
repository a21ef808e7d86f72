"""Start a run: trajectory, plant, controller, and a recorder and a monitor if asked."""

import os
import sys
import time
from pathlib import Path

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, TextSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from parallel_robot_model.configuration import config_files

PARAMETERS = {  # of all nodes, where they are given
    'scenario': ('one of config/scenarios or a YAML file, else paper_circle', str),
    'law': ('a file of config/laws, else that of the scenario', str),
    'period': ('s, one sample, or auto: as joint_states come; else 0.001', float),
    'joints': ('their names in a list: [joint1, joint2, joint3]', list[str]),
    'time_mode': ('wall or lockstep, else wall', str),
    'end_with_parent': ('true: the nodes end when this launch is killed, else false', bool),
    'use_sim_time': ('true: take the time from /clock, else false', bool),
}
OTHERS = {
    'plant': ('true', 'false: none, for a robot that is there (hardware.launch.py)'),
    'limits': ('', 'parameters of the nodes, as config/hardware/strict.yaml'),
    'params_file': ('', 'parameters of the nodes; they win over limits, the arguments over both'),
    'namespace': ('', 'of the nodes, so that several robots share a domain'),
    'record': ('false', 'true: write a bag'),
    'out': (
        '',
        'the bag, which is then written anyway; else ROS_HOME/parallel_robot/<run>_<date>',
    ),
    'monitor': ('false', 'true: publish metrics'),
    'live': ('false', 'true: serve the page of the robot, and print its address'),
}
AUTO = 'auto'
# The controller manager takes its own description from the topic of this name.
BESIDE_ROS2_CONTROL = [('robot_description', 'monitor/robot_description')]


def nodes(context: LaunchContext) -> list[Node]:
    """Make the nodes, with the parameters that the arguments give them."""
    given = {name: LaunchConfiguration(name).perform(context) for name in (*PARAMETERS, *OTHERS)}
    given['scenario'] = config_files.absolute_scenario(given['scenario'])
    parameters = {
        name: ParameterValue(
            TextSubstitution(text=given[name]), value_type=str if given[name] == AUTO else kind
        )
        for name, (_, kind) in PARAMETERS.items()
        if given[name]
    }
    out = {'recorder.out': ParameterValue(given['out'] or default_bag(given), value_type=str)}
    sources = [parameters | out] if given['out'] else [out, parameters]  # later ones win
    for name in ('limits', 'params_file'):
        if given[name]:
            if not Path(given[name]).is_file():
                raise RuntimeError(f'{name}: {given[name]} is not a file')
            sources.insert(-1, given[name])
    simulated = IfCondition(LaunchConfiguration('plant'))
    optional = {
        'recorder': None if given['out'] else IfCondition(LaunchConfiguration('record')),
        'monitor': IfCondition(LaunchConfiguration('monitor')),
        'plant': simulated,
    }
    return [
        Node(
            package='parallel_robot',
            executable=executable,
            namespace=LaunchConfiguration('namespace'),
            parameters=sources,
            remappings=[] if simulated.evaluate(context) else BESIDE_ROS2_CONTROL,
            output='screen',
            condition=optional.get(executable),
        )
        for executable in ('recorder', 'monitor', 'plant', 'controller', 'trajectory')
    ]


def page(context: LaunchContext) -> list[ExecuteProcess]:
    """Make the process that serves the page, where it is wanted; this machine alone sees it."""
    namespace = '/' + LaunchConfiguration('namespace').perform(context).strip('/')
    command = [sys.executable, '-m', 'parallel_robot', 'live', '--namespace', namespace]
    condition = IfCondition(LaunchConfiguration('live'))
    return [ExecuteProcess(cmd=command, output='screen', condition=condition)]


def default_bag(given: dict[str, str]) -> str:
    """Place of a bag that was given none: beside the logs of ROS, not wherever one stands."""
    home = Path(os.environ.get('ROS_HOME') or Path.home() / '.ros')
    words = [*given['namespace'].split('/'), Path(given['scenario']).stem or 'run']
    name = '_'.join([*filter(None, words), time.strftime('%Y_%m_%d-%H_%M_%S')])
    return str(home.absolute() / 'parallel_robot' / name)


def generate_launch_description() -> LaunchDescription:
    """Describe the nodes of one run; `--show-args` lists the arguments."""
    described = {name: ('', text) for name, (text, _) in PARAMETERS.items()} | OTHERS
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in described.items()
    ]
    return LaunchDescription(
        [*arguments, OpaqueFunction(function=page), OpaqueFunction(function=nodes)]
    )
