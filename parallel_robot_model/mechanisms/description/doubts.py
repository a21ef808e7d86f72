"""What people should know of a home and of joints, and which homes are refused."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.assembly import Assembly
from parallel_robot_model.mechanisms.description.home import doubted
from parallel_robot_model.mechanisms.description.parts import listed
from parallel_robot_model.mechanisms.description.tree import Freedoms
from parallel_robot_model.mechanisms.mechanism import HINGE

OPEN, TOLD = 1e-3, 1e-6  # what may stay open, and what is told, relative to the length
DEGREES = 10.0, 720.0  # rad, ends of travel that may be in degrees; of more turns there is no end
MILLIMETRES = 50.0, 1e5  # m, likewise in mm


def check_closed(source: str, parts: Assembly, closed: Array) -> None:
    """Refuse loops that no posture near home closes.

    Raises:
        InputError: they stay open.
    """
    left = parts.missed(closed)
    if left.max(initial=0.0) > OPEN * parts.length:
        worst = int(np.argmax(left))
        raise InputError(
            f'{source}: the loops do not close near home: '
            f'{printable(parts.equations[worst].name)!r} stays open by {left[worst]:.3g} m'
        )


def told(
    start: Assembly, closed: Array, parts: Assembly, freedoms: Freedoms, stopped: list[int]
) -> Iterator[str]:
    """What was decided about joints and home, one line each.

    Args:
        start: The machine at the home that was asked for, its loops perhaps open.
        closed: The positions there that close them [rad or m], shape (N,).
        parts: The machine at home.
        freedoms: Its joints.
        stopped: Those that the user holds.
    """
    links = parts.tree.links
    if idle := [links[i].name for i in freedoms.held if i not in stopped]:
        names = ', '.join(map(printable, idle))
        yield f'held where they are at home, as nothing drives them: {names}'
    yield from _of_home(start, closed, parts)
    yield from doubted(parts, freedoms)
    joints = {links[i].joint.name: links[i].joint for i in freedoms.passive}.values()
    if stiff := [joint.name for joint in joints if joint.armature]:
        yield f'passive joints with armature: {listed(stiff)}'
    if rough := [joint.name for joint in joints if joint.viscous or joint.coulomb]:
        yield f'friction of passive joints is left out: {listed(rough)}'
    ends = {i: (links[i].joint.lower, links[i].joint.upper) for i in freedoms.actuated}
    if none := [links[i].name for i, (lower, upper) in ends.items() if lower >= upper]:
        yield f'travel without an extent is taken for none: {listed(none)}'
    yield from _of_units(parts, ends)
    out = [
        f'{links[i].name} at {parts.home[i]:.4g}'
        for i, (lower, upper) in ends.items()
        if lower < upper and not lower <= parts.home[i] <= upper
    ]
    if out:
        yield f'home is outside the travel of joints: {listed(out)}'


def _of_units(parts: Assembly, ends: Mapping[int, tuple[float, float]]) -> Iterator[str]:
    """Travel that looks like that of another unit."""
    for i, travel in ends.items():
        link, end = parts.tree.links[i], max(travel, key=abs)
        (least, most), unit, other, size = (
            (DEGREES, 'rad', 'degrees', np.pi / 180.0)
            if link.kind == HINGE
            else (MILLIMETRES, 'm', 'mm', 1e-3)
        )
        if least < abs(end) <= most:
            yield (
                f'travel of {printable(link.name)} ends at {end:.4g} {unit}: '
                f'if that is in {other}, it must be {end * size:.4g} {unit}'
            )


def _of_home(start: Assembly, closed: Array, parts: Assembly) -> Iterator[str]:
    """By how much home was closed, and what stays open."""
    if start.gap(start.home) > TOLD * parts.length:
        moved = np.abs(closed - start.home)
        turning = np.array([link.kind == HINGE for link in parts.tree.links])
        motions = (
            f'up to {moved[of].max():.3g} {unit}'
            for of, unit in ((turning, 'rad'), (~turning, 'm'))
            if moved[of].any()
        )
        yield (
            f'the loops were open by {start.distance(start.home):.3g} m at home; closed by '
            f'motions of {" and ".join(motions)}'
        )
    if (left := parts.gap(parts.home)) > TOLD * parts.length:
        yield f'closures that others imply stay open by {left:.3g} m'
