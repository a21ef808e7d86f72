"""The Pareto front of a tuning, and the point of it that is chosen."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from parallel_robot_analysis.tuning.trial import Trial
from parallel_robot_analysis.tuning.weights import Weights
from parallel_robot_base.errors import InputError


def front(trials: Iterable[Trial]) -> list[Trial]:
    """Trials than which no other has both less error and less chattering, by rising error.

    Args:
        trials: Trials; infeasible ones and a default outside the search space are left out.
    """
    found: list[Trial] = []
    candidates = [trial for trial in trials if trial.feasible and trial.chosen is not None]
    for trial in sorted(candidates, key=lambda each: (each.error, each.chattering, each.number)):
        if not found or trial.chattering < found[-1].chattering:
            found.append(trial)
    return found


def knee(points: Sequence[Trial]) -> Trial:
    """The point of a front that lies farthest below the line between its ends.

    Logarithms of error and chattering, both scaled from 0 to 1 over the front, are compared; of
    a front of one or two points, it is the one with the smaller error.

    Source:
        Das (1999), On characterizing the "knee" of the Pareto curve.
    """
    if len(points) < 3:
        return points[0]
    smallest = np.finfo(float).tiny  # of a robot at rest
    figures = np.array([[point.error, point.chattering] for point in points])
    logs = np.log(np.maximum(figures, smallest))
    scaled = (logs - logs.min(axis=0)) / np.ptp(logs, axis=0)
    return points[int(np.argmin(scaled.sum(axis=1)))]


def choose(
    points: Sequence[Trial],
    default: Trial,
    weights: Weights | None,
    pick: int | None,
    chattering: float | None = None,
) -> tuple[Trial, str]:
    """The point of a front that is taken, and why.

    Args:
        points: The front, at least one.
        default: The trial of the default gains.
        weights: Weights, if there are any.
        pick: Number of a trial of the front, if somebody asks for it.
        chattering: Most chattering [N m], if somebody limits it.

    Raises:
        InputError: the trial is not on the front, or the whole front chatters more.
    """
    if pick is not None:
        chosen = {point.number: point for point in points}
        if pick not in chosen:
            known = ', '.join(map(str, chosen))
            raise InputError(f'--pick: trial {pick} is not on the front; it holds {known}')
        return chosen[pick], 'asked for'
    if chattering is not None:
        calm = [point for point in points if point.chattering <= chattering]
        if not calm:
            least = points[-1].chattering
            raise InputError(
                f'--chattering: no trial has {chattering:g} N m or less, the least is {least:.4g}'
            )
        return calm[0], f'the least error with at most {chattering:g} N m of chattering'
    if weights is not None:
        best = min(points, key=lambda point: weights.cost(point, default))
        shown = f'error={weights.error:g}, chattering={weights.chattering:g}'
        return best, f'the least weighted sum, {shown}'
    return knee(points), 'the knee of the front'
