"""A bag as time-aligned arrays."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from rosbags.typesys import Stores, get_typestore

from parallel_robot_analysis.bags import bag_reader
from parallel_robot_analysis.bags.bag_reader import Messages
from parallel_robot_analysis.bags.bag_writer import METADATA
from parallel_robot_interface import cdr, config, topics
from parallel_robot_interface.errors import BagError, InputError
from parallel_robot_interface.loop import LoopParameters
from parallel_robot_interface.topics import RECORDED, Topic

NOTHING = np.zeros((0, 0))
STORE = get_typestore(Stores.ROS2_JAZZY)  # kept: it compiles what it decodes
KINDS = 100  # how many kinds of messages a topic may have: joints and their order
REFERENCE_FIELDS = ('position', 'velocity', 'acceleration')


@dataclass(frozen=True)
class TopicCount:
    """Messages of a topic.

    Attributes:
        count: How many the bag holds.
        missing: How many its rhythm lacks, from the first to the last of the motion.
    """

    count: int
    missing: int


class RunLog(NamedTuple):
    """A recorded run, one row a state, the reference at the state's own stamp.

    Attributes:
        scenario: Name of the scenario.
        law: Name of the law.
        joints: Names of the actuated joints.
        config: The resolved configuration.
        start_stamp: Stamp of t = 0 [ns].
        stamps: Stamps of the states [ns], shape (N,).
        time: Stamps since t = 0 [s], shape (N,).
        position: Measured actuated angles [rad], shape (N, n).
        velocity: Measured actuated rates [rad/s], shape (N, n).
        effort: Torques applied during the step that ended at the stamp [N m], shape (N, n).
        reference_position: Desired angles [rad], shape (N, n).
        reference_velocity: Desired rates [rad/s], shape (N, n).
        reference_acceleration: Desired accelerations [rad/s^2], shape (N, n).
        command: Commanded torques in the order of the messages [N m], shape (M, n).
        messages: Counts per topic, by name without leading slash.
        answer: Command that answered each state [N m], NaN where there is none, shape (N, n).
        warnings: What is wrong with the bag, one line each.
    """

    scenario: str
    law: str
    joints: tuple[str, ...]
    config: dict[str, Any]
    start_stamp: int
    stamps: np.ndarray
    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray
    reference_position: np.ndarray
    reference_velocity: np.ndarray
    reference_acceleration: np.ndarray
    command: np.ndarray
    messages: dict[str, TopicCount]
    answer: np.ndarray = NOTHING
    warnings: tuple[str, ...] = ()


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


def read(bag: Path) -> RunLog:
    """Read a bag of the nodes, of a simulation, or of any recorder that heard the suite's topics.

    What is damaged is left out, and said in `warnings`.

    Args:
        bag: Directory of the bag, or its MCAP file.

    Raises:
        BagError: not a bag, or a topic that the log needs is not in it.
    """
    found = bag_reader.read(bag, RECORDED, _decoder(bag))
    streams = _streams(bag, found.streams)
    for needed in (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS):
        if needed not in streams:
            raise BagError(f'{bag} has no messages on {needed.name}')
    values, loop, start = _configuration(bag, found.metadata)
    states, references, commands = (
        _whole(bag, topic, streams[topic], loop.joints)
        for topic in (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)
    )
    start = start or int(max(states.stamps[0], references.stamps[0]))
    used = (states.stamps >= start) & (states.stamps >= references.stamps[0])
    if not used.any():
        raise BagError(f'{bag}: no state has a reference at or before its stamp')
    stamps = states.stamps[used]
    return RunLog(
        loop.scenario if found.metadata else 'unknown',
        loop.law if found.metadata else 'unknown',
        loop.joints,
        values,
        start,
        stamps,
        (stamps - start) / cdr.NANOSECONDS,
        states.numbers['position'][used],
        states.numbers['velocity'][used],
        states.numbers['effort'][used],
        *reference_at(
            stamps, references.stamps, *(references.numbers[name] for name in REFERENCE_FIELDS)
        ),
        commands.numbers['data'],
        _counts(streams, loop.period_ns),
        _answers(states.log_times, commands)[used],
        found.warnings,
    )


def columns(log: RunLog) -> dict[str, np.ndarray]:
    """A run as columns, one row a state: name with unit to numbers, shape (N,)."""
    quantities = {
        'position_rad': log.position,
        'velocity_rad_per_s': log.velocity,
        'effort_nm': log.effort,
        'reference_position_rad': log.reference_position,
        'reference_velocity_rad_per_s': log.reference_velocity,
        'reference_acceleration_rad_per_s2': log.reference_acceleration,
        'command_nm': log.answer,
    }
    return {'time_s': log.time, 'stamp_ns': log.stamps} | {
        f'{joint}_{quantity}': numbers[:, k]
        for quantity, numbers in quantities.items()
        for k, joint in enumerate(log.joints)
    }


def to_frame(log: RunLog) -> Any:
    """A run as a pandas DataFrame, see :func:`columns`.

    Raises:
        InputError: pandas is not installed.
    """
    try:
        import pandas  # optional
    except ImportError:
        raise InputError('pandas is not installed; pip install pandas') from None
    return pandas.DataFrame(columns(log))


def _configuration(
    bag: Path, metadata: dict[str, str]
) -> tuple[dict[str, Any], LoopParameters, int]:
    """Configuration of the run over the defaults, so that bags of older versions stay readable.

    Returns:
        All keys, those of the loop, and the stamp of t = 0 [ns], 0 when it is not known.
    """
    values = config.resolve('paper_circle')
    if not metadata:
        values = values | {'scenario': 'unknown', 'law': 'unknown'}
    try:
        if metadata:
            stored = yaml.load(metadata['config'], config.LOADER)
            values = values | {str(key): value for key, value in stored.items()}
        start = int(metadata.get('start_stamp', 0))
        return values, config.group(values, LoopParameters, ''), start
    except (AttributeError, KeyError, ValueError, InputError, yaml.YAMLError):
        raise BagError(f'{bag}: its metadata {METADATA} hold no usable config') from None


def _streams(bag: Path, found: dict[str, list[list[Samples]]]) -> dict[Topic, list[Samples]]:
    """Streams of the suite's topics, all in one namespace.

    Raises:
        BagError: the states of several robots are there.
    """
    end = f'/{topics.JOINT_STATES.name}'
    spaces = [name.removesuffix(end) for name in found if name.endswith(end)]
    if len(spaces) > 1 and '' not in spaces:
        raise BagError(f'{bag} holds several runs, in {", ".join(sorted(spaces))}')
    space = '' if '' in spaces or not spaces else spaces[0]
    streams = {topic: found.get(f'{space}/{topic.name}', []) for topic in RECORDED}
    return {topic: [*itertools.chain(*parts)] for topic, parts in streams.items() if parts}


def _decoder(bag: Path) -> Callable[[Topic, Messages], list[Samples]]:
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


def _whole(bag: Path, topic: Topic, parts: list[Samples], joints: tuple[str, ...]) -> Samples:
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


def _command_layout(message: Any) -> tuple[cdr.Layout, tuple[str, ...]]:
    return cdr.float64_multi_array(len(message.data)), ()  # in the order of the joints


LAYOUTS = {
    topics.JOINT_STATES: _state_layout,
    topics.REFERENCE: _reference_layout,
    topics.COMMANDS: _command_layout,
}


def _order(bag: Path, topic: Topic, joints: tuple[str, ...], names: tuple[str, ...]) -> list[int]:
    """Where each joint stands in the messages of a topic."""
    if topic == topics.COMMANDS:
        return list(range(len(joints)))
    for joint in joints:
        if names.count(joint) != 1:
            raise BagError(f'{bag}: {topic.name} has no {joint}, only {", ".join(names)}')
    return [names.index(joint) for joint in joints]


def reference_at(
    stamps: np.ndarray,
    known: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    acceleration: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Extrapolate references to other stamps, each from the newest before with its derivatives.

    Args:
        stamps: Where they are wanted, none before the first that is known [ns], shape (N,).
        known: Stamps of the references, in order [ns], shape (M,).
        position: Joint angles [rad], shape (M, n).
        velocity: Their rates [rad/s], shape (M, n).
        acceleration: Their accelerations [rad/s^2], shape (M, n).
    """
    newest = np.searchsorted(known, stamps, side='right') - 1
    dt = ((stamps - known[newest]) / cdr.NANOSECONDS)[:, np.newaxis]
    position, velocity, acceleration = position[newest], velocity[newest], acceleration[newest]
    return (
        position + dt * velocity + 0.5 * dt * dt * acceleration,
        velocity + dt * acceleration,
        acceleration,
    )


def _answers(heard: np.ndarray, commands: Samples) -> np.ndarray:
    """Command that answered each state, NaN where there is none, shape (N, n).

    The k-th answers the k-th, but for zeros that the controller sent unasked: at its end, or when
    states stayed away. Where some of either are lost, a command answers the newest state that was
    recorded before it, which is exact in lockstep.

    Args:
        heard: Log times of the states [ns], shape (N,).
        commands: The commands.
    """
    torques = commands.numbers['data']
    zeros = np.flatnonzero(~torques.any(axis=1))
    if 0 < len(torques) - len(heard) <= len(zeros):
        torques = np.delete(torques, zeros[len(heard) - len(torques) :], axis=0)
    if len(torques) == len(heard):
        return torques
    answers = np.full((len(heard), torques.shape[1]), np.nan)
    newest = np.searchsorted(heard, commands.log_times, side='right') - 1
    answers[newest[newest >= 0]] = torques[newest >= 0]
    return answers


def _counts(streams: dict[Topic, list[Samples]], period: int) -> dict[str, TopicCount]:
    """Messages of each topic, and the gaps of its rhythm; `period` in ns."""
    counts: dict[str, TopicCount] = {}
    for topic, parts in streams.items():
        stamps = np.sort(np.concatenate([part.stamps for part in parts]))
        missing = 0
        if topic == topics.COMMANDS:
            states = counts[topics.JOINT_STATES.name]
            missing = max(0, states.count + states.missing - len(stamps))
        elif topic.every:
            steps = np.diff(stamps) / (topic.every * period)
            missing = int(np.maximum(np.rint(steps) - 1, 0).sum())
        counts[topic.name] = TopicCount(len(stamps), missing)
    return counts


def _header_stamps(topic: Topic, payloads: np.ndarray) -> np.ndarray:
    """Stamps of messages that begin with a header [ns], shape (N,); zero where there is none."""
    begin, stamp = len(cdr.ENCAPSULATION), np.dtype([('sec', '<i4'), ('nanosec', '<u4')])
    heads = np.ascontiguousarray(payloads[:, begin : begin + stamp.itemsize])
    if topic.every == 0 or heads.shape[1] < stamp.itemsize:
        return np.zeros(len(payloads), np.int64)
    return cdr.stamps_of(heads.view(stamp)[:, 0])
