"""The description of a robot that RViz, Foxglove, MuJoCo and others read: URDF."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from parallel_robot_model.messages.topics import FRAME
from parallel_robot_model.robots.link import Link, Point

WIDTH = 0.012  # m, of the bars of the picture
COLOURS = {
    'proximal': (0.16, 0.32, 0.75),
    'distal': (0.40, 0.62, 0.90),
    'platform': (0.95, 0.60, 0.15),
}
OTHER = (0.5, 0.5, 0.5)  # colour of parts with other names


def urdf(name: str, links: Sequence[Link]) -> str:
    """A robot as URDF.

    Args:
        name: Of the robot.
        links: Its links, each after its parent.
    """
    robot = Element('robot', name=name)
    SubElement(robot, 'link', name=FRAME)
    for link in links:
        _add_link(robot, link)
        _add_joint(robot, link)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding='unicode', xml_declaration=True) + '\n'


def _add_link(robot: Element, link: Link) -> None:
    element = SubElement(robot, 'link', name=link.name)
    for (x1, y1), (x2, y2) in link.lines:
        visual = SubElement(element, 'visual')
        _add_origin(visual, ((x1 + x2) / 2.0, (y1 + y2) / 2.0), math.atan2(y2 - y1, x2 - x1))
        length = math.dist((x1, y1), (x2, y2))
        SubElement(SubElement(visual, 'geometry'), 'box', size=_text(length, WIDTH, WIDTH))
        part = link.name.rstrip('0123456789')
        material = SubElement(visual, 'material', name=part)
        SubElement(material, 'color', rgba=_text(*COLOURS.get(part, OTHER), 1.0))
    inertial = SubElement(element, 'inertial')
    _add_origin(inertial, link.centre)
    SubElement(inertial, 'mass', value=_text(link.mass))
    moments = dict.fromkeys(('ixx', 'iyy', 'izz'), _text(link.inertia))  # only izz acts
    SubElement(inertial, 'inertia', moments | dict.fromkeys(('ixy', 'ixz', 'iyz'), '0'))


def _add_joint(robot: Element, link: Link) -> None:
    joint = SubElement(robot, 'joint', name=link.joint, type='continuous')
    SubElement(joint, 'parent', link=link.parent)
    SubElement(joint, 'child', link=link.name)
    _add_origin(joint, link.origin)
    SubElement(joint, 'axis', xyz='0 0 1')


def _add_origin(parent: Element, point: Point, angle: float = 0.0) -> None:
    SubElement(parent, 'origin', xyz=_text(*point, 0.0), rpy=_text(0.0, 0.0, angle))


def _text(*numbers: float) -> str:
    return ' '.join(f'{number:.12g}' for number in numbers)
