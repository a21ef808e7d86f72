"""How close the robot may come to its singularities, and its faults."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.fields import Field
from parallel_robot_model.robots.contract import Fault, Infeasible, Margin, first_sample
from parallel_robot_model.robots.planar_3rrr.dynamics import condition_numbers, determinants
from parallel_robot_model.robots.planar_3rrr.forward_kinematics import (
    GUESS_OUT_OF_REACH,
    NOT_CONVERGED,
    STATUS_TEXT,
    WRONG_WORKING_MODE,
)
from parallel_robot_model.robots.planar_3rrr.geometry import RobotParameters

TYPE_1 = 4
TYPE_2 = 5
FAULTS = {
    GUESS_OUT_OF_REACH: Fault('guess_out_of_reach', STATUS_TEXT[GUESS_OUT_OF_REACH]),
    NOT_CONVERGED: Fault('not_converged', STATUS_TEXT[NOT_CONVERGED]),
    WRONG_WORKING_MODE: Fault('wrong_working_mode', STATUS_TEXT[WRONG_WORKING_MODE]),
    TYPE_1: Fault(
        'type_1_singularity',
        'a leg is close to being stretched or folded (type 1 singularity)',
    ),
    TYPE_2: Fault('type_2_singularity', 'the platform is close to yielding (type 2 singularity)'),
}
NO_POSE = (GUESS_OUT_OF_REACH, NOT_CONVERGED, WRONG_WORKING_MODE)


class SafetyMargins(NamedTuple):
    """Limits beyond which the controller enters a fault."""

    min_sin_psi: Annotated[
        float, Field('', '|sin psi| that is a fault (type 1 singularity)', 0.0, 1.0)
    ]
    min_determinant: Annotated[
        float, Field('', '|det Jx| / l3 that is a fault (type 2 singularity)', 0.0)
    ]


class MotionLimits(NamedTuple):
    """Limits of a reference motion."""

    min_sin_psi: Annotated[float, Field('', 'smallest |sin psi| allowed (type 1)', 0.0, 1.0)]
    max_condition: Annotated[float, Field('', 'largest cond(Jx) allowed (type 2)', 1.0)]


def infeasible(robot: RobotParameters, limits: MotionLimits, reference: Any) -> list[Infeasible]:
    """First samples of a motion that are out of reach or too near to a singularity.

    Args:
        robot: The robot.
        limits: Limits of the motion.
        reference: The motion, see trajectory_gen.trajectory.Reference.
    """
    unreached = np.flatnonzero(reference.out_of_reach >= 0)
    reached = slice(0, int(unreached[0]) if unreached.size else None)
    beta = reference.passive[reached]
    sines = _sines(reference.position[reached], beta)
    conditions = condition_numbers(robot, reference.pose[reached, 2], beta)
    failures = [
        first_sample(
            sines < limits.min_sin_psi,
            sines,
            'type 1 singularity, |sin psi| = {} is below trajectory.min_sin_psi, {}',
            limits.min_sin_psi,
        ),
        first_sample(
            conditions > limits.max_condition,
            conditions,
            'type 2 singularity, cond(Jx) = {} is above trajectory.max_condition, {}',
            limits.max_condition,
        ),
    ]
    if unreached.size:
        k = int(unreached[0])
        reach = f'{abs(robot.l2 - robot.l1):g} to {robot.l1 + robot.l2:g} m'
        leg = int(reference.out_of_reach[k]) + 1
        failures.append(Infeasible(k, leg, f'out of reach (a leg spans {reach})'))
    return [failure for failure in failures if failure is not None]


def margins(robot: RobotParameters, reference: Any) -> tuple[Margin, Margin]:
    """Distances from singularities of type 1 and 2 along a motion, each shape (N,)."""
    beta = reference.passive
    sines = _sines(reference.position, beta).min(axis=1)
    of_platform = determinants(robot, reference.pose[:, 2], beta)
    return (
        Margin('min_sin_psi', 'smallest |sin ψ| of the legs (type 1)', sines),
        Margin('min_determinant', '|det Jx| / l3 (type 2)', of_platform),
    )


def _sines(theta: Array, beta: Array) -> Array:
    """|sin psi| of the legs."""
    return np.abs(np.sin(beta - theta))
