"""Numbers of a description that no machine has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.mechanisms.description.parts import Description

LARGEST = 1e9  # kg, m, kg m^2 and so on


def check(description: Description) -> None:
    """Refuse numbers that are not finite, or so large that they overflow later; swapped ends.

    Raises:
        InputError: there is one.
    """
    for name, value in _numbers(description):
        if not np.all(np.abs(np.asarray(value, dtype=float)) < LARGEST):
            raise InputError(
                f'{description.source}: {name} has a number that is not below {LARGEST:g}'
            )
    for joint in description.joints:
        if joint.lower > joint.upper:
            raise InputError(
                f'{description.source}: the travel of joint {printable(joint.name)!r} has its '
                f'ends swapped: from {joint.lower:.4g} to {joint.upper:.4g}'
            )


def _numbers(description: Description) -> Iterator[tuple[str, Any]]:
    """What parts are called, and their numbers; limits may be infinite."""
    for body in description.bodies:
        yield from ((f'body {printable(body.name)!r}', value) for value in body[2:])
    for joint in description.joints:
        own = (joint.axis, joint.anchor, joint.zero, joint.viscous, joint.coulomb, joint.armature)
        yield from ((f'joint {printable(joint.name)!r}', value) for value in own)
    for loop in description.loops:
        for frame in (loop.first, loop.second):
            yield f'loop {printable(loop.name)!r}', frame.position
    for coupling in description.couplings:
        yield f'coupling {printable(coupling.name)!r}', (coupling.ratio, coupling.offset)
    for name, frame in description.frames.items():
        yield f'frame {printable(name)!r}', frame.position
    for name, posture in description.keyframes.items():
        yield from ((f'keyframe {printable(name)!r}', value) for value in posture.values())
    yield 'gravity', description.gravity
