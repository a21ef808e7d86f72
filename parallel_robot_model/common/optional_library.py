"""Libraries that the suite needs for a part of what it does."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType

from parallel_robot_model.common.errors import InputError


def optional(name: str) -> ModuleType:
    """A library, imported.

    Args:
        name: Its name, or that of one of its modules.

    Raises:
        InputError: it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        library = name.partition('.')[0]
        raise InputError(f'{library} is not installed; pip install {library}') from None
