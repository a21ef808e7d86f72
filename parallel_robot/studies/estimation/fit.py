"""Estimates with their uncertainty, what data do not determine, and errors without an estimate."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from parallel_robot_model.common.errors import (
    BagError,
    KinematicsError,
    RobotError,
    WholeNeededError,
)
from parallel_robot_model.common.units import DEGREES, Array


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
