"""What the controller reports, as messages; one row per state."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from parallel_robot_control.safety import limiting
from parallel_robot_control.terms.coupling import synchronisation_error
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import cdr, layouts, topics
from parallel_robot_model.robots.contract import Fault

OK, WARN, ERROR = 0, 1, 2  # levels of diagnostic_msgs/DiagnosticStatus
LAW = 'law'  # keys of a status: codes are for programs, texts for people
FAULT, FAULT_CODE = 'fault', 'fault code'
LIMITS, LIMIT_CODES = 'limits that acted', 'limit codes'
DELAY = 'delay of the states'
POSE = 'pose'  # only of a robot that has lost it, and that was told it
LOST = 'not known'
NO_FAULT = 'none'  # the code


class Telemetry(NamedTuple):
    """What the controller publishes besides its commands, each shape (N, n).

    Attributes:
        error: e = reference - feedback [rad].
        error_rate: Its derivative [rad/s].
        coupled_error: e_c of the law [rad].
        sliding_variable: Sliding variable in the law's unit.
    """

    error: np.ndarray
    error_rate: np.ndarray
    coupled_error: np.ndarray
    sliding_variable: np.ndarray


class Status(NamedTuple):
    """What the controller is doing.

    Attributes:
        law: Name of the active law.
        fault: The present fault, if there is one.
        acted: Bits of the limits that acted, until none has done so for a while.
        delay: What is known of the age of the states; empty where it is not identified.
        pose: The pose that the controller was told, numbers with commas; LOST where it must be.
    """

    law: str
    fault: Fault | None
    acted: int
    delay: str = ''
    pose: str = ''


def reported_limits(
    acted: np.ndarray,
    stamps: np.ndarray,
    answered: np.ndarray,
    begins: Collection[int],
    before: tuple[int, int] = (0, 0),
) -> np.ndarray:
    """Bits of the limits in the status after each state, shape (N,).

    Args:
        acted: Bits of those that acted at the state, shape (N,).
        stamps: Of the states [ns], shape (N,).
        answered: Whether the state was answered, shape (N,).
        begins: Rows at which a controller begins that knows of none before.
        before: Bits in the status before, and the stamp of the last state at which one acted [ns].
    """
    told = np.zeros_like(acted)
    shown, last = before
    if not acted.any() and not shown:
        return told
    for k in np.flatnonzero(answered).tolist():
        shown = 0 if k in begins else shown
        if acted[k]:
            shown, last = shown | int(acted[k]), int(stamps[k])
        elif stamps[k] - last >= limiting.QUIET * NANOSECONDS:
            shown = 0
        told[k] = shown
    return told


def telemetry_messages(
    joints: tuple[str, ...], stamps: np.ndarray, telemetry: Telemetry
) -> dict[topics.Topic, np.ndarray]:
    """sensor_msgs/JointState per topic: errors as positions, their rates as velocities."""
    fields, count = telemetry_fields(telemetry), len(telemetry.error)
    return {
        topic: layout.records(count, stamps, **fields[topic])
        for topic, layout in telemetry_layouts(joints).items()
    }


def telemetry_layouts(joints: tuple[str, ...]) -> dict[topics.Topic, cdr.Layout]:
    """Layouts of the telemetry by topic."""
    both = layouts.joint_state(joints, ('position', 'velocity'))
    single = layouts.joint_state(joints, ('position',))
    return {
        topics.ERROR: both,
        topics.SYNCHRONISATION_ERROR: both,
        topics.CROSS_COUPLING_ERROR: single,
        topics.SLIDING_VARIABLE: single,
    }


def telemetry_fields(telemetry: Telemetry) -> dict[topics.Topic, dict[str, np.ndarray]]:
    """Fields of the telemetry by topic."""
    e, e_dot = telemetry.error, telemetry.error_rate
    e_s, e_s_dot = synchronisation_error(e), synchronisation_error(e_dot)
    return {
        topics.ERROR: {'position': e, 'velocity': e_dot},
        topics.SYNCHRONISATION_ERROR: {'position': e_s, 'velocity': e_s_dot},
        topics.CROSS_COUPLING_ERROR: {'position': telemetry.coupled_error},
        topics.SLIDING_VARIABLE: {'position': telemetry.sliding_variable},
    }


def answers_message(stamps: np.ndarray, torques: np.ndarray) -> bytes:
    """Some commands and when they were asked for, as an Int64MultiArray.

    One row per command, in the order of the commands: three stamps, and the bits of the torques.

    Args:
        stamps: Of the state, of the reference, and from which on the torque acts [ns], shape
            (N, 3); zeros for a command that answers no state.
        torques: The commands [N m], shape (N, n).
    """
    rows = np.hstack([stamps, torques.view(np.int64)])
    head = layouts.int64_multi_array(rows.size).template[: -rows.nbytes or None]
    return head.tobytes() + rows.tobytes()


def limits_text(acted: int) -> str:
    """The limits that acted, by name."""
    return ', '.join(text for bit, text in limiting.ACTED_TEXT.items() if acted & bit) or 'none'


def limit_codes(acted: int) -> str:
    """Codes of the limits that acted, separated by commas; empty when none did."""
    return ','.join(code for bit, code in limiting.ACTED_CODE.items() if acted & bit)


def status_message(stamp: int, status: Status) -> bytes:
    """A status since a stamp [ns] as a diagnostic_msgs/DiagnosticArray of one status."""
    if status.fault:
        level, text = ERROR, f'fault: {status.fault.text}'
    elif status.acted:
        level, text = WARN, f'acted: {limits_text(status.acted)}'
    else:
        level, text = OK, 'ok'
    values = {
        LAW: status.law,
        FAULT: status.fault.text if status.fault else 'none',
        FAULT_CODE: status.fault.key if status.fault else NO_FAULT,
        LIMITS: limits_text(status.acted),
        LIMIT_CODES: limit_codes(status.acted),
    }
    if status.delay:
        values[DELAY] = status.delay
    if status.pose:
        values[POSE] = status.pose
    name, frame = 'controller: status', topics.FRAME
    layout = layouts.diagnostic_array(name, level, text, values, frame=frame)
    return layouts.padded(layout.encode(stamp))
