"""Which topics of a bag are those of a run, and what is said of one that is not there."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from parallel_robot.bags.messages.message_arrays import Samples
from parallel_robot.bags.reading.bag_reader import Bag
from parallel_robot.bags.reading.bag_view import AS_RECORDED, INSTEAD, BagView
from parallel_robot_model.common.errors import BagError, printable
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import RECORDED, Topic

FEW = 5  # topics of a bag that are named
NEEDED = (topics.JOINT_STATES, topics.REFERENCE, topics.COMMANDS)


def streams_of(
    bag: Path,
    found: Mapping[str, Sequence[Sequence[Samples]]],
    view: BagView = AS_RECORDED,
) -> dict[Topic, list[Samples]]:
    """Streams of the suite's topics, all in one namespace but for those that were chosen.

    Args:
        bag: The bag, for error messages.
        found: Messages by full name of the topic.
        view: Which topics take the place of others, and which namespace is wanted.

    Raises:
        BagError: those of several robots are there, or none of the one that is wanted.
    """
    spaces: list[str] = []
    for topic in NEEDED:  # the first that is there says where the others are
        end = f'/{topic.name}'
        spaces = [name.removesuffix(end) for name in found if name.endswith(end)]
        if spaces and topic.name not in view.topics:
            break
    if view.namespace is not None and spaces and view.namespace not in spaces:
        there = ', '.join(space or '/' for space in sorted(spaces))
        raise BagError(f'{bag} has nothing in --namespace {view.namespace or "/"}, but in {there}')
    if view.namespace is None and len(spaces) > 1 and '' not in spaces:
        there = ', '.join(sorted(spaces))
        raise BagError(f'{bag} holds several runs, in {there}; --namespace chooses one')
    space = '' if '' in spaces or not spaces else spaces[0]
    space = space if view.namespace is None else view.namespace
    names = {topic: view.topics.get(topic.name, f'{space}/{topic.name}') for topic in RECORDED}
    streams = {topic: found.get(name, []) for topic, name in names.items()}
    return {topic: [*itertools.chain(*parts)] for topic, parts in streams.items() if parts}


def wanted(topic: Topic, known: Mapping[Topic, Any], found: Bag[Any]) -> str:
    """A topic that a bag lacks, its type, what may be meant instead, and the option that says so.

    Args:
        topic: The topic.
        known: The topics that the bag has.
        found: What was read of it.
    """
    channels = found.channels
    kinds = {kind.replace('/msg/', '/') for kind in (topic.type, *INSTEAD.get(topic, ()))}
    taken = {other.name for other in known}
    others = [
        (name, other)
        for name, other in channels.items()
        if (other.replace('/msg/', '/') in kinds or name.endswith(f'/{topic.name}'))
        and name.lstrip('/') not in taken
    ]
    what = f'{topic.name} ({topic.type})'
    if not others:
        names = ', '.join(printable(name, 60) for name in [*channels][:FEW])
        names += f' and {len(channels) - FEW} others' if len(channels) > FEW else ''
        needless = '; analyze, export and identify need none' if topic == topics.REFERENCE else ''
        return (
            f'{what}, nor on another topic of that type; it has {names or "no topics"}{needless}'
        )
    shown = ', '.join(
        f'{printable(name, 60)} ({printable(other, 60)})'
        if name not in found.encodings
        else f'{printable(name, 60)} ({printable(other, 60)} as {found.encodings[name]:.20})'
        for name, other in others[:FEW]
    )
    alike = [name for name, other in others if other in (topic.type, *INSTEAD.get(topic, ()))]
    strange = any(name in found.encodings for name, _ in others)
    alike = [name for name in alike if name not in found.encodings]
    if not alike:
        help_text = '; only messages as cdr, of ROS 2, are read' if strange else ''
        return f'{what}; it has {shown}{help_text}'
    word = topic.name.rpartition('/')[2]
    return f'{what}; it has {shown}: --topic {word}={printable(alike[0], 60)} takes it'
