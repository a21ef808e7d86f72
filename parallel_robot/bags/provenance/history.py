"""What a bag says of its experiment beside the motion: statuses, changes, code, losses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from parallel_robot.bags.experiment import suits
from parallel_robot.bags.files import bag_files
from parallel_robot.bags.files.bag_files import CHANGES, MESSAGES, PARAMETERS
from parallel_robot.bags.limits import is_name
from parallel_robot.bags.provenance.statuses import LIMIT_TEXT, ControllerStatus
from parallel_robot.bags.reading.bag_reader import Bag
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_control.safety import faults
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.yaml_file import MOTION

REALTIME = 'granted.realtime'  # parameter of a node
FEW = 5  # changes of the motion that are told one by one


class Change(NamedTuple):
    """A change of parameters while the run was recorded.

    Attributes:
        stamp: Stamp of the newest state when the change arrived [ns].
        node: Full name of the node.
        values: New values by key.
    """

    stamp: int
    node: str
    values: dict[str, Any]


class History(NamedTuple):
    """What happened beside the motion.

    Attributes:
        facts: What the suite wrote about the experiment; empty when another recorded it.
        statuses: What the controller published of itself, in order; empty in bags of others.
        parameters: Node to its parameters at the start of the recording, where they were asked.
        changes: Later changes of parameters.
        sources: Source of each custom law and robot by key, as ``custom_laws``, and by name.
        lost: Topic to number of messages that the recorder knows to be missing.
    """

    facts: dict[str, str]
    statuses: tuple[ControllerStatus, ...]
    parameters: dict[str, dict[str, Any]]
    changes: tuple[Change, ...]
    sources: dict[str, dict[str, bytes]]
    lost: dict[str, int]


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
    return remark_lines(', '.join(names), faults_in(history, start))


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


def remark_lines(limits: str, faults: Iterable[tuple[float, str]]) -> list[str]:
    """Lines about limits that acted and faults: times [s] and texts, empty for a cleared one."""
    lines = [f'limits acted: {limits}'] if limits else []
    for time, text in faults:
        what = f'fault at t = {time:.3f} s, safe action from there on: {text}'
        lines.append(what if text else f'fault cleared at t = {time:.3f} s')
    return lines


def _values(text: str, known: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a node, without values of the wrong type for their keys."""
    return {
        key: value for key, value in plain_data.mapping(text).items() if suits(known, key, value)
    }
