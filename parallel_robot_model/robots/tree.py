"""A robot as a tree of links, for tools that know nothing else.

A robot module may have an attribute ``tree`` with two functions: ``links(parameters, joints)``,
the links, and ``angles(parameters, pose, position)``, the positions of their joints [rad or m],
shape (..., L), at poses, shape (..., m), and actuated joints, shape (..., n). Links that are fixed
come last and have no positions. A tree with a true ``OF_JOINTS`` needs no poses. Without a tree,
the robot has no URDF and no frames. A closed chain is cut open; its angles close it again, and so
does a URDF where the tree has a function ``beside(parameters)``, see :class:`.link.Beside`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.joint_kinds import FIXED, HINGE
from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.robots.link import (
    ENDLESS,
    Beside,
    Closure,
    Link,
    Point,
    in_3d,
)
from parallel_robot_model.robots.registry import RobotModel


def links_of(robot: RobotModel, joints: tuple[str, ...]) -> tuple[Link, ...]:
    """Links of a robot.

    Args:
        robot: The robot.
        joints: Names of its actuated joints.

    Raises:
        InputError: the robot has no ``tree``.
    """
    links: tuple[Link, ...] = _tree(robot).links(robot.parameters, joints)
    return links


def angles_of(robot: RobotModel, links: Sequence[Link], pose: Array, position: Array) -> Array:
    """Positions of the joints of all links [rad or m], shape (..., L), angles in [-pi, pi).

    Args:
        robot: The robot.
        links: Its links.
        pose: Poses, shape (..., m).
        position: Actuated joints [rad], shape (..., n).

    Raises:
        InputError: the robot has no ``tree``.
    """
    angles: Array = _tree(robot).angles(robot.parameters, pose, position)
    fixed = np.zeros((*angles.shape[:-1], len(links) - angles.shape[-1]))
    angles = np.concatenate([angles, fixed], axis=-1)
    turned = np.remainder(angles + np.pi, 2.0 * np.pi) - np.pi
    return np.where([link.kind.turns != 0.0 for link in links], turned, angles)


def needs_pose(robot: RobotModel) -> bool:
    """Whether the positions of its joints need the pose."""
    return not getattr(_tree(robot), 'OF_JOINTS', False)


def has_tree(robot: RobotModel) -> bool:
    """Whether a robot has links and angles."""
    return robot.module.tree is not None


def _tree(robot: RobotModel) -> Any:
    if not has_tree(robot):
        raise InputError(f'{robot.name} says nothing of its links: it has no tree (docs/views.md)')
    return robot.module.tree


# The description of a robot that RViz, Foxglove, MuJoCo and others read: URDF.

WIDTH = 0.012  # m, of the bars of the picture
NOTHING = Beside()
COLOURS = {
    'proximal': (0.16, 0.32, 0.75),
    'distal': (0.40, 0.62, 0.90),
    'platform': (0.95, 0.60, 0.15),
}
OTHER = (0.5, 0.5, 0.5)  # colour of parts with other names
MOMENTS = ('ixx', 'ixy', 'ixz', 'iyy', 'iyz', 'izz')


def beside_of(robot: RobotModel) -> Beside:
    """What its URDF says beside its links."""
    tree = _tree(robot)
    found: Beside = tree.beside(robot.parameters) if hasattr(tree, 'beside') else NOTHING
    return found


def urdf(
    name: str, links: Sequence[Link], driven: Sequence[str] = (), beside: Beside = NOTHING
) -> str:
    """A robot as URDF; a comment names what it cannot say.

    Args:
        name: Of the robot.
        links: Its links, each after its parent.
        driven: Names of its actuated joints.
        beside: What closes its loops, and so on.
    """
    robot = Element('robot', {'name': name, 'xmlns:drake': 'http://drake.mit.edu'})
    if beside.unsaid:
        said = '; '.join(beside.unsaid).replace('--', '- -')  # XML forbids it in comments
        robot.append(ElementTree.Comment(f' not in URDF: {said} '))
    SubElement(robot, 'link', name=FRAME)
    for link in (*links, *beside.links):
        _add_link(robot, link)
        _add_joint(robot, link)
        if link.joint in driven:
            _add_motor(robot, link)
    for number, closure in enumerate(beside.closures, 1):
        _add_closure(robot, closure, f'loop_{number}')
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode', xml_declaration=True) + '\n'


def _add_link(robot: Element, link: Link) -> None:
    element = SubElement(robot, 'link', name=link.name)
    for ends in link.lines:
        (x1, y1, z1), (x2, y2, z2) = map(in_3d, ends)
        visual = SubElement(element, 'visual')
        pitch, yaw = (
            math.atan2(z1 - z2, math.hypot(x2 - x1, y2 - y1)),
            math.atan2(y2 - y1, x2 - x1),
        )
        middle = (x1 + x2) / 2.0, (y1 + y2) / 2.0, (z1 + z2) / 2.0
        _add_origin(visual, middle, (0.0, pitch, yaw))
        length = math.dist((x1, y1, z1), (x2, y2, z2))
        SubElement(SubElement(visual, 'geometry'), 'box', size=_text(length, WIDTH, WIDTH))
        part = link.name.rstrip('0123456789')
        material = SubElement(visual, 'material', name=part)
        SubElement(material, 'color', rgba=_text(*COLOURS.get(part, OTHER), 1.0))
    if (isinstance(link.inertia, tuple) and not link.mass) or link.kind == FIXED:
        return
    inertial = SubElement(element, 'inertial')
    _add_origin(inertial, link.centre)
    SubElement(inertial, 'mass', value=_text(link.mass))
    SubElement(inertial, 'inertia', _moments(link))


def _moments(link: Link) -> dict[str, str]:
    """Moments of inertia of a link; of one in a plane all are izz, which alone acts."""
    if isinstance(link.inertia, tuple):
        return {key: _text(value) for key, value in zip(MOMENTS, link.inertia, strict=True)}
    moments = dict.fromkeys(('ixx', 'iyy', 'izz'), _text(link.inertia))
    return moments | dict.fromkeys(('ixy', 'ixz', 'iyz'), '0')


def _add_joint(robot: Element, link: Link) -> None:
    acting, ends = link.acting, link.travel
    called = link.kind.urdf[min(map(abs, ends)) < ENDLESS[1]]
    joint = SubElement(robot, 'joint', name=link.joint, type=called)
    SubElement(joint, 'parent', link=link.parent)
    SubElement(joint, 'child', link=link.name)
    _add_origin(joint, link.origin, _angles(link.rotation))
    if link.kind == FIXED:
        return
    SubElement(joint, 'axis', xyz=_text(*link.axis))
    limits = {'effort': acting.effort[1], 'velocity': acting.velocity}
    limit = {key: _text(value) if math.isfinite(value) else '0' for key, value in limits.items()}
    if called != HINGE.urdf[0]:
        limit |= {'lower': _text(ends[0]), 'upper': _text(ends[1])}
    if called != HINGE.urdf[0] or limit['effort'] != '0' or limit['velocity'] != '0':
        SubElement(joint, 'limit', limit)
    damping, stiffness = sum(acting.damping[:1]), sum(acting.stiffness[:1])
    if damping or acting.coulomb:
        losses = {'damping': _text(damping), 'friction': _text(acting.coulomb)}
        SubElement(joint, 'dynamics', losses)
    if link.follows:
        other, ratio, offset = link.follows
        rule = {'joint': other, 'multiplier': _text(ratio), 'offset': _text(offset)}
        SubElement(joint, 'mimic', rule)
    if stiffness:
        gazebo = SubElement(robot, 'gazebo', reference=link.joint)
        SubElement(gazebo, 'springStiffness').text = _text(stiffness)
        SubElement(gazebo, 'springReference').text = _text(acting.rest)


def _add_motor(robot: Element, link: Link) -> None:
    transmission = SubElement(robot, 'transmission', name=f'{link.joint}_transmission')
    SubElement(transmission, 'type').text = 'transmission_interface/SimpleTransmission'
    SubElement(transmission, 'joint', name=link.joint)
    actuator = SubElement(transmission, 'actuator', name=f'{link.joint}_motor')
    if link.acting.armature:
        SubElement(actuator, 'drake:rotor_inertia', value=_text(link.acting.armature))


def _add_closure(robot: Element, closure: Closure, name: str) -> None:
    """A loop, as proposed for urdfdom; the suite reads it."""
    kind = 'spherical' if closure.rotation is None else 'fixed'
    constraint = SubElement(robot, 'constraint', name=name, type=kind)
    turns = (0.0, 0.0, 0.0), _angles(closure.rotation or (0.0, 0.0, 0.0, 1.0))
    for side, link in zip(('parent', 'child'), closure.ends, strict=True):
        SubElement(constraint, side, link=link)
    for side, point, turn in zip(('parent', 'child'), closure.points, turns, strict=True):
        _add_origin(constraint, point, turn, f'{side}_origin')


def _angles(quaternion: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """Roll, pitch and yaw of a rotation [rad]."""
    x, y, z, w = quaternion
    across = math.hypot(w * w + x * x - y * y - z * z, 2.0 * (x * y + w * z))
    pitch = math.atan2(2.0 * (w * y - x * z), across)
    if across < 1e-9:  # roll and yaw are about one axis
        return 2.0 * math.atan2(x, w), pitch, 0.0
    roll = math.atan2(2.0 * (w * x + y * z), w * w - x * x - y * y + z * z)
    return roll, pitch, math.atan2(2.0 * (x * y + w * z), w * w + x * x - y * y - z * z)


def _add_origin(
    parent: Element,
    point: Point,
    angles: tuple[float, float, float] = (0.0, 0.0, 0.0),
    tag: str = 'origin',
) -> None:
    SubElement(parent, tag, xyz=_text(*in_3d(point)), rpy=_text(*angles))


def _text(*numbers: float) -> str:
    return ' '.join(f'{number:.12g}' for number in numbers)
