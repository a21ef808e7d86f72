"""What the nodes of one loop share: period, joints, start, end, mode."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, NamedTuple

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import MICROSECOND, NANOSECONDS
from parallel_robot_model.configuration import hazards
from parallel_robot_model.configuration.fields import Field, group
from parallel_robot_model.configuration.plain_data import with_location
from parallel_robot_model.messages.topics import SLOW

STEP_START = NANOSECONDS  # earliest stamp of t = 0 in lockstep; 0 is "no time yet" in ROS
WAIT = -1  # start_stamp of a node that waits for the common start
SWAPPED = NANOSECONDS  # by which the stamps of states may go back within one run
OLDEST = NANOSECONDS // 10  # ns, by which the first state in lockstep may be older than the start

DURATION = 12.0  # s, of a simulation whose scenario says nothing: two turns of the paper's circle


class LoopParameters(NamedTuple):
    """What all nodes of a loop must agree on."""

    scenario: Annotated[str, Field('', 'one of config/scenarios, or a YAML file')]
    law: Annotated[str, Field('', 'control law')]
    preset: Annotated[
        Literal['paper', 'custom'],
        Field('', 'paper: gains of all laws as in config/laws, Table 2; custom: others'),
    ]
    robot_model: Annotated[str, Field('', 'robot: one of the suite, a custom one, a description')]
    robot_description: Annotated[
        str, Field('', 'text of the description of the robot (MJCF, URDF), if it has one')
    ]
    robot_compiled: Annotated[
        str,
        Field('', 'what MuJoCo made of it, if it is MJCF; empty: it is compiled'),
    ]
    custom_laws: Annotated[
        tuple[str, ...], Field('', 'files of custom laws: Python, a C library, an FMU')
    ]
    custom_robots: Annotated[tuple[str, ...], Field('', 'Python files with custom robots')]
    custom_trajectories: Annotated[
        tuple[str, ...], Field('', 'Python files with custom trajectories')
    ]
    joints: Annotated[tuple[str, ...], Field('', 'names of the actuated joints, in order')]
    period: Annotated[
        float,
        Field('s', 'one sample of all; auto: as joint states come (nodes, wall time)', 1e-4, 0.1),
    ]
    duration: Annotated[float, Field('s', 'length of the motion; 0: without end', 0.0)]
    seed: Annotated[int, Field('', 'of all that is random in the plant', 0, 2**53)]
    hazards: Annotated[tuple[str, ...], Field('', 'what happens to the loop, and when')]
    time_mode: Annotated[
        Literal['wall', 'lockstep'],
        Field('', 'wall: real time; lockstep: the plant waits for each command'),
    ]
    executor: Annotated[Literal['events', 'single'], Field('', 'executor of rclpy')]
    realtime: Annotated[
        Literal['auto', 'off'],
        Field('', 'auto: real-time priority and locked memory where permitted (wall time)'),
    ]
    middleware: Annotated[
        Literal['udp', 'default'],
        Field('', 'udp: Fast DDS without shared memory; default: as it is set up'),
    ]
    end_with_parent: Annotated[
        bool, Field('', 'true: a node ends when the process that started it has ended')
    ]
    start_stamp: Annotated[
        int, Field('ns', 'stamp of t = 0; 0: with the first command; -1: wait to be told', -1)
    ]
    subscribers: Annotated[
        int, Field('', 'subscribers that each output waits for before the start', 1)
    ]

    @property
    def lockstep(self) -> bool:
        """Whether the plant waits for each command."""
        return self.time_mode == 'lockstep'

    @property
    def period_ns(self) -> int:
        """Period in nanoseconds."""
        return round(self.period * NANOSECONDS)

    @property
    def grid(self) -> int:
        """Grid of t = 0 [ns], so that topics for display have a sample there."""
        return SLOW * self.period_ns

    @property
    def step_start(self) -> int:
        """Stamp of t = 0 in lockstep [ns]."""
        return -(-STEP_START // self.grid) * self.grid

    @property
    def last_index(self) -> int | None:
        """Index of the last state of the motion; None if it has no end."""
        return round(self.duration / self.period) if self.duration > 0.0 else None


def length(values: Mapping[str, Any]) -> float:
    """How long the run of a resolved configuration is to be, in whole periods [s]."""
    period = float(values['period'])
    return round(float(values['duration']) / period) * period


def loop_of(values: Mapping[str, Any]) -> LoopParameters:
    """What a resolved configuration says of the loop.

    Raises:
        InputError: a value is wrong. No joints, or two with one name; a period that is
            not a whole number of microseconds; a motion without samples.
    """
    loop = group(values, LoopParameters, '')
    with with_location(values):
        _check(loop)
    return loop


def _check(loop: LoopParameters) -> None:
    if not loop.joints or len(set(loop.joints)) != len(loop.joints):
        raise InputError(f'joints must be different names, not {list(loop.joints)}', 'joints')
    hazards.checked(loop.hazards, loop.joints, loop.period)
    if loop.period_ns % MICROSECOND:
        raise InputError(
            f'period must be a whole number of µs, e.g. 0.001, 0.004, not {loop.period:.12g}',
            'period',
        )
    if loop.last_index == 0:
        raise InputError(
            f'duration must be at least one period, {loop.period:g} s, not {loop.duration:g}; '
            'for nodes, 0 is no end',
            'duration',
        )
