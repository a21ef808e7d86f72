"""Tables of pandas, which is optional."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from parallel_robot_base.errors import InputError

Frame = Any  # a pandas.DataFrame; pandas is untyped


def pandas() -> ModuleType:
    """The module pandas.

    Raises:
        InputError: it is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise InputError('pandas is not installed; pip install pandas') from None
    found: ModuleType = pandas
    return found
