"""A graph that the page starts: trajectory, plant and controller of a scenario."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any, NamedTuple

from parallel_robot.cli.commands import run
from parallel_robot_control.configuration import resolve
from parallel_robot_model.configuration.plain_data import locating
from parallel_robot_model.processes.node_processes import NodeProcesses, domain_lock
from parallel_robot_sim.configuration import assemble, configure

NAMES = ('trajectory', 'plant', 'controller')


class StartedGraph(NamedTuple):
    """Nodes that move.

    Attributes:
        processes: Their processes.
        parameters: What they were given, for a recorder.
        values: Their configuration.
    """

    processes: NodeProcesses
    parameters: dict[str, Any]
    values: dict[str, Any]


@contextmanager
def started_graph(
    scenario: str, changed: Mapping[str, Any], namespace: str
) -> Iterator[StartedGraph]:
    """Start a graph; it ends in order with the context.

    Args:
        scenario: Its name, or the path of its file.
        changed: Key to value.
        namespace: Full name of the namespace of the nodes; empty for none.

    Raises:
        InputError: the configuration is wrong.
        RunError: a node does not start.
    """
    configuration = configure(resolve(scenario, changed))
    with locating(configuration.values):
        loop = assemble(configuration).loop
    parameters = run.node_parameters(NAMES, scenario, changed, loop)
    with domain_lock(namespace), NodeProcesses(parameters, namespace) as processes:
        from parallel_robot.cli.ros_session import Session  # needs ROS, after the forks

        with Session(NAMES, processes.check, namespace, loop.middleware) as session:
            run.start(processes, session, loop, NAMES)
        yield StartedGraph(processes, parameters['controller'], dict(configuration.values))
