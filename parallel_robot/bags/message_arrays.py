"""Messages of the suite's topics as arrays."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import NamedTuple

import numpy as np

from parallel_robot.bags.bag_reader import Messages
from parallel_robot.bags.limits import KINDS, MESSAGE, is_name
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.messages import cdr, layouts, topics
from parallel_robot_model.messages.cdr_reader import Reader
from parallel_robot_model.messages.joint_layouts import OWN, joint_message
from parallel_robot_model.messages.topics import Topic

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
LOG = (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS, topics.ANSWERED)


class Samples(NamedTuple):
    """Decoded messages of a topic.

    Attributes:
        joints: Names in the messages; empty where the type has none.
        log_times: When they were recorded [ns], shape (N,).
        stamps: Stamps of their headers [ns], shape (N,); zero where the type has none.
        numbers: Fields by name, each shape (N, n), in the order of the joints.
    """

    joints: tuple[str, ...]
    log_times: np.ndarray
    stamps: np.ndarray
    numbers: dict[str, np.ndarray]

    def rows(self, chosen: np.ndarray) -> Samples:
        """Some of them, by their numbers or by a mask."""
        numbers = {name: values[chosen] for name, values in self.numbers.items()}
        return Samples(self.joints, self.log_times[chosen], self.stamps[chosen], numbers)


def decoder(bag: Path, chosen: Collection[Topic]) -> Callable[[Topic, Messages], list[Samples]]:
    """Function that decodes messages of a topic, by kind of message.

    It raises BagError when messages are not those of their topic.

    Args:
        bag: The bag, for error messages.
        chosen: Topics with numbers that are wanted; of others, it decodes the stamps.
    """
    kinds: dict[Topic, list[Kind]] = {}  # known so far, the last used first

    def decode(topic: Topic, messages: Messages) -> list[Samples]:
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
                first = messages.payloads[0, : MESSAGE + 1].tobytes()
                kind = _kind(bag, topic, first)
                same = _has_layout(messages.payloads, kind[0])
                known.append(kind)
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
    having = [part for part in parts if not part.joints or {*joints} & {*part.joints}]
    strange = sum(len(part.stamps) for part in parts) - sum(len(part.stamps) for part in having)
    if having and strange:
        others = [n for part in parts if not {*joints} & {*part.joints} for n in part.joints]
        names = ', '.join(dict.fromkeys(others))
        remarks.append(f'{strange} messages on {topic.name} are of other joints ({names})')
        parts = having
    total = sum(len(part.stamps) for part in parts)
    for field in MAY_LACK.get(topic, ()):
        having = [part for part in parts if _measured(part, field)]
        lacking = total - sum(len(part.stamps) for part in having)
        if having and 0 < lacking < FEW * total and len(having) < len(parts):
            remarks.append(
                f'{lacking} of {total} messages on {topic.name} have no {field}: another publisher'
            )
            parts = having
    return parts, [f'{remark}; they are left out' for remark in remarks]


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
        if field not in MAY_LACK.get(topic, ()) or all(_measured(part, field) for part in parts)
    )
    if not all({*fields} <= {*part.numbers} for part in parts):
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


def _measured(samples: Samples, field: str) -> bool:
    """Whether a field has a number for each joint, in at least one message."""
    return field in samples.numbers and bool(np.isfinite(samples.numbers[field]).all(axis=1).any())


def physical(samples: Samples) -> np.ndarray:
    """Which messages have numbers that a robot can have, shape (N,): finite and bounded."""
    kept = np.ones(len(samples.stamps), bool)
    for numbers in samples.numbers.values():
        if not (numbers.max() <= LARGEST and numbers.min() >= -LARGEST):  # nor with NaN
            kept &= (np.abs(numbers) <= LARGEST).all(axis=1)
    return kept


def _kind(bag: Path, topic: Topic, message: bytes) -> Kind:
    """Layout of messages like this one, and its joints."""
    try:
        if len(message) > MESSAGE:
            raise ValueError(f'a message of more than {MESSAGE} bytes')
        if topic.type == topics.POSE.type:
            return layouts.pose_stamped(topics.FRAME), ()
        if topic.type not in OWN:
            return ARRAYS[topic.type](len(Reader(message).array())), ()  # in the order of joints
        joints, _, layout = joint_message(topic.type, message)
        if not all(map(is_name, joints)):
            raise ValueError('the name of a joint is too long or cannot be printed')
    except ValueError as error:
        raise BagError(f'{bag}: {topic.name} is not understood: {error}') from None
    return layout(), joints


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
    return Samples(joints, messages.log_times, stamps, numbers)


def _order(bag: Path, topic: Topic, joints: tuple[str, ...], names: tuple[str, ...]) -> list[int]:
    """Index of each joint in the messages of a topic."""
    for joint in joints:
        if names.count(joint) != 1:
            raise BagError(f'{bag}: {topic.name} has no {joint}, only {", ".join(names)}')
    return [names.index(joint) for joint in joints]


def _header_stamps(topic: Topic, payloads: np.ndarray) -> np.ndarray:
    """Stamps of messages that begin with a header [ns], shape (N,); zero where there is none."""
    begin, stamp = len(cdr.ENCAPSULATION), np.dtype([('sec', '<i4'), ('nanosec', '<u4')])
    heads = np.ascontiguousarray(payloads[:, begin : begin + stamp.itemsize])
    if topic.every == 0 or heads.shape[1] < stamp.itemsize:
        return np.zeros(len(payloads), np.int64)
    return cdr.stamps_of(heads.view(stamp)[:, 0])
