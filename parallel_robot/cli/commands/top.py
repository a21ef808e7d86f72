"""The command ``top``: a running graph in the terminal, or one picture of it in a pipe."""

from __future__ import annotations

import argparse
import os
import sys
import time
from typing import TYPE_CHECKING

from parallel_robot.watch.robots import Robot, Robots
from parallel_robot_model.common.errors import RunError, optional
from parallel_robot_model.messages.topics import add_namespace_argument, full
from parallel_robot_model.processes import realtime

if TYPE_CHECKING:
    from parallel_robot.watch.ros_graph import RosGraph

SETTLED = 2.0  # s, from the first node that is heard to the picture in a pipe
PATIENCE = 5.0  # s, in which a node must be heard then, and after it a joint
NICE = 5  # the loop goes first
LOOK = 0.5  # s between two looks for new messages


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_namespace_argument(parser, 'of the robot, default: the first that is heard', None)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    namespace = full(arguments.namespace) if arguments.namespace is not None else None
    optional('textual', "textual is not installed; pip install 'parallel_robot[top]'")
    from parallel_robot.watch.ros_graph import RosGraph  # only this command needs ROS

    realtime.prepare_discovery()
    domain = os.environ.get('ROS_DOMAIN_ID') or '0'
    robots = Robots()
    with RosGraph(robots) as graph:
        if sys.stdout.isatty() and sys.stdin.isatty():
            from parallel_robot.cli.top import Top

            os.nice(NICE)
            Top(robots, graph, domain, namespace).run()
        else:
            snapshot(robots, graph, domain, namespace)
    return 0


def snapshot(robots: Robots, graph: RosGraph, domain: str, namespace: str | None) -> None:
    """Print one picture of a robot, the first that is heard where no namespace is given.

    Raises:
        RunError: no node is heard.
    """
    from rich.console import Console  # comes with textual

    from parallel_robot.cli import top

    begun, heard = time.monotonic(), None
    while heard is None or not settled(robots[namespace or ''], heard):
        time.sleep(LOOK)
        graph.look()
        names = [name for name in robots.names() if namespace in (None, name)]
        if heard is None and names:
            namespace, heard = names[0], time.monotonic()
            graph.watch(namespace)
        elif heard is None and time.monotonic() - begun > PATIENCE:
            place = f'namespace {namespace} of ' if namespace else ''
            raise RunError(f'no node of the suite is heard in {place}ROS domain {domain}')
    console = Console()
    console.print(top.screen(robots, namespace or '', domain, time.monotonic(), console.width))


def settled(robot: Robot, heard: float) -> bool:
    """Whether the picture of a robot that was heard at a time [s] may be drawn."""
    now = time.monotonic()
    return now - heard >= (SETTLED if robot.joints(now) else PATIENCE)
