"""Messages of the suite's topics as arrays."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore

from parallel_robot_bags.bag_reader import Messages
from parallel_robot_bags.limits import KINDS, MESSAGE, is_name
from parallel_robot_base import cdr, layouts, topics
from parallel_robot_base.errors import BagError
from parallel_robot_base.topics import Topic

Kind = tuple[cdr.Layout, tuple[str, ...]]  # and the joints
LayoutOf = Callable[[Any], Kind]  # from a decoded message
FIELDS = {
    topics.JOINT_STATES: ('position', 'velocity', 'effort'),
    topics.REFERENCE: ('position', 'velocity', 'acceleration'),
    topics.COMMANDS: ('data',),
}
LARGEST = 1e12  # rad, rad/s, rad/s^2, N m; squares of it are still numbers
STORE = get_typestore(Stores.ROS2_JAZZY)  # kept: it compiles what it decodes


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


def decoder(
    bag: Path, chosen: Mapping[Topic, LayoutOf] | None = None
) -> Callable[[Topic, Messages], list[Samples]]:
    """Function that decodes messages of a topic, by kind of message.

    Of topics without a layout, it decodes the stamps. It raises BagError when messages are not
    those of their topic.

    Args:
        bag: The bag, for error messages.
        chosen: How to find the layout of a topic's messages from one of them; None: LAYOUTS.
    """
    layout_of = LAYOUTS if chosen is None else chosen
    kinds: dict[Topic, list[Kind]] = {}  # known so far, the last used first

    def decode(topic: Topic, messages: Messages) -> list[Samples]:
        if topic not in layout_of:
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
                kind = _kind(bag, topic, first, layout_of[topic])
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


def whole(bag: Path, topic: Topic, parts: list[Samples], joints: tuple[str, ...]) -> Samples:
    """Samples of a topic in the order of their log time, numbers in the order of `joints`.

    Raises:
        BagError: a joint or a field is not in all of them.
    """
    fields = FIELDS.get(topic, ('position',))
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


def physical(samples: Samples) -> np.ndarray:
    """Which messages have numbers that a robot can have, shape (N,): finite and bounded."""
    kept = np.ones(len(samples.stamps), bool)
    for numbers in samples.numbers.values():
        if not (numbers.max() <= LARGEST and numbers.min() >= -LARGEST):  # nor with NaN
            kept &= (np.abs(numbers) <= LARGEST).all(axis=1)
    return kept


def _kind(bag: Path, topic: Topic, message: bytes, layout_of: LayoutOf) -> Kind:
    try:
        if len(message) > MESSAGE:
            raise ValueError(f'a message of more than {MESSAGE} bytes')
        layout, joints = layout_of(STORE.deserialize_cdr(message, topic.type))
        if not all(map(is_name, joints)):
            raise ValueError('the name of a joint is too long or cannot be printed')
    except Exception as error:  # in broken bytes, any length or string can be wrong
        raise BagError(f'{bag}: {topic.name} is not understood: {error}') from None
    return layout, joints


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


def _state_layout(message: Any) -> Kind:
    names = tuple(message.name)
    return layouts.joint_state(names, frame=message.header.frame_id), names


def _reference_layout(message: Any) -> Kind:
    names = tuple(message.joint_names)
    return layouts.joint_trajectory(names, message.header.frame_id), names


def _numbers_layout(message: Any) -> Kind:
    return layouts.float64_multi_array(len(message.data)), ()  # in the order of the joints


def _stamps_layout(message: Any) -> Kind:
    return layouts.int64_multi_array(len(message.data)), ()


def error_layout(message: Any) -> Kind:
    """Layout of telemetry: a position for each joint, and any other fields."""
    fields = tuple(name for name in FIELDS[topics.JOINT_STATES] if len(getattr(message, name)))
    names = tuple(message.name)
    return layouts.joint_state(names, fields, message.header.frame_id), names


LAYOUTS: dict[Topic, LayoutOf] = {
    topics.JOINT_STATES: _state_layout,
    topics.REFERENCE: _reference_layout,
    topics.COMMANDS: _numbers_layout,
    topics.ANSWERED: _stamps_layout,
}


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
