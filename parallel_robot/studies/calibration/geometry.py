"""The parameters of a robot on which its forward kinematics depends, as a vector."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.studies.calibration.tracker import Locator
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import parameters
from parallel_robot_model.robots.registry import RobotModel

LOOKED_AT = 32  # poses at which it is looked whether a parameter counts
CHANGE = 1e-4  # of a parameter, in its unit
COUNTS = 1e-9  # change of a pose, in its units


class Number(NamedTuple):
    """One number of a robot's parameters.

    Attributes:
        key: Key of the parameter.
        place: Its place in a list; None for a parameter that is a number.
        unit: Its unit.
        what: What it is of, if its place does not say that.
    """

    key: str
    place: int | None
    unit: str
    what: str = ''

    @property
    def name(self) -> str:
        """How tables call it, e.g. ``robot.base_x[0]``."""
        place = '' if self.place is None else f'[{self.place}]'
        return f'robot.{self.key}{place} {self.what}'.rstrip()


def find(robot: RobotModel, position: Array, poses: Array) -> tuple[Number, ...]:
    """Parameters of a robot that move its pose at some joints.

    Args:
        robot: The robot.
        position: Actuated joints [rad], shape (N, n).
        poses: Their poses, shape (N, m).
    """
    rows = np.unique(np.linspace(0, len(position) - 1, LOOKED_AT).astype(int))
    module: Any = robot.module
    exact = getattr(module, 'pose_slopes', None)  # optional in the contract
    if exact is not None:
        slopes = exact(robot.parameters, position[rows], poses[rows])[:, :, position.shape[1] :]
        moved = CHANGE * np.abs(slopes).max(axis=(0, 1)) > COUNTS
        key, names, unit = module.geometry(robot.parameters)
        return tuple(Number(key, int(k), unit, names[k]) for k in np.flatnonzero(moved))
    locate, found = Locator(robot), []
    for number in _numbers(robot):
        value = values(robot, [number])
        try:
            changed = with_values(robot, [number], value + CHANGE)
            moved = locate(changed, position[rows], poses[rows])
        except ParallelRobotError:  # a mode, which has no neighbour
            continue
        if moved is not None and np.abs(moved - poses[rows]).max() > COUNTS:
            found.append(number)
    return tuple(found)


def values(robot: RobotModel, numbers: Sequence[Number]) -> Array:
    """Values of some numbers of a robot, shape (P,)."""
    every = robot.parameters._asdict()
    return np.array(
        [
            every[each.key] if each.place is None else every[each.key][each.place]
            for each in numbers
        ],
        np.float64,
    )


def with_values(robot: RobotModel, numbers: Sequence[Number], given: Array) -> RobotModel:
    """A robot with other values of some numbers, shape (P,).

    Raises:
        RobotError: it cannot be built.
    """
    changed = robot.parameters._asdict()
    for number, value in zip(numbers, given.tolist(), strict=True):
        if number.place is None:
            changed[number.key] = value
        else:
            entries = [*changed[number.key]]
            entries[number.place] = value
            changed[number.key] = type(changed[number.key])(entries)
    made = robot.module.validate(type(robot.parameters)(**changed), 'robot')
    return robot._replace(parameters=made)


def _numbers(robot: RobotModel) -> Iterator[Number]:
    """All numbers of a robot's parameters."""
    for parameter in parameters(type(robot.parameters)):
        value = getattr(robot.parameters, parameter.key)
        if isinstance(value, tuple):
            for place, each in enumerate(value):
                if isinstance(each, float):
                    yield Number(parameter.key, place, parameter.field.unit)
        elif isinstance(value, float):
            yield Number(parameter.key, None, parameter.field.unit)
