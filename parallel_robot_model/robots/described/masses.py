"""Masses of a machine as its parameters have them; of complex numbers, too, to differentiate."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.mechanisms.mechanism import BASE, Mechanism
from parallel_robot_model.robots.described.parameters import Parameters

ROUNDING = 1e-9  # of the largest second moment of a body, the negative one that is none
MOMENTS = {
    'Ixx': (0, 0), 'Ixy': (0, 1), 'Ixz': (0, 2), 'Iyy': (1, 1), 'Iyz': (1, 2), 'Izz': (2, 2),
}  # fmt: skip


class Masses(NamedTuple):
    """What the links weigh."""

    mass: Any  # masses [kg], shape (N,)
    moment: Any  # masses times centres of mass [kg m], shape (N, 3)
    inertia: Any  # about the origins of the links [kg m^2], shape (N, 3, 3)
    armature: Any  # rotors as felt at the joints [kg m^2 or kg], shape (N,)


def masses(mechanism: Mechanism, robot: Parameters) -> Masses:
    """The masses of a machine.

    Args:
        mechanism: As the file has it.
        robot: What differs from the file.
    """
    factor = np.array(robot.mass_factor)
    mass = mechanism.mass * factor
    centre = mechanism.centre + np.reshape(robot.centre_shift, (-1, 3))
    more = np.reshape(robot.inertia_shift, (-1, len(MOMENTS)))
    own = factor[:, None, None] * (spread(mechanism, robot) + _matrices(more))
    inertia = own + mass[:, None, None] * point(centre)
    armature = mechanism.armature.astype(np.result_type(np.array(robot.armature), float))
    armature[mechanism.actuated] = robot.armature
    carries = np.arange(len(mass)) == mechanism.tool
    load = carries * np.array(robot.payload) if mechanism.tool != BASE else 0.0 * mass
    tool = mechanism.tool_point
    return Masses(
        mass + load,
        mass[:, None] * centre + load[:, None] * tool,
        inertia + load[:, None, None] * point(tool),
        armature,
    )


def spread(mechanism: Mechanism, robot: Parameters) -> Any:
    """Inertias of the file about the centres of mass with other extents, shape (N, 3, 3)."""
    root = np.sqrt(np.reshape(robot.spread_factor, (-1, 3)))
    return inertia_of(root[:, :, None] * second_moments(mechanism.inertia) * root[:, None, :])


def possible(mechanism: Mechanism, robot: Parameters) -> NDArray[np.bool_]:
    """Which links have moments of inertia of a body, or are as in the file, shape (N,)."""
    more = np.reshape(robot.inertia_shift, (-1, len(MOMENTS)))
    seconds = second_moments(spread(mechanism, robot) + _matrices(more))
    sizes = np.linalg.eigvalsh(seconds)
    return (sizes[:, 0] >= -ROUNDING * sizes[:, -1]) | ~more.any(axis=1)


def _matrices(moments: Any) -> Any:
    """Symmetric matrices of their MOMENTS, shapes (N, 3, 3) and (N, 6)."""
    return moments[:, [[0, 1, 2], [1, 3, 4], [2, 4, 5]]]


def weighing(mechanism: Mechanism, robot: Parameters) -> Mechanism:
    """The mechanism of a file with the masses and the gravity of the parameters."""
    found, changed = masses(mechanism, robot), _changed(mechanism, robot)
    heavy = np.where(found.mass != 0.0, found.mass, 1.0)
    centre = np.where(changed[:, None], found.moment / heavy[:, None], mechanism.centre)
    own = found.inertia - found.mass[:, None, None] * point(centre)
    return mechanism._replace(
        mass=found.mass,
        centre=centre,
        inertia=np.where(changed[:, None, None], own, mechanism.inertia),
        armature=found.armature,
        gravity=np.array(robot.gravity),
        elements=mechanism.elements._replace(
            lifted=mechanism.elements.lifted * np.array(robot.mass_factor)
        ),
    )


def _changed(mechanism: Mechanism, robot: Parameters) -> NDArray[np.bool_]:
    """Which links are not as in the file, whose numbers stay to the last bit, shape (N,)."""
    changed = np.array(robot.mass_factor) != 1.0
    changed |= (np.reshape(robot.spread_factor, (-1, 3)) != 1.0).any(axis=1)
    changed |= (np.reshape(robot.centre_shift, (-1, 3)) != 0.0).any(axis=1)
    changed |= (np.reshape(robot.inertia_shift, (-1, len(MOMENTS))) != 0.0).any(axis=1)
    if robot.payload and mechanism.tool != BASE:
        changed[mechanism.tool] = True
    return changed


def point(x: Any) -> Any:
    """Inertia of a unit mass at x, shape (..., 3, 3)."""
    return inertia_of(x[..., :, None] * x[..., None, :])


def inertia_of(extent: Any) -> Any:
    """Inertia of a body by its second moments, the integral of x x^T, shape (..., 3, 3)."""
    return np.trace(extent, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - extent


def second_moments(inertia: Any) -> Any:
    """The second moments of a body by its inertia, shape (..., 3, 3)."""
    return 0.5 * np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - inertia
