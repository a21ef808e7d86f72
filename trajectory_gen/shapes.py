"""The shapes of motions by name. A new one is one module and one line here."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Sequence
from types import ModuleType
from typing import Any, Protocol

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.processes import custom_module
from parallel_robot_model.processes.child_process import CALL_LIMIT, trial_step
from parallel_robot_model.robots.contract import PoseMotion
from trajectory_gen import (
    circle,
    ellipse,
    excitation,
    figure_eight,
    hold,
    line,
    move,
    pick_and_place,
    trapezoid,
    waypoints,
)


class Shape(Protocol):
    """A module with a motion: its parameters, the motion, and when it repeats or rests."""

    Parameters: Any

    def motion(self, parameters: Any, t: float) -> PoseMotion:
        """Pose with two derivatives at time `t` [s]."""

    def span(self, parameters: Any) -> float:
        """Time after which nothing new happens [s]."""


SHAPES: dict[str, Shape] = {
    'circle': circle,
    'ellipse': ellipse,
    'figure_eight': figure_eight,
    'line': line,
    'trapezoid': trapezoid,
    'pick_and_place': pick_and_place,
    'hold': hold,
    'move': move,
    'waypoints': waypoints,
    'excitation': excitation,
}
NEEDED = ('Parameters', 'motion', 'span')


def shapes(paths: Sequence[str]) -> dict[str, Shape]:
    """The shapes of the suite and custom trajectories, by name.

    Args:
        paths: Files of the custom trajectories.

    Raises:
        InputError: a file cannot be imported or is not a trajectory.
    """
    return SHAPES | custom_trajectories(paths)


def custom_trajectories(paths: Sequence[str]) -> dict[str, Any]:
    """Custom trajectories by name, see :func:`shapes`."""
    key = 'custom_trajectories'
    return dict(custom_module.load(path, key, NEEDED, ('Parameters',), dry_run) for path in paths)


def dry_run(shape: ModuleType) -> None:
    """Call what a shape has in Python; what it raises is reported where it is called again."""
    with contextlib.suppress(*custom_module.RAISED), trial_step('its Python', CALL_LIMIT):
        prepared('it', shape, shape.Parameters())


def prepared(name: str, shape: Any, parameters: Any) -> tuple[Any, float]:
    """What the motion is computed from, and its span [s].

    Args:
        name: Name of the shape.
        shape: The shape.
        parameters: Its parameters; ``validate`` and ``prepare``, if it has them, take them.

    Raises:
        InputError: the shape refuses its parameters, fails, or its span is no time.
    """
    with custom_module.wrap_user_errors(name):
        parameters = getattr(shape, 'validate', lambda parameters: parameters)(parameters)
        made = getattr(shape, 'prepare', lambda parameters: parameters)(parameters)
        span = float(shape.span(made))
    if not 0.0 <= span < math.inf:
        raise InputError(f'{name}: span must be a time of at least 0 s, not {span:g}')
    return made, span
