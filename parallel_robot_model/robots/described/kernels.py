"""The kernels of a robot for any described machine; all vectors are of shape (n,).

Its pose has as many coordinates as it has actuated joints, which are also what the plant
integrates. The passive joints are in the memory of the constants.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import Boxed, internal, kernel, read_row, vector, write_row
from parallel_robot_model.mechanisms import closure_solver, dynamics, tool
from parallel_robot_model.mechanisms.margins import (
    margins,
    margins_hold,
    passive_travel_left,
    travel_left,
)
from parallel_robot_model.mechanisms.margins import margins as margins_of
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.mechanisms.pose_solving import pose_motion, solve_pose
from parallel_robot_model.mechanisms.workspace import boxed, workspace
from parallel_robot_model.robots.contract import (
    FOUND,
    REACHED,
    Estimate,
    JointMotion,
    Location,
    Measurement,
    Model,
    PoseMotion,
    no_model,
)
from parallel_robot_model.robots.described.parameters import CLOSURE, TOOL, TRAVEL, SafetyMargins
from parallel_robot_model.robots.joint_load import JointLoad, net_torque

# What the kernels take of a described machine: its arrays, and a memory of its own.

ROWS = 6  # vectors that are handed over between kernels


class Constants(NamedTuple):
    """A mechanism, and where its kernels write."""

    mechanism: Any  # the machine, a boxed Mechanism
    workspace: Any  # its posture, from which the next one is looked for, a boxed Workspace
    coarse_workspace: (
        Any  # the same for postures that are only judged, which lie ahead of the others
    )
    rows: Array  # vectors that are handed over, shape (ROWS, n)
    matrices: Array  # M and Q, shape (2, n, n)
    travel: Array  # lower and upper ends of travel [rad or m], shape (2, n)
    home: Array  # margins at home, see :func:`margins`, shape (2,)


def constants(
    mechanism: Mechanism, lower: tuple[float, ...], upper: tuple[float, ...]
) -> Constants:
    """A machine at home, with a new memory."""
    n = len(mechanism.actuated)
    machine, made = boxed(mechanism)
    closure_solver.close(machine, made, made.q.copy())
    return Constants(
        machine,
        made,
        Boxed(workspace(mechanism)),
        np.zeros((ROWS, n)),
        np.zeros((2, n, n)),
        np.array([lower, upper], np.float64),
        np.array(margins(machine, made), np.float64),
    )


@internal
def _closed(robot: Constants, position: Array) -> int:
    """Close the loops at actuated joints; FOUND or a fault."""
    write_row(robot.rows, 0, position)
    return closure_solver.close(robot.mechanism, robot.workspace, robot.rows[0])


@internal
def _pose(robot: Constants, workspace: Any, template: Array) -> Array:
    """The pose of the posture that is closed."""
    tool.tool_pose(robot.mechanism, workspace, robot.rows[1])
    return read_row(robot.rows, 1, template)


@internal
def _near(robot: Constants, workspace: Any, margins: SafetyMargins, position: Array) -> int:
    """FOUND, or the margin that is violated in the posture that is closed; NaN is a fault, too."""
    closure, of_tool = robot.home
    closes, moves = margins_hold(
        robot.mechanism, workspace, margins.min_closure * closure, margins.min_tool * of_tool
    )
    if not closes:
        return CLOSURE
    if not moves:
        return TOOL
    left = travel_left(robot.mechanism, workspace, robot.travel, position)
    return FOUND if left >= margins.min_travel else TRAVEL


@kernel
def locate(robot: Constants, position: Array, guess: Array) -> Location:
    """Pose at joint positions in the assembly mode of home; the guess where there is none."""
    fault = _closed(robot, position)
    return Location(_pose(robot, robot.workspace, guess) if fault == FOUND else guess, fault)


@kernel
def estimate(
    robot: Constants, margins: SafetyMargins, position: Array, velocity: Array, guess: Array
) -> Estimate:
    """Pose, margins and model at a joint state."""
    fault = _closed(robot, position)
    return _estimate(robot, robot.workspace, margins, position, velocity, guess, fault)


@kernel
def estimate_coarse(
    robot: Constants, margins: SafetyMargins, position: Array, velocity: Array, guess: Array
) -> Estimate:
    """As :func:`estimate`, with loops that are closed to seven digits."""
    write_row(robot.rows, 0, position)
    fault = closure_solver.close_coarsely(robot.mechanism, robot.coarse_workspace, robot.rows[0])
    return _estimate(robot, robot.coarse_workspace, margins, position, velocity, guess, fault)


@internal
def _estimate(
    robot: Constants,
    workspace: Any,
    margins: SafetyMargins,
    position: Array,
    velocity: Array,
    guess: Array,
    fault: int,
) -> Estimate:
    """What is known of the posture that is closed, unless there is a fault."""
    matrix = np.diag(position)
    nothing = no_model(Model(matrix, matrix, position))
    if fault != FOUND:
        return Estimate(fault, guess, nothing)
    pose = _pose(robot, workspace, guess)
    fault = _near(robot, workspace, margins, position)
    if fault != FOUND:
        return Estimate(fault, pose, nothing)
    write_row(robot.rows, 1, velocity)
    rows, matrices = robot.rows, robot.matrices
    dynamics.model(robot.mechanism, workspace, rows[1], matrices[0], matrices[1], rows[2])
    model = Model(
        read_row(matrices, 0, matrix), read_row(matrices, 1, matrix), read_row(rows, 2, position)
    )
    return Estimate(FOUND, pose, model)


@kernel
def acceleration(
    robot: Constants, load: JointLoad, position: Array, rate: Array, torque: Array, time: float
) -> Array:
    """Accelerations of the actuated joints under motor torques; NaN where no loop closes."""
    if _closed(robot, position) != FOUND:
        return position + np.nan
    rows = robot.rows
    write_row(rows, 1, rate)
    write_row(rows, 2, net_torque(load, torque, rate, time))
    dynamics.free_acceleration(robot.mechanism, robot.workspace, rows[1], rows[2], rows[3])
    return read_row(rows, 3, position)


@kernel
def measure(robot: Constants, position: Array, rate: Array) -> Measurement:
    """Joints, which are the plant's coordinates, and pose; NaN where no loop closes."""
    none = vector(())
    if _closed(robot, position) != FOUND:
        lost = position + np.nan
        return Measurement(position, lost, none, none, lost)
    return Measurement(position, rate, none, none, _pose(robot, robot.workspace, position))


@kernel
def joint_motion(robot: Constants, motion: PoseMotion) -> JointMotion:
    """Joints with two derivatives at a pose with two derivatives, in the modes of home.

    As `passive` it has the shares of the margins at home, closure and tool, and the travel that
    is left to passive joints and tendons.
    """
    rows, pose = robot.rows, motion.pose
    write_row(rows, 0, pose)
    if solve_pose(robot.mechanism, robot.workspace, rows[0]) != FOUND:
        lost = pose + np.nan
        return JointMotion(lost, lost, lost, vector((np.nan, np.nan, np.nan)), 0)
    write_row(rows, 1, motion.rate)
    write_row(rows, 2, motion.acceleration)
    pose_motion(robot.mechanism, robot.workspace, rows[1], rows[2], rows[3], rows[4], rows[5])
    closure, of_tool = margins_of(robot.mechanism, robot.workspace)
    left = passive_travel_left(robot.mechanism, robot.workspace)
    return JointMotion(
        read_row(rows, 3, pose),
        read_row(rows, 4, pose),
        read_row(rows, 5, pose),
        vector((closure / robot.home[0], of_tool / robot.home[1], left)),
        REACHED,
    )
