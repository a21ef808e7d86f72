"""Why poses are not those of a robot: each likely cause is tried on the nominal robot.

Lengths in mm, angles in degrees, axes that are mirrored or swapped, another frame, a target beside
the tool, another order or sign of the joints: the simplest of those that bring down by far what is
left of the poses is named.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator

import numpy as np
from scipy import optimize

from parallel_robot.studies.calibration.pose_model import PoseModel
from parallel_robot.studies.calibration.tracker import FRAME, FREE, TARGET, Tracker
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array

ROWS = 200  # poses that are compared
BY_FAR = 0.2  # of what is left: a cause leaves less
# The simplest cause is named that leaves no more than this
ALIKE = 2.0  # of what the best one leaves, or
CLOSE = 0.05  # of what is left
DISTANT = 0.1  # of the spread of the poses: no robot is so far from its nominal one
LEAST = 0.01  # m or rad, of the spread
TENTH = 10.0  # of the noise: with less left there is nothing to explain
UNITS = {
    'm': {'': 1.0, 'lengths in mm': 1e-3, 'lengths in cm': 1e-2, 'lengths in inches': 0.0254},
    'rad': {'': 1.0, 'angles in degrees': math.pi / 180.0},
}
TRIED = 'mm, degrees, mirrored or swapped axes, another frame or target, order and sign of joints'


def likely_cause(model: PoseModel, free: Collection[str]) -> tuple[str, bool] | None:
    """The likeliest cause for poses that are not those of the nominal robot; None: there is none.

    It comes with whether they are so far from it that no geometry is looked for.

    Args:
        model: What is looked for.
        free: Which of FREE are unknown.
    """
    rows = np.unique(np.linspace(0, len(model.nominal) - 1, ROWS).astype(int))
    own, seen = model.nominal[rows], model.measured.pose[rows]
    noise = model.noise
    other_free = [
        each
        for count in (1, 2)
        for each in itertools.combinations(FREE, count)
        if {*free} < {*each}
    ]
    readings = [*_readings(model, seen)]

    def left(own: Array, seen: Array, free: Collection[str]) -> Array:
        try:
            tracker = Tracker(model.robot, model.measured.columns, free)
        except InputError:
            return np.full_like(seen, np.inf)
        values = tracker.start(own, seen)
        if TARGET in free:
            rough = size(tracker.apart(seen, tracker.seen(own, values)))
            values = optimize.least_squares(
                lambda x: (tracker.apart(seen, tracker.seen(own, x)) / noise).ravel(),
                values,
                loss='soft_l1',
                f_scale=max(rough, 1.0),
            ).x
        return tracker.apart(seen, tracker.seen(own, values))

    def size(left: Array) -> float:  # of most poses: outliers do not count
        return float(np.sqrt(np.median(((left / noise) ** 2).mean(axis=1))))

    before = left(own, seen, free)
    least = size(before)
    if least < TENTH:
        return None
    tried = [
        *((text, own, pose, free) for text, pose, _ in readings),
        *((_free_text(each), own, seen, each) for each in other_free),
        *((text, moved[rows], seen, free) for text, moved in _joints(model)),
        *(
            (f'{text} and {_free_text(more)}', own, pose, more)
            for text, pose, simple in readings
            if simple
            for more in other_free
        ),
    ]
    sizes = [size(left(*each[1:])) for each in tried]
    limit = min(BY_FAR * least, max(ALIKE * min(sizes, default=math.inf), CLOSE * least))
    found = next((each for each, one in zip(tried, sizes, strict=True) if one <= limit), None)
    if found is None:
        return None
    spread = own[:, list(model.measured.columns)].std(axis=0)
    far = 1.48 * np.median(np.abs(before), axis=0) > DISTANT * np.maximum(spread, LEAST)
    return found[0], bool(far.any())


def _free_text(free: Collection[str]) -> str:
    what = {FRAME: 'another frame', TARGET: 'a target beside the tool'}
    options = ' '.join(f'--free {each}' for each in free)
    return f'{" and ".join(what[each] for each in free)} ({options})'


def _readings(model: PoseModel, seen: Array) -> Iterator[tuple[str, Array, bool]]:
    """Poses with other units, mirrored and swapped axes: how, shape (N, k), if by one change."""
    names = [axis.name for axis in model.axes]
    columns = {unit: [k for k, each in enumerate(model.units) if each == unit] for unit in UNITS}
    for texts in itertools.product(*UNITS.values()):
        pose = seen.copy()
        for text, (unit, scales) in zip(texts, UNITS.items(), strict=True):
            pose[:, columns[unit]] *= scales[text]
        if not np.array_equal(pose, seen):
            yield ' and '.join(filter(None, texts)), pose, True
    turns = columns['rad'] if len(columns['rad']) <= 1 or not columns['m'] else []
    place = columns['m'] or columns['rad']
    signs = [*itertools.product((1.0, -1.0), repeat=len(names) if turns else len(place))]
    changed = [*place, *(k for k in turns if k not in place)]
    for order in itertools.permutations(place):
        for sign in sorted(signs, key=lambda each: each.count(-1.0)):
            pose, taken = seen.copy(), [*order, *changed[len(place) :]]
            pose[:, changed] = seen[:, taken] * sign[: len(changed)]
            negated = [names[k] for k, one in zip(taken, sign, strict=False) if one < 0.0]
            moved = [names[k] for k, one in zip(changed, taken, strict=True) if k != one]
            told = [f'{", ".join(moved)} swapped'] if moved else []
            told += [f'{", ".join(negated)} with the other sign (mirrored?)'] if negated else []
            if told:
                yield ' and '.join(told), pose, len(moved) + len(negated) <= 2


def _joints(model: PoseModel) -> Iterator[tuple[str, Array]]:
    """Poses of the nominal robot with two joints swapped, or one with the other sign."""
    n, names = model.track.position.shape[1], model.joints
    pairs = itertools.combinations_with_replacement(range(n), 2)
    for one, other in sorted(pairs, key=lambda pair: pair[0] == pair[1]):  # swapped ones first
        order, signs = [*range(n)], np.ones(n)
        order[one], order[other] = other, one
        signs[one] = -1.0 if one == other else 1.0
        poses = model.nominal_at(order, signs)
        if poses is not None:
            swapped = f'the joints {names[one]} and {names[other]} swapped'
            yield swapped if one != other else f'{names[one]} with the other sign', poses
