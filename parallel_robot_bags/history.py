"""What a bag says of its experiment beside the motion: statuses, changes, laws, losses."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.typesys import Stores, get_typestore

from parallel_robot_bags import bag_reader, plain_data
from parallel_robot_bags.bag_reader import Messages
from parallel_robot_bags.bag_writer import CHANGES, MESSAGES, PARAMETERS
from parallel_robot_bags.experiment import is_like
from parallel_robot_bags.limits import MEMORY, MESSAGE, NAME, STATUSES
from parallel_robot_base import config
from parallel_robot_base.errors import BagError
from parallel_robot_base.topics import STATUS, Topic
from parallel_robot_base.units import NANOSECONDS

STORE = get_typestore(Stores.ROS2_JAZZY)
REALTIME = 'granted.realtime'  # parameter of a node
NOTHING = 'none'  # what a status says instead of a fault or limits


class Said(NamedTuple):
    """A status of the controller, in its own words.

    Attributes:
        stamp: Since when [ns].
        law: Active law.
        fault: Text of the fault, or NOTHING.
        limits: Limits that have acted, or NOTHING.
    """

    stamp: int
    law: str
    fault: str
    limits: str


class Change(NamedTuple):
    """A change of parameters while the run was recorded.

    Attributes:
        stamp: Of the newest state when it was heard [ns].
        node: Full name.
        values: Key to new value.
    """

    stamp: int
    node: str
    values: dict[str, Any]


class History(NamedTuple):
    """What happened beside the motion.

    Attributes:
        facts: What the suite wrote about the experiment; empty when another recorded it.
        statuses: What the controller said of itself; nothing in the bags of others.
        parameters: Node to its parameters at the start of the recording, where they were asked.
        changes: Later changes of parameters.
        laws: Name to source of the laws of one's own.
        lost: Topic to number of messages that the recorder knows to be missing.
    """

    facts: dict[str, str]
    statuses: tuple[Said, ...]
    parameters: dict[str, dict[str, Any]]
    changes: tuple[Change, ...]
    laws: dict[str, bytes]
    lost: dict[str, int]


def read(bag: str | Path, memory: int = MEMORY) -> History:
    """Read what a bag says; what is not there or not understood is left out.

    Args:
        bag: Directory of the bag, or one file of it.
        memory: What may be held of it [bytes].

    Raises:
        BagError: not a bag, or one that takes too much.
    """
    found = bag_reader.read(bag, (STATUS,), _decoder(Path(bag)), memory)
    statuses = [said for parts in found.streams.values() for part in parts for said in part]
    known = config.resolve('paper_circle') if CHANGES in found.notes else {}
    changes = []
    for note in found.notes.get(CHANGES, []):
        stamp, node = plain_data.whole_number(note.get('stamp', '')), note.get('node', '')
        if stamp is not None and _is_name(node):
            changes.append(Change(stamp, node, _values(note.get('values', ''), known)))
    lost = {}
    for note in found.notes.get(MESSAGES, []):
        for topic, text in note.items():
            number = text.rpartition('lost ')[2]
            lost[topic] = plain_data.whole_number(number) or 0
    return History(
        found.metadata,
        tuple(sorted(statuses)),
        parameters_in(found.notes),
        tuple(changes),
        found.laws,
        lost,
    )


def parameters_in(notes: Mapping[str, list[dict[str, str]]]) -> dict[str, dict[str, Any]]:
    """Node to its parameters at the start of the recording, from the metadata records of a bag."""
    known = config.resolve('paper_circle') if PARAMETERS in notes else {}
    return {
        node: _values(text, known)
        for note in notes.get(PARAMETERS, [])
        for node, text in note.items()
        if _is_name(node)
    }


def remarks(history: History, start: int) -> list[str]:
    """What a user should know of a run: limits that acted, a fault.

    Args:
        history: Of the run.
        start: Stamp of t = 0 [ns].
    """
    names = {name for said in history.statuses for name in said.limits.split(', ')} - {NOTHING}
    first = next((said for said in history.statuses if said.fault != NOTHING), None)
    fault = ((first.stamp - start) / NANOSECONDS, first.fault) if first else None
    return remark_lines(', '.join(sorted(names)), fault)


def realtime(history: History) -> dict[str, str]:
    """Real-time priority that each node of a run had, by its full name; not in older bags."""
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


def remark_lines(limits: str, fault: tuple[float, str] | None) -> list[str]:
    """Lines about limits that acted and a fault: its time [s] and its text."""
    lines = [f'limits acted: {limits}'] if limits else []
    if fault is not None:
        time, text = fault
        lines.append(f'fault at t = {time:.3f} s, safe action from there on: {text}')
    return lines


def _decoder(bag: Path) -> Callable[[Topic, Messages], list[Said]]:
    left = STATUSES

    def decode(topic: Topic, messages: Messages) -> list[Said]:
        nonlocal left
        left -= len(messages.payloads)
        if left < 0:
            raise BagError(f'{bag} has more than {STATUSES} messages on {topic.name}')
        found: list[Said] = []
        for row in messages.payloads[:, : MESSAGE + 1]:
            try:
                message: Any = STORE.deserialize_cdr(row.tobytes(), STATUS.type)
                values = {item.key: item.value for item in message.status[0].values}
                stamp = message.header.stamp.sec * NANOSECONDS + message.header.stamp.nanosec
                said = Said(stamp, values['law'], values['fault'], values['limits that acted'])
            except Exception:  # broken, or somebody else's topic of the same name
                continue
            if _is_name(said.law) and (said.fault + said.limits).isprintable():
                found.append(said)
        return found

    return decode


def _values(text: str, known: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters of a node, without those that cannot be what their keys say."""
    return {
        key: value
        for key, value in plain_data.mapping(text).items()
        if is_like(known.get(key, value), value)
    }


def _is_name(text: str) -> bool:
    return text.isprintable() and len(text) <= NAME
