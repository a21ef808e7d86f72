"""Messages of the suite's topics as arrays."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.typesys import Stores, get_typestore

from parallel_robot_analysis.bags.bag_reader import Messages
from parallel_robot_interface import cdr, topics
from parallel_robot_interface.errors import BagError
from parallel_robot_interface.topics import Topic

STORE = get_typestore(Stores.ROS2_JAZZY)  # kept: it compiles what it decodes
KINDS = 100  # how many kinds of messages a topic may have: joints and their order


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


def decoder(bag: Path) -> Callable[[Topic, Messages], list[Samples]]:
    """Function that decodes messages of a topic, by kind of message.

    Of the topics that only are counted, it decodes the stamps. It raises BagError when messages
    are not those of their topic.
    """
    kinds: dict[Topic, tuple[cdr.Layout, tuple[str, ...]]] = {}  # of the newest messages

    def decode(topic: Topic, messages: Messages) -> list[Samples]:
        if topic not in LAYOUTS:
            return [Samples((), messages.log_times, _header_stamps(topic, messages.payloads), {})]
        decoded: list[Samples] = []
        while len(messages.payloads):
            same = np.zeros(len(messages.payloads), bool)
            if topic in kinds:
                same = _has_layout(messages.payloads, kinds[topic][0])
            if not same.any():
                kinds[topic] = _layout(bag, topic, messages.payloads[0].tobytes())
                same = _has_layout(messages.payloads, kinds[topic][0])
            if not same.any() or len(decoded) == KINDS:
                raise BagError(f'{bag}: the messages on {topic.name} are not those of one run')
            alike = messages if same.all() else Messages(*(each[same] for each in messages))
            decoded.append(_samples(alike, *kinds[topic]))
            messages = Messages(*(each[~same] for each in messages))
        return decoded

    return decode


def whole(bag: Path, topic: Topic, parts: list[Samples], joints: tuple[str, ...]) -> Samples:
    """Samples of a topic in the order of their log time, numbers in the order of `joints`.

    Raises:
        BagError: a joint or a field is not in all of them.
    """
    fields = tuple(parts[0].numbers)
    if any(tuple(part.numbers) != fields for part in parts):
        raise BagError(f'{bag}: the messages on {topic.name} differ in their fields')
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


def _layout(bag: Path, topic: Topic, message: bytes) -> tuple[cdr.Layout, tuple[str, ...]]:
    try:
        first = STORE.deserialize_cdr(message, topic.type)
        return LAYOUTS[topic](first)
    except Exception as error:  # in broken bytes, any length or string can be wrong
        raise BagError(f'{bag}: {topic.name} is not understood: {error}') from None


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


def _state_layout(message: Any) -> tuple[cdr.Layout, tuple[str, ...]]:
    names = tuple(message.name)
    return cdr.joint_state(names, frame=message.header.frame_id), names


def _reference_layout(message: Any) -> tuple[cdr.Layout, tuple[str, ...]]:
    names = tuple(message.joint_names)
    return cdr.joint_trajectory(names, message.header.frame_id), names


def _numbers_layout(message: Any) -> tuple[cdr.Layout, tuple[str, ...]]:
    return cdr.float64_multi_array(len(message.data)), ()  # in the order of the joints


def _stamps_layout(message: Any) -> tuple[cdr.Layout, tuple[str, ...]]:
    return cdr.int64_multi_array(len(message.data)), ()


LAYOUTS = {
    topics.JOINT_STATES: _state_layout,
    topics.REFERENCE: _reference_layout,
    topics.COMMANDS: _numbers_layout,
    topics.ANSWERED: _stamps_layout,
}


def _order(bag: Path, topic: Topic, joints: tuple[str, ...], names: tuple[str, ...]) -> list[int]:
    """Where each joint stands in the messages of a topic."""
    if topic == topics.COMMANDS:
        return list(range(len(joints)))
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
