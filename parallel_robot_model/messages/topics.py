"""Topics of the suite: names, types, and how often each is published.

All names are relative: a namespace or a remapping moves them.
"""

from __future__ import annotations

import argparse
import re
from collections import Counter
from collections.abc import Callable, Iterable
from operator import attrgetter
from typing import NamedTuple

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.ring import synchronisation_error
from parallel_robot_model.common.units import Array

DEPTH = 10_000  # samples that publishers keep for subscribers that must not lose any: ten seconds
QUEUE = 1000  # length of the queue of a node of the suite, in samples
SLOW = 10  # topics for display are published every tenth sample (100 Hz at 1 kHz)
MARKERS_EVERY = 20  # samples between two sets of markers (50 Hz at 1 kHz)
FRAME = 'base'  # frame of poses and markers


class Topic(NamedTuple):
    """A topic of the suite."""

    name: str  # relative name
    type: str  # ROS type
    every: int = 1  # samples from one message to the next; 0 for topics without a fixed rate
    latched: bool = False  # whether late subscribers get the last message


JOINT_STATES = Topic('joint_states', 'sensor_msgs/msg/JointState')
REFERENCE = Topic('reference', 'trajectory_msgs/msg/JointTrajectory')
COMMANDS = Topic('effort_controller/commands', 'std_msgs/msg/Float64MultiArray')
POSE = Topic('pose', 'geometry_msgs/msg/PoseStamped', SLOW)
POSE_REFERENCE = Topic('pose_reference', 'geometry_msgs/msg/PoseStamped', SLOW)
ANSWERED = Topic('controller/answered', 'std_msgs/msg/Int64MultiArray', SLOW)
ACTIVE_LAW = Topic('controller/active_law', 'std_msgs/msg/String', 0, latched=True)
STATUS = Topic('controller/status', 'diagnostic_msgs/msg/DiagnosticArray', 0, latched=True)
UNSTAMPED = ('std_msgs/msg/Float64MultiArray', 'std_msgs/msg/String')
MARKERS = Topic('markers', 'visualization_msgs/msg/MarkerArray', MARKERS_EVERY)
ROBOT_DESCRIPTION = Topic('robot_description', 'std_msgs/msg/String', 0, latched=True)
FRAMES = Topic('tf', 'tf2_msgs/msg/TFMessage', MARKERS_EVERY)  # in bags alone
CLOCK = Topic('clock', 'rosgraph_msgs/msg/Clock')

# What a controller tells of its cycles: a vector is a field here, computed in `run_cycle`, and a
# topic a row of TELEMETRY.


class Telemetry(NamedTuple):
    """What a cycle tells besides its torque, each shape (n,); of many cycles, shape (N, n)."""

    error: Array  # e = reference - feedback, when the state was measured [rad]
    error_rate: Array  # its derivative [rad/s]
    coupled_error: Array  # e_c of the law [rad]; e in a fault
    sliding_variable: Array  # in the law's unit; zero in a fault


def _of_joints(name: str) -> Topic:
    return Topic(f'controller/{name}', 'sensor_msgs/msg/JointState', SLOW)


ERROR = _of_joints('error')
SYNCHRONISATION_ERROR = _of_joints('synchronisation_error')
CROSS_COUPLING_ERROR = _of_joints('cross_coupling_error')
SLIDING_VARIABLE = _of_joints('sliding_variable')
# position and, of some, velocity of the joints in the messages of each topic
TELEMETRY: dict[Topic, tuple[Callable[[Telemetry], Array], ...]] = {
    ERROR: (attrgetter('error'), attrgetter('error_rate')),
    SYNCHRONISATION_ERROR: (
        lambda told: synchronisation_error(told.error),
        lambda told: synchronisation_error(told.error_rate),
    ),
    CROSS_COUPLING_ERROR: (attrgetter('coupled_error'),),
    SLIDING_VARIABLE: (attrgetter('sliding_variable'),),
}

RECORDED = (
    JOINT_STATES,
    REFERENCE,
    COMMANDS,
    POSE,
    POSE_REFERENCE,
    *TELEMETRY,
    ANSWERED,
    ACTIVE_LAW,
    STATUS,
)


def recorded(placed: bool) -> tuple[Topic, ...]:
    """Topics that a bag holds; the pose only of a robot that moves in a plane."""
    return tuple(topic for topic in RECORDED if placed or topic not in (POSE, POSE_REFERENCE))


# The namespace of a robot's nodes and topics, by which several robots share a ROS domain.

MAX_LENGTH = 100  # characters; the middleware has 247 for a whole name
NAMESPACE = re.compile(r'(?!.*__)(/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*|/?)', re.ASCII)


def add_namespace_argument(
    parser: argparse.ArgumentParser, text: str, default: str | None = ''
) -> None:
    """Declare ``--namespace``."""
    parser.add_argument('--namespace', default=default, metavar='NAME', help=text)


def full(name: str) -> str:
    """Full name of a namespace, e.g. ``/left``; empty for none.

    Raises:
        InputError: ROS does not allow the name.
    """
    if not NAMESPACE.fullmatch(name) or len(name) > MAX_LENGTH:
        raise InputError(
            'namespace must be words of letters, digits and single underscores joined by /, none '
            f'beginning with a digit, at most {MAX_LENGTH} characters, e.g. left, not {name!r}'
        )
    name = name.strip('/')
    return f'/{name}' if name else ''


# Which node of a run publishes what for the others, and who subscribes to it.
#
# A node is ready when its output has all its subscribers, and in lockstep the plant begins when
# all are ready: a node that is missing here would miss the first states.

OUTPUTS = {'trajectory': REFERENCE, 'plant': JOINT_STATES, 'controller': COMMANDS}
INPUTS = {
    'trajectory': (),
    'plant': (COMMANDS,),
    'controller': (JOINT_STATES, REFERENCE),
    'recorder': RECORDED,
}
LOCKSTEP_INPUTS = {'trajectory': (JOINT_STATES,)}  # in addition: the plant sets the pace


def subscriptions(nodes: Iterable[str], lockstep: bool) -> Counter[Topic]:
    """How many of some nodes, by their names, subscribe to each topic."""
    counts: Counter[Topic] = Counter()
    for name in nodes:
        counts.update(INPUTS[name])
        if lockstep:
            counts.update(LOCKSTEP_INPUTS.get(name, ()))
    return counts


def subscribers(nodes: Iterable[str], lockstep: bool) -> dict[str, int]:
    """Name of each node that has an output to how many of some nodes subscribe to it."""
    counts = subscriptions(nodes, lockstep)
    return {name: counts[topic] for name, topic in OUTPUTS.items()}
