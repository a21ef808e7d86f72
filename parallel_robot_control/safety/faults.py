"""Faults: the reasons why the controller replaces its law with the safe action.

A fault is its number and text here, a limit in SafetyParameters and in config/defaults.yaml if it
has one, a kernel in checks.py, and a call of it in the cycle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Literal, NamedTuple

from parallel_robot_model.configuration.fields import Field, PerJoint
from parallel_robot_model.robots.contract import FOUND, Fault, Robot

NONE = FOUND  # 1 to 9 are the faults of the robot, e.g. a singularity
TORQUE_NOT_FINITE = 10
SPEED = 11
POSITION_JUMP = 12
REFERENCE_JUMP = 13
POSITIONS_FROZEN = 14
VELOCITIES_WRONG = 15
STATES_STALE = 16
REFERENCE_STALE = 17
STATES_DISAGREE = 18
REFERENCES_DISAGREE = 19
EMERGENCY_STOP = 20
TORQUE_LOST = 21
STATES_LATE = 22
STATES_AHEAD = 23
STATES_INVALID = 24
COMMANDS_DISAGREE = 25
TOO_FAST = 27
TORQUE_RESISTED = 28

FAULTS = {
    TORQUE_NOT_FINITE: Fault('torque_not_finite', 'the law gave a torque that is not finite'),
    SPEED: Fault('speed', 'a joint is faster than its limit'),
    POSITION_JUMP: Fault(
        'position_jump',
        'a joint angle jumped: faster than its limit or its rate from one state to the next',
    ),
    REFERENCE_JUMP: Fault(
        'reference_jump',
        'the reference jumped: faster than the limit from one sample to the next',
    ),
    POSITIONS_FROZEN: Fault(
        'positions_frozen', 'a joint angle stands still while its rate says that the joint moves'
    ),
    VELOCITIES_WRONG: Fault('velocities_wrong', 'a joint rate is not the derivative of its angle'),
    STATES_STALE: Fault('states_stale', 'no joint state came for too long'),
    REFERENCE_STALE: Fault('reference_stale', 'no reference came for too long'),
    STATES_DISAGREE: Fault(
        'states_disagree',
        'joint states contradict one another: two publishers, or stamps that jump',
    ),
    REFERENCES_DISAGREE: Fault(
        'references_disagree',
        'references contradict one another: two publishers, or stamps that jump',
    ),
    EMERGENCY_STOP: Fault('emergency_stop', 'emergency stop'),
    TORQUE_LOST: Fault('torque_lost', 'the motors do not apply the commanded torque'),
    STATES_LATE: Fault('states_late', 'joint states come too late'),
    STATES_AHEAD: Fault('states_ahead', 'joint states are stamped ahead of the clock'),
    STATES_INVALID: Fault('states_invalid', 'joint states have no usable numbers'),
    TORQUE_RESISTED: Fault(
        'torque_resisted', 'the robot does not move as the torque should move it'
    ),
    TOO_FAST: Fault(
        'too_fast',
        'the robot was about to be too fast to be stopped before a limit, e.g. a singularity',
    ),
    COMMANDS_DISAGREE: Fault(
        'commands_disagree', 'another node publishes on the topic of the commands'
    ),
}

NUMBERS = {fault.key: number for number, fault in FAULTS.items()}


class SafetyParameters(NamedTuple):
    """Limits of the controller, and what replaces its law after a fault."""

    action: Annotated[
        Literal['zero', 'damp', 'hold'],
        Field('', 'after a fault: no torque, damping, or spring and damping'),
    ]
    damping: Annotated[PerJoint, Field('N m s/rad', 'damping of damp and hold', 0.0)]
    stiffness: Annotated[PerJoint, Field('N m/rad', 'spring of hold', 0.0)]
    torque_limit: Annotated[PerJoint, Field('N m', 'largest torque per joint', 0.0)]
    torque_rate: Annotated[
        PerJoint, Field('N m/s', 'fastest change of the torque per joint', 1e-3)
    ]
    ramp_rate: Annotated[
        PerJoint, Field('N m/s', 'how fast the torque before a take-over is faded out', 1e-3)
    ]
    speed_limit: Annotated[PerJoint, Field('rad/s', 'joint speed that is a fault', 0.0)]
    state_timeout: Annotated[
        float, Field('s', 'time without joint states that is a fault (wall time)', 1e-3)
    ]
    reference_timeout: Annotated[
        float, Field('s', 'age of the reference at a state that is a fault', 1e-3)
    ]
    state_age: Annotated[
        float, Field('s', 'age from which on a state is not answered (wall time)', 1e-3)
    ]
    gap: Annotated[
        float, Field('s', 'time between two states after which the law begins anew', 1e-3)
    ]
    effort_tolerance: Annotated[
        PerJoint,
        Field('N m', 'efforts so far from all late commands do not obey; 0: not looked at', 0.0),
    ]
    effort_timeout: Annotated[float, Field('s', 'time without obedience that is a fault', 1e-3)]
    residual_limit: Annotated[
        PerJoint,
        Field('N m', 'torque beside friction that resists the motors; 0: not looked at', 0.0),
    ]
    rate_tolerance: Annotated[
        float,
        Field('rad', 'by which ways may differ from integrals of rates; 0: not looked at', 0.0),
    ]


MOST = 0.5  # of a run; one that is in a fault for longer has no figures


def failure(changes: Sequence[tuple[float, str]], end: float) -> str:
    """Why a run has no figures: it was in a fault at its end, or for most of it; else empty.

    Args:
        changes: When the controller entered a fault [s], and which; empty where it was cleared.
        end: Time of the last state [s].
    """
    times = [*(time for time, _ in changes), end]
    spells = [
        (later - time, time, text)
        for (time, text), later in zip(changes, times[1:], strict=True)
        if text
    ]
    lasted = sum(spell for spell, _, _ in spells)
    if not spells or not (changes[-1][1] or lasted > MOST * end):
        return ''
    _, first, text = spells[0]
    share = f'{100.0 * lasted / end:.3g} % of the run' if end > 0.0 else 'all of the run'
    return f'in a fault for {share}, first at t = {first:.3f} s: {text}'


def of(robot: Robot) -> Mapping[int, Fault]:
    """All faults that a controller of this robot can be in, by number."""
    return {**robot.FAULTS, **FAULTS}
