"""Messages of the suite's topics as arrays."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.limits import KINDS, MESSAGE, is_name
from parallel_robot.bags.messages import planned_motion
from parallel_robot.bags.messages.message_types import Messages, little_endian
from parallel_robot.bags.messages.message_types import Samples as Samples
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import cdr, layouts, topics
from parallel_robot_model.messages.layouts import OWN, Reader, joint_message
from parallel_robot_model.messages.topics import ANSWERED, UNSTAMPED, Topic

Kind = tuple[cdr.Layout, tuple[str, ...]]  # and the joints
FIELDS = {
    topics.JOINT_STATES: ('position', 'velocity', 'effort'),
    topics.REFERENCE: ('position', 'velocity', 'acceleration'),
    topics.COMMANDS: ('data',),
}
MAY_LACK = {topics.JOINT_STATES: ('velocity', 'effort')}  # hardware that does not measure them
FEW = 0.2  # of the messages of a topic, which may be of another publisher
LARGEST = 1e12  # rad, rad/s, rad/s^2, N m; squares of it are still numbers
ARRAYS: dict[str, Callable[[int], cdr.Layout]] = {  # both have numbers of eight bytes
    'std_msgs/msg/Float64MultiArray': layouts.float64_multi_array,
    'std_msgs/msg/Int64MultiArray': layouts.int64_multi_array,
}
SHARED = (topics.JOINT_STATES, topics.REFERENCE)  # by robots, grippers and their publishers
LOG = (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS, topics.ANSWERED)


class Unstamped(Samples):
    """Samples whose headers have no stamp: when they were recorded stands in its place."""

    __slots__ = ()


class Broken(NamedTuple):
    """Messages that are not those of their topic, beside others that are: how many, and why."""

    number: int
    reason: str


def decoder(
    bag: Path, chosen: Collection[Topic], broken: dict[Topic, Broken] | None = None
) -> Callable[[Topic, Messages], list[Samples]]:
    """Function that decodes messages of a topic, by kind of message.

    It raises BagError when messages are not those of their topic.

    Args:
        bag: The bag, for error messages.
        chosen: Topics with numbers that are wanted; of others, it decodes the stamps.
        broken: Receives what it leaves out of topics that are SHARED, after or beside messages
            that it understood.
    """
    kinds: dict[Topic, list[Kind]] = {}  # known so far, the last used first

    def decode(topic: Topic, messages: Messages) -> list[Samples]:
        messages = little_endian(topic, messages)
        if topic not in chosen:
            return [Samples((), messages.log_times, _header_stamps(topic, messages.payloads), {})]
        decoded: list[Samples] = []
        known = kinds.setdefault(topic, [])
        while len(messages.payloads):
            for kind in known:
                same = _has_layout(messages.payloads, kind[0])
                if same.any():
                    break
            else:
                skipped, understood, reason = _next_kind(topic, messages.payloads)
                if skipped:
                    before = bool(known or decoded)
                    if broken is None or topic not in SHARED or not (understood or before):
                        raise BagError(f'{bag}: {topic.name} is not understood: {reason}')
                    left = broken[topic].number if topic in broken else 0
                    broken[topic] = Broken(left + skipped, reason)
                    messages = Messages(*(each[skipped:] for each in messages))
                if understood is None:
                    break
                kind = understood
                same = _has_layout(messages.payloads, kind[0])
                known.append(kind)
            if not same.any() and topic == topics.REFERENCE:
                known.remove(kind)
                try:
                    return decoded + planned_motion.samples(messages)
                except ValueError as error:
                    raise BagError(f'{bag}: {topic.name} is not understood: {error}') from None
            if not same.any() or len(known) > KINDS:
                raise BagError(f'{bag}: the messages on {topic.name} are not those of one run')
            known.remove(kind)
            known.insert(0, kind)
            alike = messages if same.all() else Messages(*(each[same] for each in messages))
            decoded.append(_samples(alike, *kind))
            messages = Messages(*(each[~same] for each in messages))
        return decoded

    return decode


def ours(
    topic: Topic, parts: list[Samples], joints: tuple[str, ...]
) -> tuple[list[Samples], list[str]]:
    """Leave out messages of other publishers: without our joints, or without what most have.

    Args:
        topic: Their topic.
        parts: Its messages.
        joints: Names of our joints.

    Returns:
        The messages that are left, and what was left out, one line each. Where none has our
        joints, all of them are left.
    """
    remarks = []
    unstamped = sum(len(part.stamps) for part in parts if isinstance(part, Unstamped))
    having = [part for part in parts if not part.joints or {*joints} & {*part.joints}]
    strange = sum(len(part.stamps) for part in parts) - sum(len(part.stamps) for part in having)
    if having and strange:
        others = [n for part in parts if not {*joints} & {*part.joints} for n in part.joints]
        names = ', '.join(dict.fromkeys(others))
        remarks.append(f'{strange} messages on {topic.name} are of other joints ({names})')
        parts = having
    total = sum(len(part.stamps) for part in parts)
    having = [part for part in parts if 'position' in part.numbers]
    if having and len(having) < len(parts) and topic == topics.JOINT_STATES:
        lacking = total - sum(len(part.stamps) for part in having)
        remarks.append(f'{lacking} of {total} messages on {topic.name} have no position')
        parts, total = having, total - lacking
    for field in MAY_LACK.get(topic, ()):
        having = [part for part in parts if _measured(part, field, joints)]
        lacking = total - sum(len(part.stamps) for part in having)
        if having and 0 < lacking < FEW * total and len(having) < len(parts):
            remarks.append(
                f'{lacking} of {total} messages on {topic.name} have no {field}: another publisher'
            )
            parts = having
    told = [f'{remark}; they are left out' for remark in remarks]
    if unstamped:
        what = f'{unstamped} messages on {topic.name} have no stamp'
        told.append(f'{what}: when they were recorded counts')
    return parts, told


def whole(bag: Path, topic: Topic, parts: list[Samples], joints: tuple[str, ...]) -> Samples:
    """Samples of a topic in the order of their log time, numbers in the order of `joints`.

    A field that may lack is left out where it is not in all of them, or never a number.

    Raises:
        BagError: a joint or a field is not in all of them.
    """
    fields = FIELDS.get(topic, ('position',))
    fields = tuple(
        field
        for field in fields
        if field not in MAY_LACK.get(topic, ())
        or all(_measured(part, field, joints) for part in parts)
    )
    if not all({*fields} <= {*part.numbers} for part in parts):
        lacking = [name for name in fields if not any(name in part.numbers for part in parts)]
        if lacking:
            having = ' and '.join(sorted({name for part in parts for name in part.numbers}))
            what = f'have {having or "names"} alone, no {" and no ".join(lacking)}'
            raise BagError(f'{bag}: messages on {topic.name} {what}')
        raise BagError(f'{bag}: not all messages on {topic.name} have {", ".join(fields)}')
    if topic == topics.COMMANDS:
        widths = {part.numbers['data'].shape[1] for part in parts} - {len(joints)}
        if widths:
            what = f'{min(widths)} numbers for {len(joints)} joints'
            raise BagError(f'{bag}: messages on {topic.name} have {what}')
        orders = [[*range(len(joints))] for _ in parts]
    else:
        orders = [_order(bag, topic, joints, part.joints) for part in parts]
    times = np.concatenate([part.log_times for part in parts])
    by_time = np.argsort(times, kind='stable')
    pairs = [*zip(parts, orders, strict=True)]
    return Samples(
        joints,
        times[by_time],
        np.concatenate([part.stamps for part in parts])[by_time],
        {
            name: np.concatenate([part.numbers[name][:, order] for part, order in pairs])[by_time]
            for name in fields
        },
    )


def _measured(samples: Samples, field: str, joints: tuple[str, ...]) -> bool:
    """Whether a field has a number for each of our joints, in at least one message."""
    if field not in samples.numbers:
        return False
    own = [name in joints for name in samples.joints]
    return bool(np.isfinite(samples.numbers[field][:, own]).all(axis=1).any())


def physical(samples: Samples) -> np.ndarray:
    """Which messages have numbers that a robot can have, shape (N,): finite and bounded."""
    kept = np.ones(len(samples.stamps), bool)
    for numbers in samples.numbers.values():
        if not (numbers.max() <= LARGEST and numbers.min() >= -LARGEST):  # nor with NaN
            kept &= (np.abs(numbers) <= LARGEST).all(axis=1)
    return kept


def strange(samples: Samples) -> str:
    """Where most messages have a number that no robot can have, in words; see :func:`physical`."""
    counts = {
        (field, joint): int((~(np.abs(column) <= LARGEST)).sum())
        for field, numbers in samples.numbers.items()
        for joint, column in zip(samples.joints, numbers.T, strict=True)
    }
    field, joint = max(counts, key=lambda each: counts[each])
    column = samples.numbers[field][:, samples.joints.index(joint)]
    number = column[~(np.abs(column) <= LARGEST)][0]
    return f'{field} of {joint} is {number:.4g} in {counts[field, joint]} of {len(column)}'


def _next_kind(topic: Topic, payloads: np.ndarray) -> tuple[int, Kind | None, str]:
    """The first kind that is understood: number of messages before it, it, and why not they."""
    reason = ''
    for k, row in enumerate(payloads):
        message = row[: MESSAGE + 1].tobytes()
        try:
            kind = _kind(topic, message)
            if topic == topics.JOINT_STATES and not _has_layout(row[np.newaxis], kind[0]).any():
                raise ValueError(_uneven(message))
        except ValueError as error:
            reason = reason or str(error)
        else:
            return k, kind, reason
    return len(payloads), None, reason


def _kind(topic: Topic, message: bytes) -> Kind:
    """Layout of messages like this one, and its joints."""
    if len(message) > MESSAGE:
        raise ValueError(f'a message of more than {MESSAGE} bytes')
    if topic.type == topics.POSE.type:
        return layouts.pose_stamped(topics.FRAME), ()
    if topic.type not in OWN:
        return ARRAYS[topic.type](len(Reader(message).array())), ()  # in the order of joints
    joints, _, layout = joint_message(topic.type, message)
    if not all(map(is_name, joints)):
        raise ValueError('the name of a joint is too long or cannot be printed')
    if topic == topics.JOINT_STATES and not joints:
        raise ValueError('it names no joints')
    return layout(), joints


def _uneven(message: bytes) -> str:
    """What is wrong with joint states whose fields are not of one length."""
    reader = Reader(message)
    reader.header()
    names = len(reader.texts())
    counts = [f'{len(reader.numbers())} {plural}' for plural in ('positions', 'velocities')]
    told = f'{", ".join(counts)} and {len(reader.numbers())} efforts'
    return f'it has {told} for {names} joints; each must be as many, or none'


def _has_layout(payloads: np.ndarray, layout: cdr.Layout) -> np.ndarray:
    """Which messages are of a layout, shape (N,)."""
    length = payloads.shape[1]
    if not len(layout.template) <= length < len(layout.template) + cdr.SPARE:
        return np.zeros(len(payloads), bool)
    same = np.ones(len(payloads), bool)
    for run in np.split(layout.constants, np.flatnonzero(np.diff(layout.constants) != 1) + 1):
        kind = np.dtype((np.void, len(run)))
        found = payloads.view((np.void, length)).getfield(kind, run[0])
        same &= found[:, 0] == layout.template[run].view(kind)
    return same


def _samples(messages: Messages, layout: cdr.Layout, joints: tuple[str, ...]) -> Samples:
    whole = np.ascontiguousarray(messages.payloads[:, : len(layout.template)])
    records = whole.view(layout.dtype)[:, 0]
    stamps = cdr.stamps_of(records) if layout.stamped else np.zeros(len(records), np.int64)
    names = [name for name in layout.dtype.names or () if name not in ('sec', 'nanosec')]
    numbers = {name: np.ascontiguousarray(records[name]) for name in names}
    if layout.stamped and joints and not stamps.any():
        return Unstamped(joints, messages.log_times, messages.log_times, numbers)
    return Samples(joints, messages.log_times, stamps, numbers)


def _order(bag: Path, topic: Topic, joints: tuple[str, ...], names: tuple[str, ...]) -> list[int]:
    """Index of each joint in the messages of a topic."""
    for joint in joints:
        if names.count(joint) > 1:
            raise BagError(f'{bag}: {topic.name} names {joint} twice: {", ".join(names)}')
        if joint not in names:
            there = f'a message on {topic.name} has no {joint}, only {", ".join(names)}'
            raise BagError(f'{bag}: {there}; --joints names them, --scenario the robot')
    return [names.index(joint) for joint in joints]


def _header_stamps(topic: Topic, payloads: np.ndarray) -> np.ndarray:
    """Stamps of messages that begin with a header [ns], shape (N,); zero where there is none."""
    begin, stamp = len(cdr.ENCAPSULATION), np.dtype([('sec', '<i4'), ('nanosec', '<u4')])
    heads = np.ascontiguousarray(payloads[:, begin : begin + stamp.itemsize])
    if topic.every == 0 or heads.shape[1] < stamp.itemsize:
        return np.zeros(len(payloads), np.int64)
    return cdr.stamps_of(heads.view(stamp)[:, 0])


# A part of a run: between which stamps, and between which log times where there are none.

FIRST, LAST = -(1 << 62), 1 << 62  # before and after all stamps and log times [ns]


class Span(NamedTuple):
    """A part of a run."""

    begin: int = FIRST  # first stamp [ns]
    end: int = LAST  # the stamp after the last [ns]
    begin_heard: int = FIRST  # first log time of messages without a stamp [ns]
    end_heard: int = LAST  # the log time after their last [ns]

    def holds(self, topic: Topic, messages: Samples) -> np.ndarray:
        """Which messages of a topic are of this part, shape (N,)."""
        if topic.every and topic.type not in (*UNSTAMPED, ANSWERED.type):
            return (messages.stamps >= self.begin) & (messages.stamps < self.end)
        return (messages.log_times >= self.begin_heard) & (messages.log_times < self.end_heard)


WHOLE = Span()
