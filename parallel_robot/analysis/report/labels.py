"""Names from a bag as they are written in pictures and reports."""

from __future__ import annotations

import re

from parallel_robot_control.laws import title
from parallel_robot_model.common.errors import printable

MAX_LABEL_LENGTH = 40  # characters of a name, so that it leaves room for the curves


def label(name: str) -> str:
    """A name, printable and not too long."""
    return printable(name, MAX_LABEL_LENGTH)


def law_label(name: str) -> str:
    """A law as papers write it, printable and not too long."""
    return label(title(name))


def joint_label(name: str) -> str:
    """The name of a joint, with a space before its number: 'joint 1' for 'joint1'."""
    return re.sub(r'(?<=[^\W\d])(?=\d+$)', ' ', label(name))
