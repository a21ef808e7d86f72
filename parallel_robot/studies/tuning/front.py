"""The Pareto front of a tuning, and the point of it that is chosen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from parallel_robot.studies.tuning.trial import Effort, Trial, Weights
from parallel_robot_model.common.errors import InputError


def front(trials: Iterable[Trial]) -> list[Trial]:
    """Trials than which no other has both less error and less effort, by rising error.

    Args:
        trials: Trials; infeasible ones and a default outside the search space are left out.
    """
    found: list[Trial] = []
    candidates = [trial for trial in trials if trial.feasible and trial.chosen is not None]
    for trial in sorted(candidates, key=lambda each: (each.error, each.effort, each.number)):
        if not found or trial.effort < found[-1].effort:
            found.append(trial)
    return found


def knee(points: Sequence[Trial]) -> Trial:
    """The point of a front that lies farthest below the line between its ends.

    Logarithms of error and effort, both scaled from 0 to 1 over the front, are compared; of
    a front of one or two points, it is the one with the smaller error.

    Source:
        Das (1999), On characterizing the "knee" of the Pareto curve.
    """
    if len(points) < 3:
        return points[0]
    smallest = np.finfo(float).tiny  # of a robot at rest
    figures = np.array([[point.error, point.effort] for point in points])
    logs = np.log(np.maximum(figures, smallest))
    scaled = (logs - logs.min(axis=0)) / np.ptp(logs, axis=0)
    return points[int(np.argmin(scaled.sum(axis=1)))]


def choose(
    points: Sequence[Trial],
    default: Trial,
    weights: Weights | None,
    pick: int | None,
    effort: Effort,
) -> tuple[Trial, str]:
    """The point of a front that is taken, and why.

    Args:
        points: The front, at least one.
        default: The trial of the default gains.
        weights: Weights, if there are any.
        pick: Number of a trial of the front, if requested.
        effort: The measure of effort, and its limit, if there is one.

    Raises:
        InputError: the trial is not on the front, or the whole front takes more effort.
    """
    if pick is not None:
        chosen = {point.number: point for point in points}
        if pick not in chosen:
            known = ', '.join(map(str, chosen))
            raise InputError(f'--pick: trial {pick} is not on the front; it holds {known}')
        return chosen[pick], 'asked for'
    quantity = effort.quantity
    if effort.limit is not None:
        calm = [point for point in points if point.effort <= effort.limit]
        limit = f'{quantity.scale * effort.limit:g} {quantity.unit}'
        if not calm:
            least = f'{quantity.scale * points[-1].effort:.4g}'
            raise InputError(
                f'{quantity.name}: no trial has {limit} or less, the least is {least}'
            )
        return calm[0], f'the least error with at most {limit} of {effort.measure}'
    if weights is not None:
        best = min(points, key=lambda point: weights.cost(point, default))
        shown = f'error={weights.error:g}, {effort.measure}={weights.effort:g}'
        return best, f'the least weighted sum, {shown}'
    return knee(points), 'the knee of the front'
