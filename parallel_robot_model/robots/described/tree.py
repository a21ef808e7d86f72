"""A described machine as a tree of links: its loops are cut, its passive joints close them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.home import posture
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.mechanisms.description.parts import (
    WORLD,
    Description,
    Frame,
    listed,
)
from parallel_robot_model.mechanisms.description.tree import Tree, build
from parallel_robot_model.mechanisms.joint_kinds import FIXED
from parallel_robot_model.mechanisms.mechanism import BASE, COUPLING, ORIENTATION, Mechanism
from parallel_robot_model.mechanisms.skeleton import lines, positions_of
from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.robots.described.parameters import Parameters
from parallel_robot_model.robots.described.shifting import loops
from parallel_robot_model.robots.link import (
    ENDLESS,
    Beside,
    Closure,
    Link,
)

EARTH = (0.0, 0.0, -9.81)  # m/s^2, gravity where a URDF is read
NEAR = 1e-9  # rad or m, a position at home that is zero
UPPER = np.triu_indices(3)  # xx, xy, xz, yy, yz, zz of an inertia


class Owner(Protocol):
    """What a described robot tells its tree."""

    @property
    def description(self) -> Description:
        """What its text says."""

    def machine(self, robot: Parameters, /) -> Machine:
        """The machine with what is chosen of it."""

    def mechanism(self, robot: Parameters, /) -> Mechanism:
        """The machine with its numbers as the parameters have them."""

    def placed(self, robot: Parameters, /) -> Mechanism:
        """The same with the masses of the file."""


class DescribedTree:
    """Links and their joints; see :mod:`parallel_robot_model.robots.tree`.

    A ball is three links that turn. First come those that move, in the order of the joints of the
    machine, then those that are fixed to them.
    """

    OF_JOINTS = True

    def __init__(self, robot: Owner) -> None:
        """Prepare for a machine."""
        self._robot = robot

    def links(self, robot: Parameters, joints: tuple[str, ...]) -> tuple[Link, ...]:
        """Links with the names of the description; `joints` are those of the actuated ones."""
        made, m = self._robot.machine(robot), self._robot.mechanism(robot)
        names, fixed, tree = self._named(robot)
        joint_names = [*made.names]
        acting = [
            link.joint._replace(armature=float(rotor))
            for link, rotor in zip(tree.links, m.armature, strict=True)
        ]
        ends = {}
        for i, k in enumerate(m.actuated):  # with their motors
            joint_names[k], ends[int(k)] = joints[i], (robot.lower[i], robot.upper[i])
            acting[k] = acting[k]._replace(
                effort=(-made.effort[i], made.effort[i]), velocity=made.velocity[i],
                damping=(made.viscous[i],), coulomb=made.coulomb[i],
            )  # fmt: skip
        follows = {
            int(m.first[k]): (joint_names[m.second[k]], float(m.ratio[k]), float(m.offset[k]))
            for k in np.flatnonzero((m.closure == COUPLING) & (m.second != BASE))
        }
        drawn = defaultdict(list)
        for line in lines(m):
            if line.ends[0].tobytes() != line.ends[1].tobytes():  # of the way of a slide alone
                drawn[line.link].append(tuple(map(_numbers, line.ends)))
        moving = [
            Link(
                name=names[k],
                parent=FRAME if m.parent[k] == BASE else names[m.parent[k]],
                joint=joint_names[k],
                origin=_numbers(m.origin[k]),
                mass=float(m.mass[k]),
                centre=_numbers(m.centre[k]),
                inertia=_numbers(m.inertia[k][UPPER]),
                lines=tuple(drawn[k]),
                rotation=_quaternion(m.rotation[k]),
                axis=_numbers(m.axis[k]),
                kind=tree.links[k].kind,
                travel=ends.get(k, ENDLESS),
                acting=acting[k],
                follows=follows.get(k),
            )
            for k in range(len(names))
        ]
        return (*moving, *(_fixed(name, tree.hosts[k], names) for name, k in fixed))

    def beside(self, robot: Parameters) -> Beside:
        """What closes its loops, its tool, and what a URDF has no words for."""
        made, m = self._robot.machine(robot), self._robot.mechanism(robot)
        names, fixed, _ = self._named(robot)
        closures, turning = [], np.flatnonzero(m.closure == ORIENTATION)
        for k in (rows[0] for rows in loops(m)):
            both = m.first[k], m.second[k]
            turns = [
                m.relative_rotation[i].T for i in turning if (m.first[i], m.second[i]) == both
            ]
            first, second = (FRAME if end == BASE else names[end] for end in both)
            points = _numbers(m.first_point[k]), _numbers(m.second_point[k])
            rotation = _quaternion(turns[0]) if turns else None
            closures.append(Closure((first, second), points, rotation))
        tool = Frame(m.tool, m.tool_rotation, m.tool_point)
        named = made.tool in self._robot.description.frames
        new = named and made.tool not in {*names, *(name for name, _ in fixed)}
        positions = zip(made.names, m.home, strict=True)
        keys = {
            'home': ', '.join(f'{name}={x:.9g}' for name, x in positions if abs(x) > NEAR),
            'tool': made.tool if named else '',
            'gravity': [*robot.gravity] if robot.gravity != EARTH else '',
            'held': [*robot.held],
        }
        unsaid = [f'robot.{key}: {value}' for key, value in keys.items() if value]
        unsaid += [f'{what}: {listed(of)}' for what, of in _unsaid(self._robot.description) if of]
        return Beside(
            tuple(closures), (_fixed(made.tool, tool, names),) if new else (), tuple(unsaid)
        )

    def _named(self, robot: Parameters) -> tuple[list[str], list[tuple[str, int]], Tree]:
        """Names of links that move, bodies beside them, and the tree of the description."""
        description = self._robot.description
        tree = build(description, posture(description, robot.home))
        bodies = [body.name for body in description.bodies]
        return *_names(self._robot.machine(robot).names, bodies, tree.hosts), tree

    def angles(self, robot: Parameters, pose: Array, position: Array) -> Array:
        """Positions of the joints that move [rad or m], shape (..., N); NaN in a fault."""
        mechanism = self._robot.placed(robot)
        rows = np.reshape(position, (-1, position.shape[-1]))
        found, _ = positions_of(mechanism, rows)
        return found.reshape(*position.shape[:-1], -1)


def _unsaid(description: Description) -> Iterator[tuple[str, list[str]]]:
    """What of a description a URDF has no words for, and the names of what has it."""
    joints, motors = description.joints, description.actuators
    yield 'growing damping', [each.name for each in joints if any(each.damping[1:])]
    yield 'growing stiffness', [each.name for each in joints if any(each.stiffness[1:])]
    efforts = [(each.name, each.effort) for each in joints]
    efforts += [(each.name, each.effort) for each in motors]
    yield 'another effort to the other side', [name for name, (a, b) in efforts if a != -b]
    yield 'lag or delay of motors', [each.name for each in motors if each.lag or each.delay]
    yield 'tendons', [each.name for each in description.tendons]
    yield 'weight that is taken off', [each.name for each in description.bodies if each.lifted]


def _names(
    joints: tuple[str, ...], bodies: list[str], hosts: tuple[Frame, ...]
) -> tuple[list[str], list[tuple[str, int]]]:
    """Names of the links that move, and of the bodies beside them with their indices.

    A link has the name of the body whose frame it is, else that of its joint.
    """
    names, fixed, taken = [''] * len(joints), [], {FRAME, *bodies}
    for k, (body, host) in enumerate(zip(bodies, hosts, strict=True)):
        here = np.allclose(host.rotation, np.eye(3)) and np.allclose(host.position, 0.0)
        if body == FRAME and here and host.body == WORLD:
            continue  # it is the fixed frame
        name = _free(body, taken) if body == FRAME else body
        if here and host.body != WORLD and not names[host.body]:
            names[host.body] = name
        else:
            fixed.append((name, k))
    for k, joint in enumerate(joints):
        names[k] = names[k] or _free(joint, taken)
    return names, fixed


def _free(name: str, taken: set[str]) -> str:
    """A name that is not taken; it then is."""
    while name in taken:
        name += '_link'
    taken.add(name)
    return name


def _fixed(name: str, host: Frame, names: list[str]) -> Link:
    """The frame of a body that no joint moves against its link."""
    parent = FRAME if host.body == WORLD else names[host.body]
    return Link(
        name, parent, f'{name}_fixed', _numbers(host.position), 0.0, (0.0, 0.0, 0.0), 0.0, (),
        rotation=_quaternion(host.rotation), kind=FIXED,
    )  # fmt: skip


def _quaternion(rotation: Array) -> Any:
    return _numbers(Rotation.from_matrix(rotation).as_quat(canonical=True))


def _numbers(values: Array) -> Any:
    return tuple(map(float, values))
