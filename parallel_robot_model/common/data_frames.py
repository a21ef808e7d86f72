"""Tables of pandas, which is optional."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from parallel_robot_model.common.optional_library import optional

Frame = Any  # a pandas.DataFrame; pandas is untyped


def pandas() -> ModuleType:
    """The module pandas.

    Raises:
        InputError: it is not installed.
    """
    return optional('pandas')
