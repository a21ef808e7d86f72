"""The command ``live``: the robot in a browser."""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from parallel_robot.bags import output
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.commands import run
from parallel_robot.cli.from_function import VIEW_OF_BAG
from parallel_robot.cli.shared import given
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError, StoppedError, optional
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_model.messages.topics import add_namespace_argument, full
from parallel_robot_model.processes import realtime
from parallel_robot_model.processes.node_processes import NodeProcesses, domain_lock
from parallel_robot_model.processes.termination_signals import termination_signals
from parallel_robot_sim.configuration import assemble, configure

HOST, PORT, OUT = '127.0.0.1', 8080, Path('runs')
NICE = 5  # the loop goes first
Wait = Callable[[], None]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument(
        '--run',
        metavar='SCENARIO',
        help='start the nodes of a scenario, and end them with the page; default: those that run',
    )
    shown.add_argument('--bag', type=Path, metavar='BAG', help='play a bag, without nodes')
    parser.add_argument(
        '--foxglove',
        action='store_true',
        help='serve Foxglove and Lichtblick instead of a page, to look at alone; default port: '
        '8765',
    )
    parser.add_argument('--law', help='with --run: control law, default: that of the scenario')
    parser.add_argument(
        '--duration',
        type=float,
        metavar='S',
        help='with --run: seconds of motion, default: no end',
    )
    add_namespace_argument(parser, 'of the robot, default: the first that is heard', None)
    VIEW_OF_BAG.add_arguments(parser)
    parser.add_argument(
        '--host',
        default=HOST,
        metavar='ADDRESS',
        help=f'where to listen, default: {HOST}, this machine alone',
    )
    parser.add_argument(
        '--port', type=int, metavar='N', help=f'default: {PORT}, or another if that is taken'
    )
    parser.add_argument('--read-only', action='store_true', help='the page changes nothing')
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help=f'where the page puts the bags that it records, default: {OUT}',
    )
    add_trust_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    changed = given(arguments)
    for option in ('law', 'duration'):
        if getattr(arguments, option) is not None:
            changed[option] = getattr(arguments, option)
    if changed and arguments.run is None and arguments.bag is None:
        raise InputError(f'{next(iter(changed))} can be set with --run or --bag alone')
    if arguments.bag is None:
        for option, given_ in (
            ('--topic', arguments.topic),
            ('--joints', arguments.joints),
            ('--scenario', arguments.scenario),
            ('--override', arguments.override),
            ('--from', arguments.start is not None),
            ('--to', arguments.stop is not None),
            ('--trust', arguments.trust),
        ):
            if given_:
                raise InputError(f'{option} goes with --bag alone')
    else:
        for option in ('law', 'duration'):
            if getattr(arguments, option) is not None:
                raise InputError(f'--{option} goes with --run alone')
    if arguments.out is not None and (arguments.bag is not None or arguments.foxglove):
        raise InputError('--out: only the page of a graph records')
    if arguments.out is not None:
        output.check_directory(arguments.out / 'recorded')
    if arguments.port is not None and not 0 <= arguments.port < 1 << 16:
        raise InputError(f'--port must be from 0 to 65535, not {arguments.port}')
    namespace = full(arguments.namespace) if arguments.namespace is not None else None
    if arguments.foxglove:
        return _foxglove(arguments, changed, namespace)
    optional('aiohttp', "aiohttp is not installed; pip install 'parallel_robot[live]'")
    from parallel_robot.live.server import listening

    handlers = {number: signal.signal(number, _stop) for number in termination_signals()[1:]}
    try:
        with ExitStack() as stack:
            listen = stack.enter_context(listening(arguments.host, arguments.port, PORT))
            if arguments.bag is not None:
                from parallel_robot.live.bag_source import open_bag

                source: Any = open_bag(
                    stack,
                    arguments.bag,
                    arguments.trust,
                    VIEW_OF_BAG.call(arguments),
                )
            else:
                source = _graph(stack, arguments, changed, namespace)
            os.nice(NICE)
            listen(source, arguments.read_only)
    except (KeyboardInterrupt, StoppedError):
        print('ended', file=sys.stderr)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return 0


def _foxglove(
    arguments: argparse.Namespace, changed: dict[str, Any], namespace: str | None
) -> int:
    """Serve Foxglove until the user ends it."""
    if arguments.bag is not None:
        raise InputError(
            'Foxglove opens bags by itself: parallel_robot export BAG --foxglove makes one with '
            'the robot in it'
        )
    realtime.prepare_discovery()
    try:
        with ExitStack() as stack:
            values = None
            if arguments.run is not None:
                namespace, changed = namespace or '', {'duration': 0.0, **changed}
                graph = started_graph(arguments.run, changed, namespace)
                _, _, values = stack.enter_context(graph)
            from parallel_robot.live.ros_foxglove import (
                PORT,  # needs ROS, after the forks
                serve,  # needs ROS, after the forks
            )

            os.nice(NICE)
            port = PORT if arguments.port is None else arguments.port
            serve(arguments.host, port, namespace, values)
    except KeyboardInterrupt:
        print('ended', file=sys.stderr)
    return 0


def _stop(number: int, _: Any) -> None:
    raise StoppedError(number)


def _graph(
    stack: ExitStack, arguments: argparse.Namespace, changed: dict[str, Any], namespace: str | None
) -> Any:
    """The graph that runs, or one that is started."""
    realtime.prepare_discovery()
    values = parameters = None
    if arguments.run is not None:
        namespace, changed = namespace or '', {'duration': 0.0, **changed}
        _, parameters, values = stack.enter_context(
            started_graph(arguments.run, changed, namespace)
        )
    from parallel_robot.live.graph_source import GraphSource
    from parallel_robot.live.recording import Recording
    from parallel_robot.live.ros_live_graph import LiveGraph  # needs ROS, after the forks
    from parallel_robot.watch.robots import Robots

    recording = stack.enter_context(Recording(arguments.out or OUT, parameters))
    robots = Robots()
    graph = stack.enter_context(LiveGraph(robots))
    return GraphSource(graph, robots, recording, namespace, values)


# A graph that the page starts: trajectory, plant and controller of a scenario.

NAMES = ('trajectory', 'plant', 'controller')


@contextmanager
def started_graph(
    scenario: str, changed: Mapping[str, Any], namespace: str
) -> Iterator[tuple[NodeProcesses, dict[str, Any], dict[str, Any]]]:
    """Start a graph; it ends in order with the context.

    Args:
        scenario: Its name, or the path of its file.
        changed: Key to value.
        namespace: Full name of the namespace of the nodes; empty for none.

    Yields:
        Its processes, their parameters, for a recorder, and their configuration.

    Raises:
        InputError: the configuration is wrong.
        RunError: a node does not start.
    """
    configuration = configure(resolve(scenario, changed))
    with with_location(configuration.values):
        loop = assemble(configuration).loop
    parameters = run.node_parameters(NAMES, scenario, changed, loop)
    with domain_lock(namespace), NodeProcesses(parameters, namespace) as processes:
        from parallel_robot.cli.ros_session import Session  # needs ROS, after the forks

        with Session(NAMES, processes.check, namespace, loop.middleware) as session:
            run.start(processes, session, loop, NAMES)
        yield processes, parameters['controller'], dict(configuration.values)
