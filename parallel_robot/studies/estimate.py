"""Estimates with their uncertainty, what data do not determine, and results of them as files."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml

from parallel_robot.analysis import pictures
from parallel_robot.bags import output
from parallel_robot_model.common.errors import (
    BagError,
    KinematicsError,
    RobotError,
    WholeNeededError,
)
from parallel_robot_model.common.tables import ShownResult
from parallel_robot_model.common.units import DEGREES, Array
from parallel_robot_model.configuration import config


@dataclass(frozen=True)
class Fit:
    """Least-squares estimate of some unknown."""

    values: Array  # estimates, shape (P,)
    covariance: Array  # of the estimates, shape (P, P)
    interval: Array  # half widths of 95 % intervals over the standard errors, shape (P,)
    condition: float  # condition number of the weighted and scaled regressor

    @property
    def standard_errors(self) -> Array:
        """Standard errors of the estimates, shape (P,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def half_widths(self) -> Array:
        """Half widths of their 95 % intervals, shape (P,)."""
        return np.asarray(self.interval * self.standard_errors)


@contextlib.contextmanager
def named_errors(unsolvable: str, bag: Path, doubt: str = '') -> Iterator[None]:
    """Errors of a bag with its name, and with what else is in doubt.

    Args:
        unsolvable: What to say where a matrix is singular, with {} for the reason.
        bag: The bag.
        doubt: What else may be wrong; empty: nothing.

    Raises:
        BagError: the block cannot use the bag.
    """
    try:
        yield
    except WholeNeededError:  # is read again, as a whole
        raise
    except (BagError, KinematicsError, RobotError) as error:
        once = doubt and not (DEGREES in doubt and DEGREES in str(error))
        raise BagError(f'{bag}: {error}{f"; {doubt}" if once else ""}') from None
    except np.linalg.LinAlgError as error:
        raise BagError(f'{bag}: {unsolvable.format(error)}') from None


def condition_number(singular: np.ndarray) -> float:
    """Condition number by singular values in descending order."""
    return float(singular[0] / singular[-1]) if singular[-1] > 0.0 else np.inf


def combination(shares: Array, names: Sequence[str], least: float) -> str:
    """A combination in words, without shares up to `least`, e.g. ``+0.71 l1 -0.71 (a + b)``."""
    terms = [
        (share, name) for share, name in zip(shares, names, strict=True) if abs(share) > least
    ]
    if len(terms) == 1:
        return terms[0][1]
    bracketed = (
        (share, f'({name})' if ' + ' in name or ' - ' in name else name) for share, name in terms
    )
    return ' '.join(f'{share:+.2f} {name}' for share, name in bracketed)


class WrittenResult(ShownResult):
    """A result that is some keys of the configuration."""

    content = 'robot'  # what they are
    files: Mapping[str, Path] = MappingProxyType({})  # what was written

    def groups(self) -> dict[str, dict[str, Any]]:
        """The keys and their values, by group."""
        raise NotImplementedError

    def header(self) -> list[str]:
        """How they were found, line by line: the comment of the file."""
        raise NotImplementedError

    @property
    def values(self) -> dict[str, Any]:
        """Keys of the configuration and their values."""
        return config.flat(self.groups())

    def write(self, out: Path | None, figure: Path | None = None) -> None:
        """Write YAML for ``--param-file``, and a picture: both or neither.

        Args:
            out: File of the YAML, which must not exist; None: none.
            figure: That of the picture, likewise.

        Raises:
            InputError: one exists or cannot be written there.
            RunError: the disk is full.
        """
        with contextlib.ExitStack() as written:
            if out:
                written.enter_context(output.written(out, self._content().encode()))
            if figure:
                self.save_figure(figure)
        files = {self.content: out, 'figure': figure}
        self.files = {name: path for name, path in files.items() if path}

    def file_lines(self) -> list[str]:
        """The files that were written."""
        return [f'{name:<7} {path}' for name, path in self.files.items()]

    def _content(self) -> str:
        comment = ''.join(f'# {line}\n' for line in self.header())
        return comment + yaml.safe_dump(  # lists in one line each
            self.groups(), sort_keys=False, default_flow_style=None, width=1000
        )

    def draw(self) -> Any:
        """A picture of it, as a figure of matplotlib."""
        raise NotImplementedError

    def save_figure(self, path: Path) -> None:
        """Write a picture into a file that must not exist.

        Raises:
            InputError: the suffix is of no picture format, or it cannot be written.
        """
        pictures.save(self.draw(), path)


def check_files(out: Path | None, figure: Path | None = None) -> None:
    """Refuse files of results that exist or cannot be made.

    Raises:
        InputError: with the reason.
    """
    if out:
        output.check_new(out, '--out')
    if figure:
        pictures.check_new(figure)
