"""A bag as time-aligned arrays."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from mcap.reader import make_reader
from rosbags.typesys import Stores, get_typestore

from parallel_robot_analysis.bag_reader import files
from parallel_robot_analysis.bag_writer import METADATA
from parallel_robot_interface import cdr, config, topics
from parallel_robot_interface.errors import BagError
from parallel_robot_interface.topics import RECORDED, Topic

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


def read(bag: Path) -> RunLog:
    """Read a bag of the nodes or of a simulation.

    Args:
        bag: Directory of the bag, or its MCAP file.

    Raises:
        BagError: not a bag, or a topic that the log needs is not in it.
    """
    data, metadata = _read_messages(bag)
    for needed in (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS):
        if not data[needed]:
            raise BagError(f'{bag} has no messages on {needed.name}')
    values = _configuration(bag, metadata)
    references, desired = _decode(bag, topics.REFERENCE, data[topics.REFERENCE])
    joints = tuple(values['joints'])
    states, measured = _decode(bag, topics.JOINT_STATES, data[topics.JOINT_STATES])
    commands, _ = _decode(bag, topics.COMMANDS, data[topics.COMMANDS])
    in_states = _order(bag, topics.JOINT_STATES, joints, measured)
    in_references = _order(bag, topics.REFERENCE, joints, desired)
    stamps, reference_stamps = cdr.stamps_of(states), cdr.stamps_of(references)
    start = int(metadata.get('start_stamp', 0)) or int(max(stamps[0], reference_stamps[0]))
    used = (stamps >= start) & (stamps >= reference_stamps[0])
    if not used.any():
        raise BagError(f'{bag}: no state has a reference at or before its stamp')
    states, stamps = states[used], stamps[used]
    period = round(values['period'] * cdr.NANOSECONDS)
    counted = {}
    for topic in RECORDED:
        if data[topic]:
            counted[topic.name] = _count(topic, data[topic], len(states), period)
    return RunLog(
        values['scenario'],
        values['law'],
        joints,
        values,
        start,
        stamps,
        (stamps - start) / cdr.NANOSECONDS,
        states['position'][:, in_states],
        states['velocity'][:, in_states],
        states['effort'][:, in_states],
        *reference_at(
            stamps,
            reference_stamps,
            *(references[name][:, in_references] for name in REFERENCE_FIELDS),
        ),
        commands['data'].copy(),
        counted,
    )


def _configuration(bag: Path, metadata: dict[str, str]) -> dict[str, Any]:
    """Configuration of the run over the defaults, so that bags of older versions stay readable."""
    values = config.resolve('paper_circle')
    if not metadata:
        return values | {'scenario': 'unknown', 'law': 'unknown'}
    try:
        stored = yaml.safe_load(metadata['config'])
        return values | dict(stored)
    except (KeyError, TypeError, ValueError, yaml.YAMLError):
        raise BagError(f'{bag}: its metadata {METADATA} hold no usable config') from None


def _read_messages(bag: Path) -> tuple[dict[Topic, list[bytes]], dict[str, str]]:
    """All messages of the suite's topics, in order, and the metadata of the experiment."""
    by_name = {f'/{topic.name}': topic for topic in RECORDED}
    data: dict[Topic, list[bytes]] = defaultdict(list)
    metadata: dict[str, str] = {}
    for file in files(bag):
        try:
            with file.open('rb') as stream:
                reader = make_reader(stream)
                for record in reader.iter_metadata():
                    if record.name == METADATA:
                        metadata = record.metadata
                for _, channel, message in reader.iter_messages(topics=list(by_name)):
                    data[by_name[channel.topic]].append(message.data)
        except Exception as error:  # in a broken file, any length or string can be wrong
            reason = str(error) or type(error).__name__
            raise BagError(f'{file} cannot be read: {reason}') from None
    return data, metadata


def _decode(bag: Path, topic: Topic, messages: list[bytes]) -> tuple[np.ndarray, tuple[str, ...]]:
    """Records of messages that all have the layout of the first, and the names in them."""
    try:
        first = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(messages[0], topic.type)
        layout, names = LAYOUTS[topic](first)
        records = layout.decode(b''.join(messages), len(messages))
    except Exception as error:  # in broken bytes, any length or string can be wrong
        raise BagError(f'{bag}: {topic.name} is not understood: {error}') from None
    if records is None:
        raise BagError(f'{bag}: the messages on {topic.name} differ in joints or lengths')
    return records, names


def _state_layout(message: Any) -> tuple[cdr.Layout, tuple[str, ...]]:
    names = tuple(message.name)
    return cdr.joint_state(names, frame=message.header.frame_id), names


def _reference_layout(message: Any) -> tuple[cdr.Layout, tuple[str, ...]]:
    names = tuple(message.joint_names)
    return cdr.joint_trajectory(names, message.header.frame_id), names


def _command_layout(message: Any) -> tuple[cdr.Layout, tuple[str, ...]]:
    return cdr.float64_multi_array(len(message.data)), ()


LAYOUTS = {
    topics.JOINT_STATES: _state_layout,
    topics.REFERENCE: _reference_layout,
    topics.COMMANDS: _command_layout,
}


def _order(bag: Path, topic: Topic, joints: tuple[str, ...], names: tuple[str, ...]) -> list[int]:
    """Where each joint stands in the messages of a topic."""
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
        position + dt * velocity + 0.5 * dt**2 * acceleration,
        velocity + dt * acceleration,
        acceleration,
    )


def _count(topic: Topic, messages: list[bytes], states: int, period: int) -> TopicCount:
    """Count messages and the gaps of their rhythm."""
    if topic.every == 0:
        return TopicCount(len(messages), 0)
    if topic == topics.COMMANDS:
        return TopicCount(len(messages), max(0, states - len(messages)))
    stamps = np.array([cdr.header_stamp(message) or 0 for message in messages])
    steps = np.rint(np.diff(stamps) / (topic.every * period)).astype(int)
    return TopicCount(len(messages), int(np.maximum(steps - 1, 0).sum()))
