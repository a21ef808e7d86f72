"""What a bag says of its experiment beside the motion: statuses, changes, code, losses."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.bags.bag_reader import Bag, Messages
from parallel_robot.bags.experiment import suits
from parallel_robot.bags.files import bag_files
from parallel_robot.bags.files.bag_files import CHANGES, MESSAGES, PARAMETERS
from parallel_robot.bags.limits import MESSAGE, STATUSES, is_name
from parallel_robot.bags.messages.message_types import deserialize
from parallel_robot_control import messages
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_control.safety import faults, limiting
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.yaml_file import MOTION
from parallel_robot_model.messages.topics import STATUS, Topic

# Statuses of the controller in a bag: law, fault and limits that acted, as stable codes.

LIMIT_TEXT = {limiting.LIMIT_CODE[bit]: text for bit, text in limiting.LIMIT_TEXT.items()}


class ControllerStatus(NamedTuple):
    """A status of the controller."""

    stamp: int  # when it began [ns]
    law: str  # active law
    fault: str  # code of the fault, NO_FAULT without one
    fault_text: str  # the fault for people
    limits: tuple[str, ...]  # codes of the limits that acted, until none had done so for a while
    pose: tuple[float, ...] = ()  # the pose that the controller was told; empty when it was not
    refused: str = ''  # why a fault was not cleared just now


def status_decoder(bag: Path) -> Callable[[Topic, Messages], list[tuple[int, ControllerStatus]]]:
    """Function that decodes statuses, each with its log time; leaves out what is not understood.

    It raises BagError when a bag has too many of them.

    Args:
        bag: The bag, for error messages.
    """
    left = STATUSES

    def decode(topic: Topic, found: Messages) -> list[tuple[int, ControllerStatus]]:
        nonlocal left
        left -= len(found.payloads)
        if left < 0:
            raise BagError(f'{bag} has more than {STATUSES} messages on {topic.name}')
        payloads = (row.tobytes() for row in found.payloads[:, : MESSAGE + 1])
        pairs = zip(found.log_times.tolist(), map(decoded_status, payloads), strict=True)
        return [(log_time, status) for log_time, status in pairs if status is not None]

    return decode


def decoded_status(message: bytes) -> ControllerStatus | None:
    """A message on ``controller/status``; None when it is broken or not the suite's."""
    try:
        array: Any = deserialize(message, STATUS.type)
        values = {item.key: item.value for item in array.status[0].values}
        law, text = values[messages.LAW], values[messages.FAULT]
        fault, codes = values[messages.FAULT_CODE], values[messages.LIMIT_CODES].split(',')
        pose = _numbers(values.get(messages.POSE, ''))
        refused = values.get(messages.REFUSED, '')
        stamp = array.header.stamp.sec * NANOSECONDS + array.header.stamp.nanosec
    except Exception:  # broken, or a topic of that name that is not the suite's
        return None
    names = (law, fault, *codes)
    if not (f'{text}{refused}'.isprintable() and all(map(is_name, names))):
        return None
    return ControllerStatus(stamp, law, fault, text, tuple(filter(None, codes)), pose, refused)


def _numbers(text: str) -> tuple[float, ...]:
    """Finite numbers with commas between them; none where there are others."""
    try:
        found = tuple(map(float, text.split(',')))
    except ValueError:
        return ()
    return found if all(map(math.isfinite, found)) else ()


REALTIME = 'granted.realtime'  # parameter of a node
FEW = 5  # changes of the motion that are told one by one


class Change(NamedTuple):
    """A change of parameters while the run was recorded."""

    stamp: int  # stamp of the newest state when the change arrived [ns]
    node: str  # full name of the node
    values: dict[str, Any]  # new values by key


class History(NamedTuple):
    """What happened beside the motion."""

    # what the suite wrote about the experiment; empty when another recorded it
    facts: dict[str, str]
    # what the controller published of itself, in order; empty in bags of others
    statuses: tuple[ControllerStatus, ...]
    # node to its parameters at the start of the recording, where they were asked
    parameters: dict[str, dict[str, Any]]
    changes: tuple[Change, ...]  # later changes of parameters
    # source of each custom law and robot by key, as ``custom_laws``, and by name
    sources: dict[str, dict[str, bytes]]
    lost: dict[str, int]  # topic to number of messages that the recorder knows to be missing


def of(found: Bag[Any], told: Iterable[tuple[int, ControllerStatus]]) -> History:
    """What a bag says; what is not there or not understood is left out.

    Args:
        found: What was read of the bag.
        told: Statuses of the controller with their log times [ns], in the order of the file.
    """
    # In lockstep, stamps are log times.
    dated = sorted(told, key=lambda pair: (pair[1].stamp, *pair))
    known = config.resolve('paper_circle') if {CHANGES, PARAMETERS} & found.notes.keys() else {}
    parameters = {
        node: _values(text, known)
        for note in found.notes.get(PARAMETERS, [])
        for node, text in note.items()
        if is_name(node)
    }
    changes = []
    for note in found.notes.get(CHANGES, []):
        stamp, node = plain_data.whole_number(note.get('stamp', '')), note.get('node', '')
        if stamp is not None and is_name(node):
            changes.append(Change(stamp, node, _values(note.get('values', ''), known)))
    certificates = [pair for note in found.notes.get(MESSAGES, []) for pair in note.items()]
    return History(
        found.metadata,
        tuple(status for _, status in dated),
        parameters,
        tuple(changes),
        found.sources,
        {topic: bag_files.lost(text) for topic, text in certificates},
    )


def remarks(history: History, start: int) -> list[str]:
    """What a user should know of a run: limits that acted, faults.

    Args:
        history: History of the run.
        start: Stamp of t = 0 [ns].
    """
    codes = {code for status in history.statuses for code in status.limits}
    names = sorted(LIMIT_TEXT.get(code, code) for code in codes)
    refused = [
        ((status.stamp - start) / NANOSECONDS, status.refused)
        for status in history.statuses
        if status.refused
    ]
    return remark_lines(', '.join(names), faults_in(history, start), refused)


def faults_in(history: History, start: int) -> list[tuple[float, str]]:
    """When the controller entered a fault [s], and which; empty where it was cleared.

    Args:
        history: History of the run.
        start: Stamp of t = 0 [ns].
    """
    changes: list[tuple[float, str]] = []
    before = NO_FAULT
    for status in history.statuses:
        if status.fault != before:
            text = status.fault_text if status.fault != NO_FAULT else ''
            changes.append(((status.stamp - start) / NANOSECONDS, text))
        before = status.fault
    return changes


def failure(history: History, start: int, last: int) -> str:
    """Why a run has no figures, see :func:`faults.failure`; empty if it has them.

    Args:
        history: History of the run.
        start: Stamp of t = 0 [ns].
        last: Stamp of the last state [ns].
    """
    return faults.failure(faults_in(history, start), (last - start) / NANOSECONDS)


def new_motions(history: History, start: int) -> list[str]:
    """A line about motions that were asked for while the robot moved, if there were any.

    Args:
        history: History of the run.
        start: Stamp of t = 0 [ns].
    """
    times = [
        f'{(change.stamp - start) / NANOSECONDS:.3f}'
        for change in history.changes
        if MOTION in change.values
    ]
    shown = ', '.join(times[:FEW]) + (f' s and {len(times) - FEW} later' if times[FEW:] else ' s')
    return [f'the motion was changed at t = {shown}'] if times else []


def granted_priorities(history: History) -> dict[str, str]:
    """Real-time priority granted to each node, by full name; empty for older bags."""
    return {
        node: str(parameters[REALTIME])
        for node, parameters in history.parameters.items()
        if REALTIME in parameters
    }


def losses(history: History) -> list[str]:
    """A line about messages that the recorder knows to be lost, if there are any."""
    lost = {topic: count for topic, count in history.lost.items() if count}
    if not lost:
        return []
    topics = ', '.join(f'{topic} ({count})' for topic, count in lost.items())
    return [f'messages were lost on their way to the bag: {topics}']


def remark_lines(
    limits: str, faults: Iterable[tuple[float, str]], refused: Iterable[tuple[float, str]]
) -> list[str]:
    """Lines about limits that acted, faults and refusals to clear one: times [s] and texts.

    The text of a fault that was cleared is empty.
    """
    lines = [f'limits acted: {limits}'] if limits else []
    for time, text in faults:
        what = f'fault at t = {time:.3f} s, safe action from there on: {text}'
        lines.append(what if text else f'fault cleared at t = {time:.3f} s')
    return lines + [f'not cleared at t = {time:.3f} s: {text}' for time, text in refused]


def _values(text: str, known: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a node, without values of the wrong type for their keys."""
    return {
        key: value for key, value in plain_data.mapping(text).items() if suits(known, key, value)
    }
