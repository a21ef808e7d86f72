"""Numbers, vectors and frames in the attributes and texts of XML."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.robot_file import Node, children, refused
from parallel_robot_model.mechanisms.description.parts import WORLD, Frame

MOMENTS = ('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz')


def child(node: Node, tag: str) -> Node | None:
    """The first element of a kind in an element."""
    return next(iter(children(node, tag)), None)


def name_of(node: Node) -> str:
    """The name of an element.

    Raises:
        InputError: it has none.
    """
    return attribute(node, 'name')


def attribute(node: Node, key: str) -> str:
    """An attribute that must be there.

    Raises:
        InputError: it is missing or empty.
    """
    value = node.get(key, '')
    if not value:
        raise refused(node, f'has no {key}')
    return value


def numbers(node: Node, text: str, what: str, count: int) -> Array:
    """Finite numbers in a text, shape (count,).

    Args:
        node: Where the text stands.
        text: Numbers and spaces.
        what: What the text is called in messages.
        count: How many there must be.

    Raises:
        InputError: it is something else.
    """
    try:
        found = np.array([float(word) for word in text.split()])
    except ValueError:
        found = np.array([])
    if len(found) != count or not np.isfinite(found).all():
        wanted = 'a finite number' if count == 1 else f'{count} finite numbers'
        raise refused(node, f'{what}={printable(text.strip())!r} must be {wanted}')
    return found


def number(node: Node | None, key: str, default: float = 0.0) -> float:
    """A number in an attribute of an element that may be missing.

    Raises:
        InputError: it is none.
    """
    text = None if node is None else node.get(key)
    if node is None or text is None:
        return default
    return float(numbers(node, text, key, 1)[0])


def vector(node: Node | None, key: str, default: tuple[float, ...]) -> Array:
    """Numbers in an attribute of an element that may be missing, as many as by default.

    Raises:
        InputError: they are none, or more or fewer.
    """
    text = None if node is None else node.get(key)
    if node is None or text is None:
        return np.array(default)
    return numbers(node, text, key, len(default))


def unit(node: Node, axis: Array) -> Array:
    """An axis of length one.

    Raises:
        InputError: it is zero.
    """
    largest = float(np.abs(axis).max())
    if not largest:
        raise refused(node, 'has an axis of zeros')
    axis = axis / largest
    return axis / np.linalg.norm(axis)


def turned(roll: float, pitch: float, yaw: float) -> Array:
    """Rotation about the fixed x, y and z axes, one after the other, shape (3, 3)."""
    if not (roll or pitch or yaw):
        return np.eye(3)
    return np.asarray(Rotation.from_euler('xyz', (roll, pitch, yaw)).as_matrix())


def symmetric(moments: Array) -> Array:
    """A symmetric matrix from ixx, iyy, izz, ixy, ixz, iyz, shape (3, 3)."""
    xx, yy, zz, xy, xz, yz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def origin(node: Node | None) -> Frame:
    """The frame that an element <origin> gives.

    Raises:
        InputError: it holds no numbers.
    """
    return Frame(
        WORLD,
        turned(*vector(node, 'rpy', (0.0, 0.0, 0.0))),
        vector(node, 'xyz', (0.0, 0.0, 0.0)),
    )


def inverse(frame: Frame) -> Frame:
    """What a frame is seen from, seen from the frame."""
    back = frame.rotation.T
    return Frame(WORLD, back, -back @ frame.position)


def unique(nodes: list[Node]) -> dict[str, Node]:
    """Elements by name.

    Raises:
        InputError: two have the same.
    """
    found: dict[str, Node] = {}
    for node in nodes:
        if (name := name_of(node)) in found:
            raise refused(node, 'stands twice')
        found[name] = node
    return found


def unknown(node: Node, kind: str, name: str) -> InputError:
    """The error that says that an element names what does not exist."""
    return refused(node, f'names an unknown {kind} {printable(name)!r}')
