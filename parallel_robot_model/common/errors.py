"""Errors of the suite, texts fit to show in them, and libraries that are optional."""

from __future__ import annotations

import difflib
import warnings
from collections.abc import Callable, Iterable
from importlib import import_module
from signal import Signals
from types import ModuleType
from typing import Any

# Values made fit to show: foreign text on one line, numbers that can be told apart.

MAX_LENGTH = 200  # characters


def printable(value: Any, longest: int = MAX_LENGTH) -> str:
    """Safe text of a value from a foreign source.

    Args:
        value: Any value.
        longest: Characters after which the text is cut off with an ellipsis.
    """
    text = clean(str(value)[: longest + 1])
    return text if len(text) <= longest else text[: longest - 1] + '…'


def clean(text: str) -> str:
    """A text without control characters, of any length."""
    return ''.join(c if c.isprintable() else '\N{REPLACEMENT CHARACTER}' for c in text)


def distinct_texts(value: float, limit: float, digits: int = 3) -> tuple[str, str]:
    """Two numbers with as many digits as it takes to see which is larger.

    Args:
        value: One number.
        limit: The other, shown with six digits where these are enough.
        digits: Least number of significant digits of the value.
    """
    if value != limit:
        for more in range(digits, 18):
            texts = f'{value:.{more}g}', f'{limit:.{max(more, 6)}g}'
            shown, bound = map(float, texts)
            if shown > bound if value > limit else shown < bound:
                return texts
    return f'{value:.{digits}g}', f'{limit:g}'


NEAR = 0.6  # similarity of names, from 0 to 1, from which one is suggested for the other
FEW = 30  # names that a message lists
DRIVEN_OUT = 'the robot was driven out of its workspace'  # prefix of the plant's alarm, too


class ParallelRobotError(Exception):
    """Base of every error that the suite raises on purpose; its text is one clear line."""


class InputError(ParallelRobotError):
    """A value from outside is wrong; the text names the value and what would be right."""

    def __init__(self, text: str = '', key: str = '') -> None:
        # key of the parameter, or of the group of parameters, that is wrong; empty if it
        # is none. Whoever knows where it was set puts the place in front of the text
        self.key = key
        super().__init__(text)


class DescriptionWarning(UserWarning):
    """What the file of a machine says and the suite leaves out, or what of it is doubtful."""


def redirect_description_warnings(handler: Callable[[str], object]) -> None:
    """Let a function take the lines of each DescriptionWarning, until warnings are reset."""
    usual: Any = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any) -> None:
        if issubclass(category, DescriptionWarning):
            for line in str(message).split('\n'):
                handler(line)
        else:
            usual(message, category, *place)

    warnings.showwarning = show  # type: ignore[assignment]


class UnknownNameError(InputError):
    """A name that does not exist."""

    def __init__(self, kind: str, name: str, choices: Iterable[str], key: str = '') -> None:
        self.kind = kind  # what the name should have been, e.g. ``'scenario'``
        self.name = name  # the name as it was given
        self.choices = sorted(choices)  # the names that exist
        name = printable(name)
        alike = [choice for choice in self.choices if _letters(choice) == _letters(name)]
        near = alike or difflib.get_close_matches(name, self.choices, n=1, cutoff=NEAR)
        shown = ', '.join(self.choices) if len(self.choices) <= FEW else ''
        hint = f'; did you mean {near[0]!r}?' if near else ''
        super().__init__(
            f'unknown {kind} {name!r}{hint}' + (f' (known: {shown})' if shown else ''), key
        )


def _letters(name: str) -> str:
    """A name without what separates its words: smc.z and smc_z are the same but for that."""
    return ''.join(filter(str.isalnum, name))


class RobotError(InputError):
    """A robot that cannot be built: a parameter is impossible."""


class MotionError(InputError):
    """A motion that the robot cannot perform."""

    def __init__(self, reason: str, time: float, where: str, part: int | None = None) -> None:
        self.time = time  # when it fails first [s]
        # which of the robot's parts fails, 1-based; None if it is the whole robot
        self.part = part
        where = where if part is None else f'{where} {part}'
        super().__init__(f'motion refused at t = {time:.3f} s, {where}: {reason}')


class KinematicsError(ParallelRobotError):
    """A pose or a set of joint angles that has no trustworthy counterpart."""


class BagError(InputError):
    """A bag that cannot be written or read."""


class WholeNeededError(BagError):
    """A bag that can be read as a whole alone, not in windows."""


class RunError(ParallelRobotError):
    """A run that did not reach its end."""


class StoppedError(ParallelRobotError):
    """A signal that asks a command to end."""

    def __init__(self, number: int) -> None:
        # signal: its number; exit_code: what shells expect of a program that it ends
        self.signal, self.exit_code = number, 128 + number
        super().__init__(f'stopped by {Signals(number).name}')


def first_line(error: BaseException) -> str:
    """Kind of an error raised by foreign code, and the first line of its text."""
    text = next((line.strip() for line in str(error).splitlines() if line.strip()), '')
    return type(error).__name__ + (f': {printable(text)}' if text else '')


# Libraries that the suite needs for a part of what it does.


def optional(name: str, lacking: str = '') -> ModuleType:
    """A library, imported.

    Args:
        name: Its name, or that of one of its modules.
        lacking: What is said where it is not installed; empty: its name, and how to install it.

    Raises:
        InputError: it is not installed.
    """
    try:
        return import_module(name)
    except ImportError:
        library = name.partition('.')[0]
        usual = f'{library} is not installed; pip install {library}'
        raise InputError(lacking or usual) from None


# Tables of pandas, which is optional.

Frame = Any  # a pandas.DataFrame; pandas is untyped


def pandas() -> ModuleType:
    """The module pandas.

    Raises:
        InputError: it is not installed.
    """
    return optional('pandas')
