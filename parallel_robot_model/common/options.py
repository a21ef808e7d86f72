"""Arguments of functions and options of a command line: a mistake costs one clear line."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterable
from pathlib import Path
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


# Arguments that are names or paths, of functions that Python and the command line share.


def named(what: str, given: Any) -> str:
    """A name or a path as text; `what` it is, for the error.

    Raises:
        InputError: it is something else.
    """
    return str(_text_or_path(what, 'a name or a path', given))


def path(what: str, given: Any) -> Path:
    """A path that is given as text or as a path; `what` it is, for the error.

    Raises:
        InputError: it is something else.
    """
    return Path(_text_or_path(what, 'a path', given))


def _text_or_path(what: str, wanted: str, given: Any) -> str | Path:
    if not isinstance(given, str | Path):
        raise InputError(f'{what} must be {wanted}, not {given!r}')
    return given


def optional_path(what: str, given: Any) -> Path | None:
    """A path, or None where none is given; see :func:`path`."""
    return None if given is None else path(what, given)


def paths(what: str, given: Any) -> list[Path]:
    """Paths, one or several; `what` one is, for the error.

    Raises:
        InputError: something among them is no path, or there are none.
    """
    if isinstance(given, str | Path) or not isinstance(given, Iterable):
        return [path(what, given)]
    found = [path(what, each) for each in given]
    if not found:
        raise InputError(f'{what} is needed')
    return found
