"""What a bag says of its experiment beside the motion: statuses, changes, laws, losses."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import yaml
from rosbags.typesys import Stores, get_typestore

from parallel_robot_analysis.bags import bag_reader
from parallel_robot_analysis.bags.bag_reader import Messages
from parallel_robot_analysis.bags.bag_writer import CHANGES, LAWS, MESSAGES, PARAMETERS
from parallel_robot_interface import cdr, config
from parallel_robot_interface.topics import STATUS, Topic

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

    def own_laws(self, directory: Path) -> list[str]:
        """Write the sources of the laws of one's own into a directory; returns the files."""
        files = []
        for name, source in self.laws.items():
            file = directory / f'{Path(name).name}.py'
            file.write_bytes(source)
            files.append(str(file))
        return files


def read(bag: Path) -> History:
    """Read what a bag says; what is not there or not understood is left out.

    Raises:
        BagError: not a bag.
    """
    found = bag_reader.read(bag, (STATUS,), _statuses)
    statuses = [said for parts in found.streams.values() for part in parts for said in part]
    parameters: dict[str, dict[str, Any]] = {}
    for note in found.notes.get(PARAMETERS, []):
        parameters |= {node: _mapping(text) for node, text in note.items()}
    changes = []
    for note in found.notes.get(CHANGES, []):
        if note.get('stamp', '').isdigit():
            values = _mapping(note.get('values', ''))
            changes.append(Change(int(note['stamp']), note.get('node', ''), values))
    lost = {}
    for note in found.notes.get(MESSAGES, []):
        for topic, text in note.items():
            number = text.rpartition('lost ')[2]
            lost[topic] = int(number) if number.isdigit() else 0
    laws = {
        name.removeprefix(LAWS): data
        for name, data in found.attachments.items()
        if name.startswith(LAWS)
    }
    return History(found.metadata, tuple(sorted(statuses)), parameters, tuple(changes), laws, lost)


def remarks(history: History, start: int) -> list[str]:
    """What a user should know of a run: limits that acted, a fault.

    Args:
        history: Of the run.
        start: Stamp of t = 0 [ns].
    """
    names = {name for said in history.statuses for name in said.limits.split(', ')} - {NOTHING}
    first = next((said for said in history.statuses if said.fault != NOTHING), None)
    fault = ((first.stamp - start) / cdr.NANOSECONDS, first.fault) if first else None
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


def _statuses(_: Topic, messages: Messages) -> list[Said]:
    found = []
    for row in messages.payloads:
        try:
            message: Any = STORE.deserialize_cdr(row.tobytes(), STATUS.type)
            values = {item.key: item.value for item in message.status[0].values}
            stamp = message.header.stamp.sec * cdr.NANOSECONDS + message.header.stamp.nanosec
            found.append(Said(stamp, values['law'], values['fault'], values['limits that acted']))
        except Exception:  # broken, or somebody else's topic of the same name
            continue
    return found


def _mapping(text: str) -> dict[str, Any]:
    try:
        found = yaml.load(text, config.LOADER)
    except yaml.YAMLError:
        return {}
    return found if isinstance(found, dict) else {}
