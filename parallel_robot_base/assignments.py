"""Words ``KEY=VALUE`` of a command line."""

from __future__ import annotations

from typing import Any

import yaml

from parallel_robot_base.errors import InputError


def parse(assignments: list[str]) -> dict[str, Any]:
    """Read ``key=value`` words of a command line; values as in YAML.

    Raises:
        InputError: a word without '=' or with a value that YAML cannot read.
    """
    values = {}
    for word in assignments:
        key, equals, value = word.partition('=')
        if not equals or not key:
            raise InputError(f'--set takes KEY=VALUE, not {word!r}')
        try:
            values[key.strip()] = _number(yaml.safe_load(value))
        except yaml.YAMLError:
            raise InputError(f'--set {key}: {value!r} is not a YAML value') from None
    return values


def _number(value: Any) -> Any:
    """A number that YAML reads as text, such as 1e6, because it expects a decimal point."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value
