"""Base parameters by weighted least squares, with a covariance that holds for correlated errors.

Source:
    Newey, West (1987), A simple, positive semi-definite, heteroskedasticity and autocorrelation
    consistent covariance matrix, Econometrica 55(3); Kiefer, Vogelsang (2005), A new asymptotic
    theory for heteroskedasticity-autocorrelation robust tests, Econometric Theory 21(6).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from parallel_robot.studies.identification.regression_rows import Rows
from parallel_robot_model.common.arrays import Array

ITERATIONS = 3  # of the weights
FLOOR = 1e-9  # of the torque, the smallest error of a joint that is assumed
RANK = 1e-9  # of the largest singular value: a combination that the motion does not show
UNKNOWN = 1e3  # relative standard error of such a combination
POOR = 0.1  # relative standard error of a combination that is reported
SHOWN = 0.3  # share in a unit vector from which a parameter is named


@dataclass(frozen=True)
class Fit:
    """Least-squares estimate of the base parameters.

    Attributes:
        values: Estimates, shape (B,).
        covariance: Of the estimates, shape (B, B).
        interval: Half widths of 95 % intervals over the standard errors, shape (B,).
        condition: Condition number of the weighted regressor of parameters over their sizes.
        residual: Torques that are not explained, rms of each joint [N m], shape (n,).
    """

    values: Array
    covariance: Array
    interval: Array
    condition: float
    residual: Array

    @property
    def standard_errors(self) -> Array:
        """Standard errors of the estimates, shape (B,)."""
        return np.sqrt(np.diag(self.covariance))


def fit(rows: Rows, nominal: Array, scale: Array) -> Fit:
    """Estimate the base parameters.

    Args:
        rows: Rows of the regression.
        nominal: Values that a combination keeps which the motion does not show, shape (B,).
        scale: Sizes of the parameters, shape (B,).
    """
    Y, error = rows.Y * scale, rows.torque - rows.Y @ nominal
    floor = FLOOR * np.sqrt(np.mean(rows.torque**2)) + 1e-15
    weight = np.eye(error.shape[1])
    for _ in range(ITERATIONS):
        change, condition = _solve(Y, weight, error)
        left = error - Y @ change
        spread = _spread(left, rows.known)
        weight = np.linalg.inv(spread + floor**2 * np.eye(len(spread)))
    change, condition = _solve(Y, weight, error)
    left = error - Y @ change
    A = Y.transpose(0, 2, 1) @ weight
    information = np.einsum('tpi,tiq->pq', A, Y)
    bread, unknown = _inverse(information)
    # A row pulls the fit towards itself: its residual is that of a fit without it (jackknife).
    leverage = Y @ bread @ A
    without = np.linalg.solve(np.eye(Y.shape[1]) - leverage, left[..., np.newaxis])[..., 0]
    scores = np.einsum('tpi,ti->tp', A, without)
    meat, lags = _long_run(scores, rows.stretch)
    # Few rows say most about a parameter: their effective number counts.
    pull = ((bread @ A) ** 2).sum(axis=2)
    share = np.minimum(lags * (pull**2).sum(axis=0) / (pull.sum(axis=0) ** 2 + 1e-300), 1.0)
    covariance = bread @ meat @ bread + UNKNOWN**2 * unknown
    degrees = max(int(rows.known.sum()) - len(nominal), 1)
    return Fit(
        nominal + scale * change,
        covariance * np.outer(scale, scale),
        stats.t.ppf(0.975, degrees) + 2.9694 * share + 0.4160 * share**2,
        condition,
        rms(left, rows.known),
    )


def _spread(left: Array, known: NDArray[np.bool_]) -> Array:
    """Covariance of what is left of the torques [N^2 m^2], shape (n, n).

    Joints that stand still at different times are seldom known together. Where the mean over those
    times is no covariance, as of errors that are much alike, that over the times of each joint is.
    """
    total = np.einsum('ti,tj->ij', left, left)
    together = np.maximum(known.T.astype(float) @ known, 1.0)
    found = total / together
    if np.linalg.eigvalsh(found)[0] > 0.0:
        return np.asarray(found)
    alone = np.diag(together)
    return np.asarray(total / np.sqrt(np.outer(alone, alone)))


def rms(values: Array, known: NDArray[np.bool_]) -> Array:
    """Root mean square of each joint over the rows in which it is known, shape (n,)."""
    return np.sqrt((values**2 * known).sum(axis=0) / np.maximum(known.sum(axis=0), 1))


def poorly_determined(fit: Fit, names: tuple[str, ...], scale: Array) -> list[tuple[str, float]]:
    """Combinations whose relative standard error is large, the worst first, with that error.

    They are eigenvectors of the covariance of the parameters over their sizes.
    """
    relative = fit.covariance / np.outer(scale, scale)
    alone = np.diag(relative) > 0.99 * UNKNOWN**2  # not shown at all, whatever the others are
    found = [(name, UNKNOWN) for name, one in zip(names, alone, strict=True) if one]
    rest = np.flatnonzero(~alone)
    variances, vectors = np.linalg.eigh(relative[np.ix_(rest, rest)])
    for variance, vector in zip(variances[::-1], vectors.T[::-1], strict=True):
        error = float(np.sqrt(max(variance, 0.0)))
        if error > POOR:
            vector = vector * np.sign(vector[np.argmax(np.abs(vector))])
            parts = [
                (share, f'({names[k]})' if ' ' in names[k] else names[k])
                for share, k in zip(vector, rest, strict=True)
                if abs(share) > SHOWN
            ]
            text = ' '.join(f'{share:+.2f} {name}' for share, name in parts)
            found.append((parts[0][1].strip('()') if len(parts) == 1 else text, error))
    return found


def _solve(Y: Array, weight: Array, error: Array) -> tuple[Array, float]:
    """Weighted least squares; nothing where the rows show nothing. Also the condition number."""
    root = np.linalg.cholesky(weight).T
    flat, right = (root @ Y).reshape(-1, Y.shape[-1]), (error @ root.T).ravel()
    change, _, _, singular = np.linalg.lstsq(flat, right, rcond=RANK)
    smallest = singular[-1]
    return np.asarray(change, np.float64), float(
        singular[0] / smallest
    ) if smallest > 0.0 else np.inf


def _inverse(information: Array) -> tuple[Array, Array]:
    """Inverse where there is information, and the projector on where there is none."""
    sizes, vectors = np.linalg.eigh(information)
    shown = sizes > RANK**2 * sizes[-1]
    shown &= sizes > 1e-14 * sizes[-1]
    some, none = vectors[:, shown], vectors[:, ~shown]
    return np.asarray((some / sizes[shown]) @ some.T), np.asarray(none @ none.T)


def _long_run(scores: Array, stretch: NDArray[np.int64]) -> tuple[Array, int]:
    """Covariance of the sum of correlated scores, and how many lags it takes.

    Bartlett's weights, within each stretch. Intervals grow with the share of the lags in all rows
    (Kiefer, Vogelsang).
    """
    lags = int(np.ceil(4.0 * (len(scores) / 100.0) ** (2.0 / 9.0)))
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        same = stretch[lag:] == stretch[:-lag]
        cross = (scores[lag:] * same[:, np.newaxis]).T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (cross + cross.T)
    return np.asarray(total), lags + 1
