"""Custom laws: control laws from files that are not part of the suite, Python or foreign."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from types import ModuleType
from typing import cast

from parallel_robot_control.contract import Law
from parallel_robot_control.foreign import source
from parallel_robot_control.prepared_laws import law_titles
from parallel_robot_model.processes import custom_module
from parallel_robot_model.processes.child_process import TRIAL_LIMIT, trial_step
from parallel_robot_model.processes.custom_module import RAISED

NEEDED = ('Gains', 'initial_memory', 'update')


def is_file(law: str) -> bool:
    """Whether a law is given as a file, by how the name ends."""
    return law.endswith('.py') or source.is_foreign(law)


def load(path: str) -> tuple[str, Law]:
    """Import a law file once.

    Args:
        path: The file; its stem is the name of the law.

    Returns:
        Name and module.

    Raises:
        InputError: the file does not exist, cannot be imported or is not a law.
    """
    stands_for = source.source_of if source.is_foreign(path) else None
    name, law = custom_module.load(path, 'custom_laws', NEEDED, ('Gains',), rehearse, stands_for)
    law_titles.check(name, law)
    return name, cast(Law, law)


def rehearse(law: ModuleType) -> None:
    """Call what a law has in Python; what it raises is reported where it is called again."""
    with contextlib.suppress(*RAISED), trial_step('judge', TRIAL_LIMIT):
        law.judge(law.Gains())
    with contextlib.suppress(*RAISED), trial_step('initial_memory', TRIAL_LIMIT):
        law.initial_memory(3)


def custom_laws(paths: Sequence[str]) -> dict[str, Law]:
    """Custom laws from their files, by name."""
    return dict(map(load, paths))
