"""Logarithm and powers."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.compiler.elementary import float_bits
from parallel_robot_model.compiler.elementary.exponential import (
    LN_2,
    LN_2_REST,
    OVERFLOW,
    exponential,
    limited_exponential,
)
from parallel_robot_model.compiler.elementary.float_bits import (
    FRACTION,
    bits_of,
    exact_product,
    exact_sum,
    float_of,
)
from parallel_robot_model.compiler.kernels import inner, merged

CENTRES, LOWEST, HIGHEST = 64, 45, 91  # of the mantissa, in units of 1/64
LEAST = bits_of(0.704)  # least mantissa: to twice that
NORMAL, RAISED = 2.0**-1022, 54  # numbers below are made larger by 2^54
RAISE = 2.0**RAISED
UPPER = -(1 << 21)  # bits of a float that leave it 32 digits
LARGEST = 2.0**66  # exponents from here on: only the power of 1 is neither 0 nor infinite
PLACES = 40  # of the first part of logarithms


def _near(j: int) -> int:
    """The inverse of a centre, in units of 1/512."""
    return round(512 * CENTRES / j)


INVERSE = np.array([_near(max(j, 1)) / 512.0 for j in range(HIGHEST + 1)])
LOGARITHM = np.array(
    [
        float_bits.logarithm(512, _near(j), PLACES) if j >= LOWEST else (0.0, 0.0)
        for j in range(HIGHEST + 1)
    ]
)


@inner
def log(x: float) -> float:
    """Natural logarithm, with an error of less than 1 unit in the last place.

    That of a power of two, that of a centre near the mantissa, and a polynomial of what is left.

    Source:
        Tang (1990), Table-driven implementation of the logarithm function, ACM TOMS 16(4). The
        coefficients interpolate the function at Chebyshev's points, up to 1/64.
    """
    if not 0.0 < x < math.inf:
        if x == 0.0:
            return -math.inf
        return x if x > 0.0 else math.nan
    return _any_logarithm(x)[0]


@inner
def power(x: float, y: float) -> float:
    """x^y, with an error of less than 1 unit in the last place: e^(y log x) with two floats.

    Special values are those of IEEE 754.
    """
    if NORMAL <= x < math.inf and abs(y) < LARGEST:
        high, low = _logarithm(x, 0)
        product, error = exact_product(y, high)
        if abs(product) < OVERFLOW - 1.0:
            return exponential(product, error + y * low)
    return _special_power(x, y)


@inner
def _special_power(x: float, y: float) -> float:
    """x^y of any two numbers."""
    if y == 0.0 or x == 1.0:
        return 1.0
    if x != x or y != y:
        return math.nan
    size = abs(x)
    whole = np.floor(y) == y
    negative = math.copysign(1.0, x) < 0.0 and whole and np.floor(0.5 * y) != 0.5 * y
    if size == 1.0:
        value = 1.0
    elif size == 0.0 or size == math.inf or abs(y) >= LARGEST:
        value = math.inf if (size > 1.0) == (y > 0.0) else 0.0
    else:
        high, low = _any_logarithm(size)
        product, error = exact_product(y, high)
        value = limited_exponential(product, error + y * low)
    if x < 0.0 and not whole and size < math.inf:
        return math.nan
    return -value if negative else value


@merged
def _any_logarithm(x: float) -> tuple[float, float]:
    """Natural logarithm of a positive number as a sum."""
    return _logarithm(x * RAISE, RAISED) if x < NORMAL else _logarithm(x, 0)


@merged
def _logarithm(x: float, shift: int) -> tuple[float, float]:
    """Natural logarithm of x / 2^shift as a sum, x >= NORMAL."""
    bits = bits_of(x)
    k = (bits - LEAST) >> FRACTION
    mantissa = float_of(bits - (k << FRACTION))
    j = int(mantissa * CENTRES + 0.5)
    inverse = INVERSE[j]
    upper = float_of(bits_of(mantissa) & UPPER)
    # mantissa * inverse - 1 = r + r_rest, without an error.
    r, r_rest = exact_sum(upper * inverse - 1.0, (mantissa - upper) * inverse)
    r_upper = float_of(bits_of(r) & UPPER << 6)
    half = 0.5 * r_upper * r_upper
    half_rest = 0.5 * (r - r_upper) * (r + r_upper)
    z = r * r
    p = (
        (0.3333333333333333 + r * -0.2500000000001592)
        + z * (0.20000000000014476 + r * -0.16666666144953557)
        + (z * z) * ((0.14285713811427228 + r * -0.12504273547730665) + z * 0.11114996169705095)
    )
    n = float(k - shift)
    value, first = exact_sum(n * LN_2 + LOGARITHM[j, 0], r)
    value, second = exact_sum(value, -half)
    rest = n * LN_2_REST + LOGARITHM[j, 1]
    rest += (first + second) + (r_rest * (1.0 - r) - half_rest) + (r * z) * p
    total = value + rest
    return total, (value - total) + rest
