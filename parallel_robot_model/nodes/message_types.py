"""Types of messages, from installed interface packages only."""

from __future__ import annotations

import importlib
import os
import re
import sys
from pathlib import Path
from typing import Any

from parallel_robot_model.common.errors import InputError, printable

NAME = re.compile(r'([a-z][a-z0-9_]*)/(msg|srv|action)/([A-Za-z][A-Za-z0-9_]*)')
INDEX = Path('share', 'ament_index', 'resource_index', 'rosidl_interfaces')


def prefixes() -> list[Path]:
    """Where packages are installed: the prefixes of ROS, then the environment of this Python."""
    given = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep)
    return [Path(prefix) for prefix in (*given, sys.prefix) if prefix]


def message_class(type_name: str) -> Any:
    """Import the class of a ROS type such as ``'std_msgs/msg/String'``.

    A name may come over the wire or from a bag: no other module than one of an interface package
    is imported for it.

    Raises:
        InputError: no such type is installed.
    """
    match = NAME.fullmatch(type_name)
    if match and any((prefix / INDEX / match[1]).is_file() for prefix in prefixes()):
        try:
            return getattr(importlib.import_module(f'{match[1]}.{match[2]}'), match[3])
        except (ImportError, AttributeError):
            pass  # as if it were not there
    raise InputError(f'no type {printable(type_name)} is installed')
