"""Words ``KEY=VALUE`` of a command line."""

from __future__ import annotations

from typing import Any

import yaml

from parallel_robot_model.common.errors import InputError, printable
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.yaml_file import kind_of


def parse(assignments: list[str], option: str = '--set') -> dict[str, Any]:
    """Read ``key=value`` words of a command line; values as in YAML. The option is for messages.

    Raises:
        InputError: a word without '=' or with a value that YAML cannot read.
    """
    values = {}
    for word in assignments:
        key, equals, value = word.partition('=')
        if not equals or not key:
            raise InputError(f'{option} takes KEY=VALUE, not {word!r}')
        try:
            read = yaml.load(value, yaml_file.Loader)  # numbers as in a file
        except (yaml.YAMLError, ValueError, RecursionError) as error:  # the 45th of a month
            shown = printable(value)
            why = f': {printable(error)}' if isinstance(error, ValueError) else ''
            raise InputError(f'{option} {key}: {shown!r} is not a YAML value{why}') from None
        if not isinstance(read, (bool, int, float, str, list, dict, type(None))):
            raise InputError(f'{option} {key}: YAML reads {kind_of(read)}; quote {value}')
        values[key.strip()] = _number(read)
    return values


def _number(value: Any) -> Any:
    """A number that YAML reads as text, such as 1e6, because it expects a decimal point."""
    if isinstance(value, str):
        try:
            return float(value)
        except ValueError:
            return value
    return value
