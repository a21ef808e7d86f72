"""Options that do not go together with what is asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from parallel_robot_model.common.errors import InputError


def refuse(options: Mapping[str, Any], refused: Iterable[str], why: str) -> None:
    """Refuse some options.

    Args:
        options: What was given, by the names of the command's options; None, False or an empty
            list, tuple or mapping where nothing was.
        refused: Names of those that must not be given.
        why: The line that says so, with {} for the name.

    Raises:
        InputError: one of them was given.
    """
    for option in refused:
        given = options.get(option)
        if not (given is None or given is False or given in ([], {}, ())):
            raise InputError(why.format(f'--{option}'))
