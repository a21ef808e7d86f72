"""Coordinates of the plant along a desired motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import kernel, largest, multiply, read_row, solve, write_row
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.assembly import Plant
from parallel_robot_sim.plant import PlantSetup, PlantState

SMALL = 1e-6  # of coordinates, in their units: half the width of a difference
ENOUGH = 1e-8  # correction of coordinates after which the next one is none
MOST = 8  # corrections


def coordinates_of(robot: RobotModel, plant: Plant, poses: Array) -> Array:
    """Coordinates of the plant at poses that follow each other closely.

    Args:
        robot: The true robot.
        plant: The plant of it.
        poses: Poses, shape (N, m).

    Returns:
        Shape (N, c).

    Raises:
        InputError: the robot does not reach a pose.
    """
    start = robot.module.start
    first = np.array(start(robot.parameters, poses[0]), np.float64)
    if len(first) == poses.shape[1]:
        coordinates: Array = _followed(plant.setup, plant.state, poses, first)
        if np.isfinite(coordinates).all():
            return coordinates
    each: list[Any] = [start(robot.parameters, pose) for pose in poses]
    return np.array(each, np.float64)


@kernel
def _followed(setup: PlantSetup, state: PlantState, poses: Array, first: Array) -> Array:
    """Coordinates at poses by Newton's method, each from those before; NaN where it fails."""
    x, size = first.copy(), len(first)
    pose, ends = np.empty(size), np.empty((2, size))
    slopes, normal = np.empty((size, size)), np.empty((size, size))  # of each coordinate a row
    coordinates = np.full((len(poses), size), np.nan)
    for k in range(len(poses)):
        for _ in range(MOST):
            write_row(pose, 0, _pose(setup, state, x))
            for i in range(size):
                here = x[i]
                for side in range(2):
                    x[i] = here + (2 * side - 1) * SMALL
                    write_row(ends[side], 0, _pose(setup, state, x))
                x[i] = here
                slopes[i] = (ends[1] - ends[0]) / (2.0 * SMALL)
            for i in range(size):  # solve() is for symmetric matrices
                normal[i] = multiply(slopes, slopes[i])
            correction = solve(normal, multiply(slopes, poses[k] - pose))
            x += correction
            if largest(correction) < ENOUGH:
                coordinates[k] = x
                break
        if not np.isfinite(coordinates[k, 0]):
            break
    return coordinates


@kernel
def _pose(setup: PlantSetup, state: PlantState, x: Array) -> Array:
    """Pose at coordinates, shape (m,)."""
    return setup.measure(setup.robot, read_row(x, 0, state.coordinates), state.rate).pose
