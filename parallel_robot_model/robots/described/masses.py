"""Masses of a machine as its parameters have them; of complex numbers, too, to differentiate."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.mechanisms.mechanism import BASE, Mechanism
from parallel_robot_model.robots.described.parameters import Parameters


class Masses(NamedTuple):
    """What the links weigh.

    Attributes:
        mass: Masses [kg], shape (N,).
        moment: Masses times centres of mass [kg m], shape (N, 3).
        inertia: About the origins of the links [kg m^2], shape (N, 3, 3).
        armature: Rotors as felt at the joints [kg m^2 or kg], shape (N,).
    """

    mass: Any
    moment: Any
    inertia: Any
    armature: Any


def masses(mechanism: Mechanism, robot: Parameters) -> Masses:
    """The masses of a machine.

    Args:
        mechanism: As the file has it.
        robot: What differs from the file.
    """
    root = np.sqrt(np.reshape(robot.spread_factor, (-1, 3)))
    factor = np.array(robot.mass_factor)
    mass = mechanism.mass * factor
    centre = mechanism.centre + np.reshape(robot.centre_shift, (-1, 3))
    extent = root[:, :, None] * _second_moments(mechanism.inertia) * root[:, None, :]
    own = factor[:, None, None] * _inertia(extent)
    inertia = own + mass[:, None, None] * _point(centre)
    armature = mechanism.armature.astype(np.result_type(np.array(robot.armature), float))
    armature[mechanism.actuated] = robot.armature
    carries = np.arange(len(mass)) == mechanism.tool
    load = carries * np.array(robot.payload) if mechanism.tool != BASE else 0.0 * mass
    point = mechanism.tool_point
    return Masses(
        mass + load,
        mass[:, None] * centre + load[:, None] * point,
        inertia + load[:, None, None] * _point(point),
        armature,
    )


def weighing(mechanism: Mechanism, robot: Parameters) -> Mechanism:
    """The mechanism of a file with the masses and the gravity of the parameters."""
    found, changed = masses(mechanism, robot), _changed(mechanism, robot)
    heavy = np.where(found.mass != 0.0, found.mass, 1.0)
    centre = np.where(changed[:, None], found.moment / heavy[:, None], mechanism.centre)
    own = found.inertia - found.mass[:, None, None] * _point(centre)
    return mechanism._replace(
        mass=found.mass,
        centre=centre,
        inertia=np.where(changed[:, None, None], own, mechanism.inertia),
        armature=found.armature,
        gravity=np.array(robot.gravity),
    )


def _changed(mechanism: Mechanism, robot: Parameters) -> NDArray[np.bool_]:
    """Which links are not as in the file, whose numbers stay to the last bit, shape (N,)."""
    changed = np.array(robot.mass_factor) != 1.0
    changed |= (np.reshape(robot.spread_factor, (-1, 3)) != 1.0).any(axis=1)
    changed |= (np.reshape(robot.centre_shift, (-1, 3)) != 0.0).any(axis=1)
    if robot.payload and mechanism.tool != BASE:
        changed[mechanism.tool] = True
    return changed


def _point(x: Any) -> Any:
    """Inertia of a unit mass at x, shape (..., 3, 3)."""
    return _inertia(x[..., :, None] * x[..., None, :])


def _inertia(extent: Any) -> Any:
    """Inertia of a body by its second moments, the integral of x x^T, shape (..., 3, 3)."""
    return np.trace(extent, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - extent


def _second_moments(inertia: Any) -> Any:
    """The second moments of a body by its inertia, shape (..., 3, 3)."""
    return 0.5 * np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - inertia
