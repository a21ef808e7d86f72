"""Which node of a run publishes what for the others, and who subscribes to it.

A node is ready when its output has all its subscribers, and in lockstep the plant begins when all
are ready: a node that is missing here would miss the first states.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from parallel_robot_model.messages.topics import COMMANDS, JOINT_STATES, RECORDED, REFERENCE, Topic

OUTPUTS = {'trajectory': REFERENCE, 'plant': JOINT_STATES, 'controller': COMMANDS}
INPUTS = {
    'trajectory': (),
    'plant': (COMMANDS,),
    'controller': (JOINT_STATES, REFERENCE),
    'recorder': RECORDED,
}
LOCKSTEP_INPUTS = {'trajectory': (JOINT_STATES,)}  # in addition: the plant sets the pace


def subscriptions(nodes: Iterable[str], lockstep: bool) -> Counter[Topic]:
    """How many of some nodes, by their names, subscribe to each topic."""
    counts: Counter[Topic] = Counter()
    for name in nodes:
        counts.update(INPUTS[name])
        if lockstep:
            counts.update(LOCKSTEP_INPUTS.get(name, ()))
    return counts


def subscribers(nodes: Iterable[str], lockstep: bool) -> dict[str, int]:
    """Name of each node that has an output to how many of some nodes subscribe to it."""
    counts = subscriptions(nodes, lockstep)
    return {name: counts[topic] for name, topic in OUTPUTS.items()}
