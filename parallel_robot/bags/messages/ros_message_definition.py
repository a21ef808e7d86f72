"""Definitions of message types as bags hold them: from rosbags, or from installed files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.nodes.connections import prefixes

SEPARATOR = '\n' + '=' * 80 + '\nMSG: {}\n'
BUILT_IN = (
    *('bool', 'byte', 'char', 'string', 'wstring', 'float32', 'float64'),
    *(f'{sign}int{bits}' for sign in ('', 'u') for bits in (8, 16, 32, 64)),
)


def definition(type_name: str) -> str:
    """Definition of a type and of all types in it.

    Args:
        type_name: ROS type, e.g. ``'std_msgs/msg/String'``.

    Raises:
        InputError: no such type is installed as a .msg file.
    """
    from rosbags.typesys import Stores, get_typestore  # slow to import

    store = get_typestore(Stores.ROS2_JAZZY)
    if type_name in store.types:
        return store.generate_msgdef(type_name, ros_version=2)[0]
    return concatenate(type_name, prefixes())


def concatenate(type_name: str, places: Sequence[Path]) -> str:
    """Join the .msg files of a type and of the types in it, each once.

    Args:
        type_name: ROS type.
        places: Where packages are installed; the first that has a file wins.

    Raises:
        InputError: a .msg file is missing.
    """
    texts: dict[str, str] = {}
    open_types = [type_name]
    while open_types:
        name = open_types.pop(0)
        if name not in texts:
            texts[name] = _read(name, places)
            open_types += _parts(name, texts[name])
    first, *others = texts
    return texts[first] + ''.join(
        SEPARATOR.format(name.replace('/msg/', '/')) + texts[name] for name in others
    )


def _read(type_name: str, places: Sequence[Path]) -> str:
    package, _, name = type_name.partition('/msg/')
    for prefix in places:
        path = prefix / 'share' / package / 'msg' / f'{name}.msg'
        if name and path.is_file():
            return path.read_text()
    raise InputError(f'{type_name} is not installed as a .msg file')


def _parts(type_name: str, text: str) -> list[str]:
    """Types of the fields that are messages; rosbags' parser refuses wide strings and CRLF."""
    found = []
    for line in text.splitlines():
        words = line.partition('#')[0].split()
        kind = words[0].partition('[')[0].partition('<=')[0] if words else ''
        if kind and kind not in BUILT_IN:
            package, _, name = kind.rpartition('/')
            package = package.removesuffix('/msg') or type_name.partition('/')[0]
            found.append(f'{package}/msg/{name}')
    return found
