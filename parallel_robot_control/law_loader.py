"""Custom laws: control laws from Python files that are not part of the suite."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from types import ModuleType
from typing import Any, cast

from parallel_robot_base import custom_module
from parallel_robot_base.custom_module import RAISED
from parallel_robot_base.fields import defaults
from parallel_robot_base.trial_process import LIMIT, step
from parallel_robot_control.contract import Law

NEEDED = ('Gains', 'initial_memory', 'update')


def load(path: str) -> tuple[str, Law]:
    """Import a law file once.

    Args:
        path: The file; its stem is the name of the law.

    Returns:
        Name and module.

    Raises:
        InputError: the file does not exist, cannot be imported or is not a law.
    """
    name, law = custom_module.load(path, 'custom_laws', NEEDED, ('Gains',), rehearse)
    return name, cast(Law, law)


def rehearse(law: ModuleType) -> None:
    """Call what a law has in Python; what it raises is told where it is called again."""
    with contextlib.suppress(*RAISED), step('judge', LIMIT):
        law.judge(law.Gains())
    with contextlib.suppress(*RAISED), step('initial_memory', LIMIT):
        law.initial_memory(3)


def custom_laws(values: Mapping[str, Any]) -> dict[str, Law]:
    """Custom laws that a configuration names, by name."""
    return dict(map(load, values['custom_laws']))


def default_gains(values: Mapping[str, Any]) -> dict[str, Any]:
    """Defaults of the gains of the custom laws that a configuration names, by key."""
    gains: dict[str, Any] = {}
    for name, law in custom_laws(values).items():
        gains |= defaults(law.Gains, f'{name}.')
    return gains
