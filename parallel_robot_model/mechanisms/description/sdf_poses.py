"""Where the links, joints and frames of an SDF model are, each relative to another."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.configuration.robot_file import Node, children, refused
from parallel_robot_model.mechanisms.description.graph import (
    child,
    inverse,
    name_of,
    numbers,
    turned,
    unknown,
)
from parallel_robot_model.mechanisms.description.parts import WORLD, Frame
from parallel_robot_model.mechanisms.description.tree import joined

OWN = '__model__'  # the frame of the model
WORLD_NAME = 'world'


def pose(node: Node | None) -> Frame:
    """The frame that an element <pose> gives.

    Raises:
        InputError: it holds no numbers.
    """
    if node is None or not (node.text or '').strip():
        return Frame(WORLD)
    if node.get('rotation_format', 'euler_rpy') != 'euler_rpy':
        raise refused(node, 'must be x y z roll pitch yaw')
    x, y, z, *angles = numbers(node, node.text or '', 'pose', 6)
    if node.get('degrees') == 'true':
        angles = [float(np.radians(angle)) for angle in angles]
    return Frame(WORLD, turned(*angles), np.array([x, y, z]))


class Poses:
    """Frames of a model in the world at the zero of its joints.

    Attributes:
        model: The frame of the model.
        axes_in_model: Whether axes of joints are seen from it.
    """

    def __init__(self, model: Node, axes_in_model: bool) -> None:
        """Note what has a name.

        Args:
            model: The element <model>.
            axes_in_model: Whether axes of joints are seen from the model.
        """
        self._nodes = {
            name_of(node): node
            for tag in ('frame', 'joint', 'link')
            for node in children(model, tag)
        }
        self.model, self.axes_in_model = pose(child(model, 'pose')), axes_in_model
        self._found: dict[str, Frame] = {}

    def of_link(self, name: str) -> Frame:
        """A link, or the world."""
        return Frame(WORLD) if name == WORLD_NAME else self.of(self._nodes[name], name)

    def of_joint(self, node: Node) -> Frame:
        """The frame of a joint."""
        return self.of(node, name_of(node))

    def of(self, asking: Node, name: str) -> Frame:
        """What has a name.

        Raises:
            InputError: nothing has, or it is relative to itself.
        """
        chain: list[Node] = []
        while name not in self._found and name not in (OWN, WORLD_NAME):
            node = self._nodes.get(name)
            if node is None:
                raise unknown(asking, 'frame', name)
            if node in chain:
                raise refused(node, 'has a pose that is relative to itself')
            chain.append(node)
            name = _relative(node)
        frame = Frame(WORLD) if name == WORLD_NAME else self._found.get(name, self.model)
        for node in reversed(chain):
            frame = joined(frame, pose(child(node, 'pose')))
            self._found[name_of(node)] = frame
        return frame

    def on_link(self, node: Node, links: dict[str, Frame]) -> Frame:
        """A frame of the model on the link that it is attached to."""
        link = node.get('attached_to', '')
        seen = set()
        while link in self._nodes and link not in links and link not in seen:
            seen.add(link)
            link = self._nodes[link].get('attached_to', '')
        if link not in links:
            return self.of(node, name_of(node))
        return joined(
            links[link], joined(inverse(self.of_link(link)), self.of(node, name_of(node)))
        )


def _relative(node: Node) -> str:
    """The name of what the pose of an element is relative to."""
    own = child(node, 'pose')
    named = '' if own is None else own.get('relative_to') or own.get('frame') or ''
    if named or node.tag == 'link':
        return named or OWN
    if node.tag == 'joint':
        carried = child(node, 'child')
        return OWN if carried is None else (carried.text or '').strip()
    return node.get('attached_to') or OWN
