"""Topics of the suite: names, types, and how often each is published.

All names are relative: a namespace or a remapping moves them.
"""

from __future__ import annotations

from typing import NamedTuple

DEPTH = 10_000  # samples that publishers keep for subscribers that must not lose any: ten seconds
QUEUE = 1000  # length of the queue of a node of the suite, in samples
SLOW = 10  # topics for display are published every tenth sample (100 Hz at 1 kHz)
MARKERS_EVERY = 20  # samples between two sets of markers (50 Hz at 1 kHz)
FRAME = 'base'  # frame of poses and markers


class Topic(NamedTuple):
    """A topic of the suite.

    Attributes:
        name: Relative name.
        type: ROS type.
        every: Samples from one message to the next; 0 for topics without a fixed rate.
        latched: Whether late subscribers get the last message.
    """

    name: str
    type: str
    every: int = 1
    latched: bool = False


JOINT_STATES = Topic('joint_states', 'sensor_msgs/msg/JointState')
REFERENCE = Topic('reference', 'trajectory_msgs/msg/JointTrajectory')
COMMANDS = Topic('effort_controller/commands', 'std_msgs/msg/Float64MultiArray')
POSE = Topic('pose', 'geometry_msgs/msg/PoseStamped', SLOW)
POSE_REFERENCE = Topic('pose_reference', 'geometry_msgs/msg/PoseStamped', SLOW)
ERROR = Topic('controller/error', 'sensor_msgs/msg/JointState', SLOW)
SYNCHRONISATION_ERROR = Topic(
    'controller/synchronisation_error', 'sensor_msgs/msg/JointState', SLOW
)
CROSS_COUPLING_ERROR = Topic('controller/cross_coupling_error', 'sensor_msgs/msg/JointState', SLOW)
SLIDING_VARIABLE = Topic('controller/sliding_variable', 'sensor_msgs/msg/JointState', SLOW)
TELEMETRY = (ERROR, SYNCHRONISATION_ERROR, CROSS_COUPLING_ERROR, SLIDING_VARIABLE)
ANSWERED = Topic('controller/answered', 'std_msgs/msg/Int64MultiArray', SLOW)
ACTIVE_LAW = Topic('controller/active_law', 'std_msgs/msg/String', 0, latched=True)
STATUS = Topic('controller/status', 'diagnostic_msgs/msg/DiagnosticArray', 0, latched=True)
UNSTAMPED = ('std_msgs/msg/Float64MultiArray', 'std_msgs/msg/String')
MARKERS = Topic('markers', 'visualization_msgs/msg/MarkerArray', MARKERS_EVERY)
ROBOT_DESCRIPTION = Topic('robot_description', 'std_msgs/msg/String', 0, latched=True)
FRAMES = Topic('tf', 'tf2_msgs/msg/TFMessage', MARKERS_EVERY)  # in bags alone
CLOCK = Topic('clock', 'rosgraph_msgs/msg/Clock')

RECORDED = (
    JOINT_STATES,
    REFERENCE,
    COMMANDS,
    POSE,
    POSE_REFERENCE,
    ERROR,
    SYNCHRONISATION_ERROR,
    CROSS_COUPLING_ERROR,
    SLIDING_VARIABLE,
    ANSWERED,
    ACTIVE_LAW,
    STATUS,
)


def recorded(placed: bool) -> tuple[Topic, ...]:
    """Topics that a bag holds; the pose only of a robot that moves in a plane."""
    return tuple(topic for topic in RECORDED if placed or topic not in (POSE, POSE_REFERENCE))
