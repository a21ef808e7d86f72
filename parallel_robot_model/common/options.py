"""Options of a command line: a mistake costs one line, which says what would be right."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable, Mapping
from typing import Any, NoReturn

from parallel_robot_model.common.errors import InputError, UnknownNameError

NUMBER = re.compile(r'[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?')


class Parser(argparse.ArgumentParser):
    """A parser that raises InputError instead of printing its usage and ending the process."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.register('type', float, number)
        self.register('type', int, whole_number)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Read what is known; an unknown option is refused where the others are known.

        Raises:
            InputError: an argument is wrong.
        """
        parsed, others = super().parse_known_args(args, namespace)
        known = self._option_string_actions
        for word in others:
            if word.startswith('--'):
                raise UnknownNameError('option', word.partition('=')[0], known)
        return parsed, others

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            wrong = UnknownNameError('value', str(value), map(str, action.choices))
            raise argparse.ArgumentError(action, str(wrong))

    def error(self, message: str) -> NoReturn:
        """Refuse the command line; argparse calls it.

        Raises:
            InputError: always.
        """
        if message.startswith('argument '):  # it names the option, and what is wrong with it
            raise InputError(message.removeprefix('argument '))
        raise InputError(f'{message}; {self.prog} --help lists what it takes')


def number(text: str) -> float:
    """A number on a command line.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        return float(text)
    except ValueError:
        near = NUMBER.match(text.strip().replace(',', '.'))
        raise _unlike('a number', text, near[0] if near else '') from None


def whole_number(text: str) -> int:
    """A whole number on a command line.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        return int(text)
    except ValueError:
        near = NUMBER.match(text.strip())
        value = float(near[0]) if near else 0.5
        raise _unlike('a whole number', text, f'{value:.0f}' * value.is_integer()) from None


def _unlike(wanted: str, text: str, near: str) -> argparse.ArgumentTypeError:
    hint = f'; did you mean {near}?' if near else ''
    return argparse.ArgumentTypeError(f'{wanted} is wanted, not {text!r}{hint}')


# Options that do not go together with what is asked for.


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
