"""The posture in which a machine begins: named, given, or the zero of its file; then closed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from parallel_robot_model.common.errors import InputError, UnknownNameError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.assembly import Assembly, jacobian, residuals
from parallel_robot_model.mechanisms.description.parts import (
    LARGEST_NUMBER,
    Description,
    listed,
    rank,
)
from parallel_robot_model.mechanisms.description.tree import Freedoms, Posture, link_frames

NAME = 'home'  # of the keyframe that is taken if none is named
MET = 1e-5  # what closures that contradict each other may leave open, relative to the length
SPREADS = 0.0, 0.1, 0.3, 0.5, 1.0, 1.0  # rad or m, of starts where one leads nowhere
DIGITS = 9  # of positions that were searched
ROUNDS = 100  # of a search for a closed posture
EXACT = 1e-14  # relative to the length
BETTER, STALLED_ROUNDS = (
    0.98,
    8,
)  # what a round should reach, and rounds without that in which it ends
DAMPING = 1e-3
LONGEST = 0.3  # rad, or of the length, of a step


def posture(description: Description, home: str | Mapping[str, float]) -> Posture:
    """Positions of the joints before the loops are closed.

    Args:
        description: The robot.
        home: Empty: the keyframe called home, or the zero of the file; the name of a keyframe; or
            positions of joints, the others at zero, e.g. ``'elbow=1.2, wrist=0'``.

    Raises:
        InputError: there is no such keyframe or joint, or a position is no number.
    """
    known = description.keyframes
    zero: dict[str, float | tuple[float, ...]] = {
        joint.name: joint.zero for joint in description.joints if joint.kind.single
    }
    if isinstance(home, str) and '=' not in home:
        name = home or NAME
        if name in known:
            return known[name]
        if home:
            raise UnknownNameError('keyframe', home, known)
        return zero
    given = _positions(home) if isinstance(home, str) else home
    for name, value in given.items():
        if name not in zero:
            raise UnknownNameError('joint', name, zero)
        if not abs(value) < LARGEST_NUMBER:
            raise InputError(f'home: {printable(name)} must be a finite number, not {value:g}')
    return zero | dict(given)


def _positions(text: str) -> dict[str, float]:
    positions = {}
    for part in text.split(','):
        name, _, value = part.rpartition('=')
        try:
            positions[name.strip()] = float(value)
        except ValueError:
            raise InputError(
                f'home: {printable(part.strip())!r} must be a joint and its position, as in '
                'elbow=1.2'
            ) from None
    return positions


def close(parts: Assembly, actuated: list[int], held: list[int]) -> Array:
    """The closed posture near home, with the actuated joints where they are if possible.

    Args:
        parts: The machine.
        actuated: Joints that are kept if the loops can be closed without them.
        held: Joints that are kept.

    Returns:
        Positions [rad or m], shape (N,): those that meet the equations best.
    """
    q = parts.home
    free = [i for i in range(len(q)) if i not in held]
    best = fitted(parts, q, [i for i in free if i not in actuated])
    random = np.random.default_rng(0)
    for spread in SPREADS:
        if parts.gap(best) < MET * parts.length:
            break
        start = q.copy()
        start[free] += (spread * random.uniform(-1.0, 1.0, len(q)) * parts.steps)[free]
        moved = fitted(parts, start, free)
        best = moved if parts.gap(moved) < 0.5 * parts.gap(best) else best
    return best


def fitted(parts: Assembly, q: Array, free: list[int]) -> Array:
    """Positions that miss the equations least, near others, by damped steps of least length.

    Args:
        parts: The machine.
        q: Where to begin [rad or m], shape (N,).
        free: Joints that move.

    Source:
        Sugihara (2011), Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt
        method, IEEE Transactions on Robotics 27(5): the damping follows the residual.
    """
    best, least, steps, stalled = q, np.inf, parts.steps[free], 0
    scale = parts.unit * parts.length
    for _ in range(ROUNDS if free else 0):
        places = link_frames(parts.tree, q)
        missing = residuals(parts.equations, places, q) / scale
        size = float(np.linalg.norm(missing))
        stalled = 0 if size < BETTER * least else stalled + 1
        if size < least:
            best, least = q, size
        if size < EXACT or stalled == STALLED_ROUNDS:
            break
        matrix = jacobian(parts.equations, places)[:, free] / scale[:, None] * steps
        damping = (DAMPING * size**2 + EXACT) * np.eye(len(matrix))
        step = matrix.T @ np.linalg.solve(matrix @ matrix.T + damping, missing)
        q = q.copy()
        q[free] -= step * (LONGEST / max(np.abs(step).max(), LONGEST)) * steps
    return best


def on_grid(q: Array, start: Array) -> Array:
    """Positions rounded where they moved, so that noise of other libraries does not matter."""
    return np.where(q == start, q, np.round(q, DIGITS))


def polished(parts: Assembly, rows: list[int], passive: list[int]) -> Array:
    """Home with the chosen equations met to the last digits, by Newton's method, shape (N,)."""
    q, chosen = parts.home, tuple(parts.equations[i] for i in rows)
    best, least = q, np.inf
    for _ in range(ROUNDS if rows else 0):
        places = link_frames(parts.tree, q)
        missing = residuals(chosen, places, q)
        if np.abs(missing).max() >= least:
            break
        best, least = q, np.abs(missing).max()
        q = q.copy()
        q[passive] -= np.linalg.solve(jacobian(chosen, places)[:, passive], missing)
    return best


# Whether home is like the postures beside it: as many closures that are independent.

BESIDE = 0.03  # rad, or of the length of the machine, to postures that are tried
TRIES = 3  # postures
MET_BESIDE = 1e-4  # what such a posture may leave open, relative to the length


def check_singular(source: str, parts: Assembly, held: list[int]) -> None:
    """Refuse a home in which the loops bind less than beside it.

    Args:
        source: What the machine is called in messages.
        parts: The machine at home.
        held: Joints that do not move.

    Raises:
        InputError: it is such a posture.
    """
    free = [i for i in range(len(parts.home)) if i not in held]
    at_home = rank(parts.closures()[:, free])
    for other in _beside(parts, free):
        if (more := rank(other.closures()[:, free])) > at_home:
            raise InputError(
                f'{source}: home is a singular posture: {at_home} closures of the loops are '
                f'independent there, {more} beside it; give another home'
            )


def doubted(parts: Assembly, freedoms: Freedoms) -> Iterator[str]:
    """Whether the closures that were chosen at home fail beside it."""
    free = [*freedoms.actuated, *freedoms.passive]
    for other in _beside(parts, free):
        matrix = other.closures()
        chosen = rank(matrix[freedoms.rows][:, freedoms.passive])
        if chosen < len(freedoms.rows) or rank(matrix[:, free]) < len(freedoms.rows):
            yield (
                f'{len(freedoms.rows)} closures are independent at home, but fewer beside it: '
                'do not move it far'
            )
            return


def _beside(parts: Assembly, free: list[int]) -> Iterator[Assembly]:
    """Closed postures near home, the same on every computer."""
    random = np.random.default_rng(0)
    for _ in range(TRIES if parts.equations else 0):
        start = parts.home.copy()
        start[free] += (BESIDE * random.uniform(-1.0, 1.0, len(start)) * parts.steps)[free]
        q = fitted(parts, start, free)
        if parts.gap(q) < MET_BESIDE * parts.length:
            yield parts._replace(home=q)


# What people should know of a home and of joints, and which homes are refused.

MAX_GAP, REPORTED_GAP = 1e-3, 1e-6  # what may stay open, and what is told, relative to the length
DEGREES = 10.0, 720.0  # rad, ends of travel that may be in degrees; of more turns there is no end
MILLIMETRES = 50.0, 1e5  # m, likewise in mm


def check_closed(source: str, parts: Assembly, closed: Array) -> None:
    """Refuse loops that no posture near home closes.

    Raises:
        InputError: they stay open.
    """
    left = parts.residuals(closed)
    if left.max(initial=0.0) > MAX_GAP * parts.length:
        worst = int(np.argmax(left))
        raise InputError(
            f'{source}: the loops do not close near home: '
            f'{printable(parts.equations[worst].name)!r} stays open by {left[worst]:.3g} m'
        )


def remarks(start: Assembly, closed: Array, parts: Assembly, freedoms: Freedoms) -> Iterator[str]:
    """What was decided about joints and home, one line each.

    Args:
        start: The machine at the home that was asked for, its loops perhaps open.
        closed: The positions there that close them [rad or m], shape (N,).
        parts: The machine at home.
        freedoms: Its joints.
    """
    links = parts.tree.links
    yield from _of_home(start, closed, parts)
    yield from doubted(parts, freedoms)
    joints = {links[i].joint.name: links[i].joint for i in freedoms.passive}.values()
    if rough := [f'{joint.name} ({joint.coulomb:.3g})' for joint in joints if joint.coulomb]:
        yield f'dry friction of passive joints [N m or N] is left out: {listed(rough)}'
    ends = {i: (links[i].joint.lower, links[i].joint.upper) for i in freedoms.actuated}
    if none := [links[i].name for i, (lower, upper) in ends.items() if lower >= upper]:
        yield f'travel without an extent is taken for none: {listed(none)}'
    yield from _of_units(parts, ends)
    single = [i for i in freedoms.passive if links[i].joint.kind.single]
    ends |= {i: (links[i].joint.lower, links[i].joint.upper) for i in single}
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
            if link.kind.turns
            else (MILLIMETRES, 'm', 'mm', 1e-3)
        )
        if least < abs(end) <= most:
            yield (
                f'travel of {printable(link.name)} ends at {end:.4g} {unit}: '
                f'if that is in {other}, it must be {end * size:.4g} {unit}'
            )


def _of_home(start: Assembly, closed: Array, parts: Assembly) -> Iterator[str]:
    """By how much home was closed, and what stays open."""
    if start.gap(start.home) > REPORTED_GAP * parts.length:
        moved = np.abs(closed - start.home)
        turning = np.array([link.kind.turns != 0.0 for link in parts.tree.links])
        motions = (
            f'up to {moved[of].max():.3g} {unit}'
            for of, unit in ((turning, 'rad'), (~turning, 'm'))
            if moved[of].any()
        )
        yield (
            f'the loops were open by {start.distance(start.home):.3g} m at home; closed by '
            f'motions of {" and ".join(motions)}'
        )
    if (left := parts.gap(parts.home)) > REPORTED_GAP * parts.length:
        yield f'closures that others imply stay open by {left:.3g} m'
