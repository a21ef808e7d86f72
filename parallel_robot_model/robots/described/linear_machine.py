"""Equations of motion of any machine, linear in ten numbers of each link and in the rotors.

In the frame of a link, with w and alpha its rate and angular acceleration, a the acceleration of
its origin against gravity, and J_v, J_w the motion of that origin and the rate by those of the
actuated joints:

    torque = J_v^T f + J_w^T n
    f = m a + alpha x h + w x (w x h),  n = h x a + I alpha + w x (I w)

Source:
    Atkeson, An, Hollerbach (1986), Estimation of inertial parameters of manipulator loads and
    links, Int. J. Robotics Research 5(3), for each link; that of a closed chain by the principle
    of virtual power.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import KinematicsError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.mechanisms.dynamics import BodyMotions, body_motions, model
from parallel_robot_model.mechanisms.mechanism import BASE, FOUND, Mechanism
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.contract import Bodies
from parallel_robot_model.robots.described import bodies
from parallel_robot_model.robots.described.bodies import NumberIndices
from parallel_robot_model.robots.described.masses import MOMENTS, masses
from parallel_robot_model.robots.described.parameters import FAULTS, Parameters

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
        units = {i: 'kg m^2' if made.mechanism.turns[i] else 'kg' for i in rotors}
        keys = {f'rotor[{printable(made.names[i])}]': unit for i, unit in units.items()}
        yield keys, found.armature[rotors], found.armature[rotors]
        share = dict.fromkeys(self._passive(robot), '')
        yield share, np.ones(len(share)), np.ones(len(share))

    def bodies(self, robot: Parameters) -> Bodies:
        """Links, rotors of motors and the payload if there is one."""
        made, p, by_payload = self._machine(robot), self.values(robot), None
        if robot.payload and made.mechanism.tool != BASE:
            more = self.values(robot._replace(payload=2.0 * robot.payload))
            by_payload = (more - p) / robot.payload
        return bodies.bodies(made, robot, self._places(robot), p, by_payload)

    def parameters(self, robot: Parameters, numbers: Array) -> dict[str, Any]:
        """Links by what differs from the file, rotors and the payload."""
        mechanism = self._machine(robot).mechanism
        return bodies.parameters(mechanism, robot, self._places(robot), numbers)

    def _places(self, robot: Parameters) -> NumberIndices:
        """What of its parameters is free: what has no mass in the file gets none."""
        of_file, links = self._machine(robot).mechanism, self._links(robot)
        bare = masses(of_file, robot._replace(payload=0.0))
        count, found = len(links), {}
        for k, i in enumerate(links):
            moments = [*range(6 * k, 6 * k + 6)]
            if bare.mass[i]:
                arm = 6 * count + 3 * k
                found[i] = [*moments, arm, arm + 1, arm + 2, 9 * count + k]
            elif bare.inertia[i].any():
                found[i] = moments
        rotors = {i: 10 * count + k for k, i in enumerate(self._rotors(robot))}
        return NumberIndices(found, {i: k for i, k in rotors.items() if i in of_file.actuated})

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
        heavy |= np.array(robot.inertia_shift).reshape(-1, len(MOMENTS)).any(axis=1)
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
