"""The description of a robot from its text."""

from __future__ import annotations

import numpy as np

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration import robot_file
from parallel_robot_model.configuration.robot_file import Node
from parallel_robot_model.mechanisms.description import mjcf, parts, sdf, urdf
from parallel_robot_model.mechanisms.description.parts import Description

READERS = {'robot': urdf.read, 'sdf': sdf.read}


def read(text: str, source: str = 'description') -> Description:
    """Read what `configuration.robot_file.text_of` made of a file.

    Args:
        text: MJCF, URDF or SDF without other files.
        source: What it is called in messages.

    Raises:
        InputError: the text is none of these, or the robot has what this suite does not know.
    """
    root, merged = parsed(text, source)
    if root.tag != 'mujoco' and root.tag not in READERS:
        raise InputError(
            f'{source} begins with <{printable(root.tag)}>; the description of a robot begins '
            'with <mujoco>, <robot> or <sdf>'
        )
    with np.errstate(all='ignore'):  # of numbers that are refused next
        if root.tag == 'mujoco':
            description = mjcf.read(root, source, merged)
        else:
            description = READERS[str(root.tag)](root, source)
    parts.check_bounds(description)
    return description


def parsed(text: str, source: str) -> tuple[Node, bool]:
    """The first element of a description, and whether it was made of several files.

    Raises:
        InputError: the text is no XML.
    """
    return robot_file.parse_xml(text, source), text.startswith(f'<?{robot_file.MERGED}?>')
