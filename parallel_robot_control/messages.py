"""What the controller reports, as messages; one row per state."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.safety import limiting
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.compiler import Boxed, internal
from parallel_robot_model.messages import cdr, layouts, topics
from parallel_robot_model.messages.cdr import ENCAPSULATION, SPARE
from parallel_robot_model.messages.topics import TELEMETRY, Telemetry, Topic
from parallel_robot_model.robots.contract import Fault

OK, WARN, ERROR = 0, 1, 2  # levels of diagnostic_msgs/DiagnosticStatus
LAW = 'law'  # keys of a status: codes are for programs, texts for people
FAULT, FAULT_CODE = 'fault', 'fault code'
LIMITS, LIMIT_CODES = 'limits that acted', 'limit codes'
DELAY = 'delay of the states'
POSE = 'pose'  # only of a robot that has lost it, and that was told it
LOST = 'not known'
REFUSED = 'not cleared'  # why, where ~/clear_fault was refused
NO_FAULT = 'none'  # the code


class Status(NamedTuple):
    """What the controller is doing."""

    law: str  # name of the active law
    fault: Fault | None  # the present fault, if there is one
    active_limits: int  # bits of the limits that acted, until none has done so for a while
    delay: str = ''  # what is known of the age of the states; empty where it is not identified
    # the pose that was reported to the controller, numbers with commas; LOST where it must be
    pose: str = ''
    refused: str = ''  # why a fault was not cleared just now


def reported_limits(
    active_limits: np.ndarray,
    stamps: np.ndarray,
    answered: np.ndarray,
    begins: Collection[int],
    before: tuple[int, int] = (0, 0),
) -> np.ndarray:
    """Bits of the limits in the status after each state, shape (N,).

    Args:
        active_limits: Bits of those that acted at the state, shape (N,).
        stamps: Of the states [ns], shape (N,).
        answered: Whether the state was answered, shape (N,).
        begins: Rows at which a controller begins that knows of none before.
        before: Bits in the status before, and the stamp of the last state at which one acted [ns].
    """
    reported = np.zeros_like(active_limits)
    shown, last = before
    if not active_limits.any() and not shown:
        return reported
    for k in np.flatnonzero(answered).tolist():
        shown = 0 if k in begins else shown
        if active_limits[k]:
            shown, last = shown | int(active_limits[k]), int(stamps[k])
        elif stamps[k] - last >= limiting.QUIET * NANOSECONDS:
            shown = 0
        reported[k] = shown
    return reported


FIELDS = ('position', 'velocity')  # of the messages that tell of a cycle


def telemetry_messages(
    joints: tuple[str, ...], stamps: np.ndarray, telemetry: Telemetry
) -> dict[Topic, np.ndarray]:
    """sensor_msgs/JointState per topic: errors as positions, their rates as velocities."""
    fields, count = telemetry_fields(telemetry), len(telemetry.error)
    return {
        topic: layout.records(count, stamps, **fields[topic])
        for topic, layout in telemetry_layouts(joints).items()
    }


def telemetry_layouts(joints: tuple[str, ...]) -> dict[Topic, cdr.Layout]:
    """Layouts of the telemetry by topic."""
    return {
        topic: layouts.joint_state(joints, FIELDS[: len(told)])
        for topic, told in TELEMETRY.items()
    }


def telemetry_fields(telemetry: Telemetry) -> dict[Topic, dict[str, np.ndarray]]:
    """Fields of the telemetry by topic."""
    return {
        topic: {name: find(telemetry) for name, find in zip(FIELDS, told, strict=False)}
        for topic, told in TELEMETRY.items()
    }


def answers_message(stamps: np.ndarray, torques: np.ndarray) -> bytes:
    """Some commands and their stamps, as an Int64MultiArray.

    One row per command, in the order of the commands: three stamps, and the bits of the torques.

    Args:
        stamps: Of the state, of the reference, and from which on the torque acts [ns], shape
            (N, 3); zeros for a command that answers no state.
        torques: The commands [N m], shape (N, n).
    """
    rows = np.hstack([stamps, torques.view(np.int64)])
    head = layouts.int64_multi_array(rows.size).template[: -rows.nbytes or None]
    return head.tobytes() + rows.tobytes()


def limits_text(active_limits: int) -> str:
    """The limits that acted, by name."""
    return (
        ', '.join(text for bit, text in limiting.LIMIT_TEXT.items() if active_limits & bit)
        or 'none'
    )


def limit_codes(active_limits: int) -> str:
    """Codes of the limits that acted, separated by commas; empty when none did."""
    return ','.join(code for bit, code in limiting.LIMIT_CODE.items() if active_limits & bit)


def status_message(stamp: int, status: Status) -> bytes:
    """A status since a stamp [ns] as a diagnostic_msgs/DiagnosticArray of one status."""
    if status.fault:
        level, text = ERROR, f'fault: {status.fault.text}'
    elif status.active_limits:
        level, text = WARN, f'acted: {limits_text(status.active_limits)}'
    else:
        level, text = OK, 'ok'
    values = {
        LAW: status.law,
        FAULT: status.fault.text if status.fault else 'none',
        FAULT_CODE: status.fault.key if status.fault else NO_FAULT,
        LIMITS: limits_text(status.active_limits),
        LIMIT_CODES: limit_codes(status.active_limits),
    }
    if status.delay:
        values[DELAY] = status.delay
    if status.pose:
        values[POSE] = status.pose
    if status.refused:
        values[REFUSED] = status.refused
    name, frame = 'controller: status', topics.FRAME
    layout = layouts.diagnostic_array(name, level, text, values, frame=frame)
    return layouts.padded(layout.encode(stamp))


# Joint vectors from the bytes of a message, compiled: a Layout as the kernels take it.

NOT_UNDERSTOOD = -1  # stamp that marks a message of another layout, or with an invalid stamp


class MessageLayout(NamedTuple):
    """Where the numbers of one kind of message lie, boxed; the arrays are those of the reader."""

    template: NDArray[np.uint8]  # a message
    constants: NDArray[np.int64]  # bytes that are the same in each
    stamp: int  # word of the stamp in the body; -1: it has none
    starts: NDArray[np.int64]  # where a joint vector begins in the numbers; -1: it is not there
    order: NDArray[np.int64]  # index of each of the wanted joints in it
    body: NDArray[np.uint8]  # the message that was opened last, without its head,
    words: NDArray[np.int32]  # as words
    numbers: Array  # and as floats
    row: Array  # the vector that was read last, shape (n,)


def message_layout(layout: cdr.Layout, fields: Sequence[str], order: Sequence[int]) -> Boxed:
    """Make what the kernels need from a layout.

    Args:
        layout: Layout of the messages.
        fields: Its joint vectors, in the order in which they will be read.
        order: Index of each of the wanted joints in them.
    """
    offset = len(ENCAPSULATION)  # CDR aligns from there, so in the body every number is aligned
    known: Any = layout.dtype.fields
    starts = [(known[name][1] - offset) // 8 if name in known else -1 for name in fields]
    body = np.zeros(-(-len(layout.template) // 8) * 8 + 8, np.uint8)
    wire = MessageLayout(
        layout.template.copy(),
        layout.constants.astype(np.int64),
        (known['sec'][1] - offset) // 4 if layout.stamped else -1,
        np.array(starts, np.int64),
        np.array(order, np.int64),
        body,
        body.view(np.int32),
        body.view(np.float64),
        np.zeros(len(order)),
    )
    return Boxed(wire)


@internal
def parse(wire: Any, data: bytes) -> bool:
    """Open a message for :func:`joint_row`; False if it has another layout."""
    template = wire.template
    if not len(template) <= len(data) < len(template) + SPARE:
        return False
    for i in wire.constants:
        if data[i] != template[i]:
            return False
    body = wire.body
    for i in range(len(template) - len(ENCAPSULATION)):
        body[i] = data[i + len(ENCAPSULATION)]
    return True


@internal
def parse_stamped(wire: Any, data: bytes) -> int:
    """Open a message with a stamp for :func:`joint_row`.

    Returns:
        Its stamp [ns]; NOT_UNDERSTOOD if it has another layout or its stamp is invalid.
    """
    if not parse(wire, data):
        return NOT_UNDERSTOOD
    sec: Any = np.int64(wire.words[wire.stamp])
    nanosec = np.int64(wire.words[wire.stamp + 1])  # negative: 2^31 or more
    if not 0 <= nanosec < NANOSECONDS:
        return NOT_UNDERSTOOD
    return sec * NANOSECONDS + nanosec


@internal
def joint_row(wire: Any, field: int, missing: float = 0.0) -> Array:
    """A joint vector of the message that was opened last, shape (n,), valid until the next one.

    Args:
        wire: See MessageLayout.
        field: Which one, from 0.
        missing: What its numbers are where the layout does not have it.
    """
    order, start, row = wire.order, wire.starts[field], wire.row
    for i in range(len(order)):
        row[i] = wire.numbers[start + order[i]] if start >= 0 else missing
    return row
