"""MJCF before MuJoCo compiles it: nothing that needs files, nothing that fills the memory."""

from __future__ import annotations

from parallel_robot_model.common.errors import printable
from parallel_robot_model.configuration.robot_file import Node, children, refused
from parallel_robot_model.mechanisms.description.parts import listed

REFUSED = {
    'include': 'is not resolved: read the file by its path',
    'attach': 'attaches another model; write it as one',
    'model': 'is another model; write it as one',
    'composite': 'is a flexible thing; a robot is of rigid bodies',
    'flexcomp': 'is a flexible thing; a robot is of rigid bodies',
    'deformable': 'is a flexible thing; a robot is of rigid bodies',
}
DROPPED = {
    'asset', 'visual', 'statistic', 'sensor', 'custom', 'size', 'light', 'camera', 'contact',
    'extension', 'plugin',
}  # fmt: skip
REFERENCES = ('material', 'fitscale')  # of shapes to assets
NAMES = {'name', 'class', 'childclass', 'model', 'joint', 'site', 'body', 'group'}
COPIES = 1000  # of bodies that <replicate> may make


def prepare(root: Node) -> list[str]:
    """Remove from a tree of MJCF what has no part in masses and joints.

    Args:
        root: The element <mujoco>, which is changed.

    Returns:
        What was left out that moves a robot, for people.

    Raises:
        InputError: an element needs other files, or has no place in a robot.
    """
    doubts: list[str] = []
    _prune(root, 1, doubts)
    _drop_cables(root, doubts)
    for compiler in root.iter('compiler'):
        for key in ('balanceinertia', 'boundmass', 'boundinertia', 'settotalmass'):
            if compiler.get(key, 'false') not in ('false', '0', '-1'):
                doubts.append(f'the file asks for {key}, so its masses or inertias are changed')
    last = Node('compiler', fusestatic='false', discardvisual='false')
    last.append(Node('lengthrange', mode='none'))
    root.append(last)
    return doubts


def _drop_cables(root: Node, doubts: list[str]) -> None:
    """Remove tendons that wind around shapes, and what drives or ties them."""
    names = set()
    for tendons in children(root, 'tendon'):
        for cable in children(tendons, 'spatial'):
            names.add(cable.get('name', ''))
            tendons.remove(cable)
    for parent in children(root, 'actuator') + children(root, 'equality'):
        for node in children(parent):
            if {node.get('tendon', node.get('tendon1')), node.get('tendon2')} & names:
                parent.remove(node)
    if names:
        doubts.append(f'tendons in space are left out, and what drives them: {listed(names)}')


def _prune(node: Node, copies: int, doubts: list[str]) -> None:
    """Refuse, remove and clean what stands in an element."""
    if node.tag == 'replicate':
        count = node.get('count', '1').strip()
        copies *= int(count) if count.isdecimal() and len(count) < 9 else COPIES + 1
        if copies > COPIES:
            raise refused(node, f'makes more than {COPIES} copies')
    for name in REFERENCES:
        node.attrib.pop(name, None)
    for name, value in node.items():
        if name not in NAMES and 'nan' in value.lower().split():
            raise refused(node, f'{name}={printable(value)!r} is not a number')
    for child in children(node):
        tag = str(child.tag)
        if tag in REFUSED:
            raise refused(child, REFUSED[tag])
        if tag in DROPPED:
            node.remove(child)
            if tag == 'plugin':
                doubts.append(f'a plugin in {printable(node.tag)} is left out')
        else:
            _prune(child, copies, doubts)
