"""A described machine as a tree of links: its loops are cut, its passive joints close them."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.home import posture
from parallel_robot_model.mechanisms.description.machine import Machine
from parallel_robot_model.mechanisms.description.parts import WORLD, Description, Frame
from parallel_robot_model.mechanisms.description.tree import build
from parallel_robot_model.mechanisms.mechanism import BASE, SLIDE, Mechanism
from parallel_robot_model.mechanisms.skeleton import lines, positions_of
from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.robots.described.parameters import Parameters
from parallel_robot_model.robots.link import FIXED, SLIDES, TURNS, Link

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
        made, mechanism = self._robot.machine(robot), self._robot.mechanism(robot)
        description = self._robot.description
        hosts = build(description, posture(description, robot.home)).hosts
        bodies = [body.name for body in description.bodies]
        names, fixed = _names(made.names, bodies, hosts)
        given = dict(zip(mechanism.actuated.tolist(), joints, strict=True))
        joint_names = [given.get(k, name) for k, name in enumerate(made.names)]
        travel = zip(robot.lower, robot.upper, strict=True)
        ends = dict(zip(mechanism.actuated.tolist(), travel, strict=True))
        drawn = defaultdict(list)
        for line in lines(mechanism):
            if line.ends[0].tobytes() != line.ends[1].tobytes():  # of the way of a slide alone
                drawn[line.link].append(tuple(map(_numbers, line.ends)))
        moving = [
            _moving(mechanism, k, names, joint_names[k])._replace(
                lines=tuple(drawn[k]), **({'travel': ends[k]} if k in ends else {})
            )
            for k in range(len(names))
        ]
        return (*moving, *(_fixed(name, hosts[k], names) for name, k in fixed))

    def angles(self, robot: Parameters, pose: Array, position: Array) -> Array:
        """Positions of the joints that move [rad or m], shape (..., N); NaN in a fault."""
        mechanism = self._robot.placed(robot)
        rows = np.reshape(position, (-1, position.shape[-1]))
        found, _ = positions_of(mechanism, rows)
        return found.reshape(*position.shape[:-1], -1)


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


def _moving(mechanism: Mechanism, k: int, names: list[str], joint: str) -> Link:
    parent = int(mechanism.parent[k])
    return Link(
        names[k],
        FRAME if parent == BASE else names[parent],
        joint,
        _numbers(mechanism.origin[k]),
        float(mechanism.mass[k]),
        _numbers(mechanism.centre[k]),
        _numbers(mechanism.inertia[k][UPPER]),
        (),
        _quaternion(mechanism.rotation[k]),
        _numbers(mechanism.axis[k]),
        SLIDES if mechanism.kind[k] == SLIDE else TURNS,
    )


def _fixed(name: str, host: Frame, names: list[str]) -> Link:
    """The frame of a body that no joint moves against its link."""
    parent = FRAME if host.body == WORLD else names[host.body]
    nothing = 0.0, (0.0, 0.0, 0.0), 0.0, ()
    link = Link(name, parent, f'{name}_fixed', _numbers(host.position), *nothing)
    return link._replace(rotation=_quaternion(host.rotation), kind=FIXED)


def _quaternion(rotation: Array) -> Any:
    return _numbers(Rotation.from_matrix(rotation).as_quat(canonical=True))


def _numbers(values: Array) -> Any:
    return tuple(map(float, values))
