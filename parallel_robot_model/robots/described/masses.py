"""Masses of a machine as its parameters have them; of complex numbers, too, to differentiate."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_model.common.errors import KinematicsError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.closing import close
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.mechanisms.dynamics import BodyMotions, body_motions, model
from parallel_robot_model.mechanisms.mechanism import BASE, FOUND, HINGE, Mechanism
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.described.parameters import FAULTS, Parameters


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
        elements=mechanism.elements._replace(
            lifted=mechanism.elements.lifted * np.array(robot.mass_factor)
        ),
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


# Equations of motion of any machine, linear in ten numbers of each link and in the rotors.
#
# In the frame of a link, with w and alpha its rate and angular acceleration, a the acceleration of
# its origin against gravity, and J_v, J_w the motion of that origin and the rate by those of the
# actuated joints:
#
#     torque = J_v^T f + J_w^T n
#     f = m a + alpha x h + w x (w x h),  n = h x a + I alpha + w x (I w)
#
# Source:
#     Atkeson, An, Hollerbach (1986), Estimation of inertial parameters of manipulator loads and
#     links, Int. J. Robotics Research 5(3), for each link; that of a closed chain by the principle
#     of virtual power.

MOMENTS = {
    'Ixx': (0, 0), 'Ixy': (0, 1), 'Ixz': (0, 2), 'Iyy': (1, 1), 'Iyz': (1, 2), 'Izz': (2, 2),
}  # fmt: skip
SAMPLES = 1000  # at once, which bounds the memory


class LinearMachine:
    """See :class:`parallel_robot_model.robots.contract.LinearModel`."""

    NAMES = (
        'of the link that a joint moves, in its frame: mass m, mass times centre of mass mx, my, '
        'mz, moments of inertia about its origin Ixx ... Izz; rotor: of the joint; passive: share '
        "of what the file's springs, dampers, tendons and lifts do"
    )

    def __init__(
        self,
        machine: Callable[[Parameters], Machine],
        mechanism: Callable[[Parameters], Mechanism],
    ) -> None:
        """Take the functions that give the machine of parameters, of the file and as they say."""
        self._machine, self._mechanism = machine, mechanism

    def units(self, robot: Parameters) -> dict[str, str]:
        """Names with units: moments of all links, centres, masses, rotors."""
        return {name: unit for names, *_ in self._parts(robot) for name, unit in names.items()}

    def values(self, robot: Parameters) -> Array:
        """These numbers, shape (P,)."""
        return np.concatenate([values for _, values, _ in self._parts(robot)])

    def sizes(self, robot: Parameters) -> Array:
        """Magnitudes, to which errors are compared also where a number is zero, shape (P,)."""
        return np.concatenate([sizes for *_, sizes in self._parts(robot)])

    def _parts(self, robot: Parameters) -> Iterator[tuple[dict[str, str], Array, Array]]:
        """Names with units, numbers and their magnitudes, those of a kind together."""
        made, links, rotors = self._machine(robot), self._links(robot), self._rotors(robot)
        found, names = masses(made.mechanism, robot), [printable(made.names[i]) for i in links]
        mass, inertia = found.mass[links], found.inertia[links]
        size = 0.5 * np.trace(inertia, axis1=1, axis2=2)
        moments = np.stack([inertia[:, a, b] for a, b in MOMENTS.values()], axis=1).ravel()
        keys = {f'{key}[{name}]': 'kg m^2' for name in names for key in MOMENTS}
        yield keys, moments, np.repeat(size, len(MOMENTS))
        keys = {f'm{axis}[{name}]': 'kg m' for name in names for axis in 'xyz'}
        yield keys, found.moment[links].ravel(), np.repeat(np.sqrt(size * mass), 3)
        yield {f'm[{name}]': 'kg' for name in names}, mass, mass
        kinds = made.mechanism.kind
        units = {i: 'kg m^2' if kinds[i] == HINGE else 'kg' for i in rotors}
        keys = {f'rotor[{printable(made.names[i])}]': unit for i, unit in units.items()}
        yield keys, found.armature[rotors], found.armature[rotors]
        share = dict.fromkeys(self._passive(robot), '')
        yield share, np.ones(len(share)), np.ones(len(share))

    def free(self, robot: Parameters) -> dict[str, tuple[float, float]]:
        """Masses are positive, their centres within a length of the machine."""
        length = self._machine(robot).mechanism.length
        positive = 'mass_factor', 'spread_factor', 'armature', 'payload'
        return dict.fromkeys(positive, (0.0, np.inf)) | {'centre_shift': (-length, length)}

    def regressor(
        self, robot: Parameters, pose: Array, position: Array, velocity: Array, acceleration: Array
    ) -> Array:
        """Y at each sample, shape (N, n, P); arguments as in LinearModel.

        Raises:
            KinematicsError: the loops cannot be closed at a sample.
        """
        mechanism = self._mechanism(robot)
        links, rotors = self._links(robot), self._rotors(robot)
        inertial, passive = (len(MOMENTS) + 4) * len(links) + len(rotors), self._passive(robot)
        Y = np.zeros((*position.shape, inertial + len(passive)))
        moved = body_motions(mechanism, position, velocity, acceleration)
        lost = np.flatnonzero(moved.fault != FOUND)
        if lost.size:
            raise KinematicsError(f'{FAULTS[int(moved.fault[lost[0]])].text} (sample {lost[0]})')
        for first in range(0, len(Y), SAMPLES):
            part = slice(first, first + SAMPLES)
            some = BodyMotions._make(each[part] for each in moved)
            columns = [_columns(mechanism, some, i) for i in links]
            moments, arms, weights = zip(*columns, strict=True)
            felt = some.W[:, rotors] * some.joint[:, rotors, None]
            Y[part, :, :inertial] = np.concatenate(
                [*moments, *arms, *weights, np.swapaxes(felt, 1, 2)], axis=2
            )
        if passive:
            Y[..., -1] = passive_torques(mechanism, position, velocity, acceleration)
        return Y

    def _links(self, robot: Parameters) -> list[int]:
        """Links that weigh something."""
        of_file = self._machine(robot).mechanism
        heavy = (of_file.mass != 0.0) | (of_file.inertia != 0.0).any(axis=(1, 2))
        if robot.payload and of_file.tool != BASE:
            heavy[of_file.tool] = True
        return [int(i) for i in np.flatnonzero(heavy)]

    def _passive(self, robot: Parameters) -> list[str]:
        """The name of the share of passive forces, if the machine has such forces."""
        lifted, _, ball, ratio, *_ = self._machine(robot).mechanism.elements
        return ['passive'] if lifted.any() or ball.any() or len(ratio) else []

    def _rotors(self, robot: Parameters) -> list[int]:
        """Joints with a rotor."""
        of_file = self._machine(robot).mechanism
        armature = of_file.armature != 0.0
        armature[of_file.actuated] = np.array(robot.armature) != 0.0
        return [int(i) for i in np.flatnonzero(armature)]


def passive_torques(
    mechanism: Mechanism, position: Array, velocity: Array, acceleration: Array
) -> Array:
    """Torques of its elements alone at states of the actuated joints, all of shape (K, n)."""
    bare = mechanism._replace(
        mass=0.0 * mechanism.mass, inertia=0.0 * mechanism.inertia, armature=0.0 * mechanism.mass
    )
    machine, work = boxed(bare)
    n, out = position.shape[1], np.zeros(position.shape)
    M, Q = np.zeros((2, n, n))
    for k in range(len(position)):
        close(machine, work, np.ascontiguousarray(position[k]))
        model(machine, work, np.ascontiguousarray(velocity[k]), M, Q, out[k])
        out[k] += M @ acceleration[k] + Q @ velocity[k]
    return out


def _columns(mechanism: Mechanism, moved: BodyMotions, link: int) -> tuple[Array, Array, Array]:
    """Torques by the moments, the centre and the mass of a link, shape (K, n, 6), 3 and 1."""
    back = np.swapaxes(moved.rotation[:, link], 1, 2)
    origin = moved.origin[:, link]

    def turned(x: Array) -> Array:
        found: Array = (back @ x[..., None])[..., 0]
        return found

    def rate(spatial: Array) -> Array:
        """Linear part of a spatial vector at the origin of the link."""
        return spatial[:, 3:] + np.cross(spatial[:, :3], origin)

    spin, speed = moved.V[:, link, :3], rate(moved.V[:, link])
    w, alpha = turned(spin), turned(moved.A[:, link, :3])
    a = turned(rate(moved.A[:, link]) + np.cross(spin, speed) - mechanism.gravity)
    motion = np.zeros((*moved.W[:, 0].shape, 6))  # of the link by the actuated joints
    j = link
    while j != BASE:
        motion += moved.W[:, j, :, None] * moved.S[:, j, None]
        j = int(mechanism.parent[j])
    J_w = motion[..., :3] @ moved.rotation[:, link]
    linear = motion[..., 3:] + np.cross(motion[..., :3], origin[:, None])
    J_v = linear @ moved.rotation[:, link]
    W = _skew(w)
    moments = J_w @ (_products(alpha) + W @ _products(w))
    arms = J_v @ (_skew(alpha) + W @ W) - J_w @ _skew(a)
    return moments, arms, J_v @ a[..., None]


def _skew(x: Array) -> Array:
    """x times, as a matrix, shape (K, 3, 3)."""
    return np.cross(x[:, None], np.eye(3)).swapaxes(1, 2)


def _products(x: Array) -> Array:
    """I x by the MOMENTS of I, shape (K, 3, 6)."""
    out = np.zeros((len(x), 3, len(MOMENTS)))
    for column, (a, b) in enumerate(MOMENTS.values()):
        out[:, a, column] = x[:, b]
        out[:, b, column] = x[:, a]
    return out
