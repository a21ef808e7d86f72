"""Arcus functions."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.compiler.elementary import float_bits
from parallel_robot_model.compiler.elementary.float_bits import exact_product, exact_sum, halves
from parallel_robot_model.compiler.kernels import inner, merged

CENTRES, FIRST = 32, 4  # of a ratio up to 1, in units of 1/32; below the first the centre is 0
TABLE = np.array(
    [float_bits.arctangent(j, CENTRES) if j >= FIRST else (0.0, 0.0) for j in range(CENTRES + 1)]
)
PI, PI_REST = float_bits.double(float_bits.PI, float_bits.DIGITS)
HALF_PI, HALF_PI_REST = float_bits.double(*float_bits.HALF_PI)
SMALL = 2.0**-60  # the arcus tangent of a ratio is the ratio
LARGEST, LEAST, SCALE = 2.0**500, 2.0**-500, 2.0**600  # lengths that are scaled


@inner
def atan2(y: float, x: float) -> float:
    """Angle of the direction (x, y) [rad], with an error of less than 1 unit in the last place.

    The smaller of both lengths, divided by the larger, is a ratio; arctan of a centre near it
    comes from a table, that of what is left from a polynomial.

    Source:
        Tang (1991), Table-lookup algorithms for elementary functions and their error analysis,
        ARITH 10. The coefficients interpolate the function at Chebyshev's points, up to 1/8.
    """
    if x != x or y != y:
        return math.nan
    if y == 0.0 or abs(x) == math.inf or abs(y) == math.inf:
        return math.copysign(_axis(abs(y), x), y)
    small = abs(y) / abs(x) if x > 0.0 else 1.0
    if small < SMALL:
        return math.copysign(small, y)
    angle, rest = _angle(abs(y), x)
    return math.copysign(angle + rest, y)


@inner
def atan(x: float) -> float:
    """Arcus tangent [rad], with an error of less than 1 unit in the last place."""
    return atan2(x, 1.0)


@inner
def asin(x: float) -> float:
    """Arcus sine [rad], with an error of less than 1 unit in the last place."""
    if abs(x) < SMALL:
        return x
    if not abs(x) <= 1.0:
        return math.nan
    other, rest = _other(x)
    angle, more = _angle(abs(x), other)
    return math.copysign(angle + (more - rest * abs(x)), x)


@inner
def acos(x: float) -> float:
    """Arcus cosine [rad], with an error of less than 1 unit in the last place."""
    if not abs(x) <= 1.0:
        return math.nan
    if x == 1.0:
        return 0.0
    other, rest = _other(x)
    angle, more = _angle(other, x)
    return angle + (more + rest * x)


@merged
def _other(x: float) -> tuple[float, float]:
    """sqrt(1 - x^2) as a sum, |x| <= 1."""
    square, error = exact_product(x, x)
    left, more = exact_sum(1.0, -square)
    left, more = exact_sum(left, more - error)
    root = math.sqrt(left)
    product, error = exact_product(root, root)
    return root, (((left - product) - error) + more) / (2.0 * root) if root > 0.0 else 0.0


@merged
def _axis(y: float, x: float) -> float:
    """Angle of a direction with a length that is zero or infinite, y >= 0."""
    back = math.copysign(1.0, x) < 0.0
    if y == math.inf:
        if abs(x) == math.inf:
            return 0.75 * PI if back else 0.25 * PI
        return HALF_PI
    return PI if back else 0.0


@inner
def _angle(y: float, x: float) -> tuple[float, float]:
    """Angle of a direction as a sum, y > 0, both finite."""
    short, long = min(y, abs(x)), max(y, abs(x))
    ratio = short / long
    if ratio < SMALL:
        high, low = ratio, 0.0
    else:
        if long > LARGEST:
            short, long = short / SCALE, long / SCALE
        elif long < LEAST:
            short, long = short * SCALE, long * SCALE
        j = int(ratio * CENTRES + 0.5)
        j = j if j >= FIRST else 0
        centre = j * (1.0 / CENTRES)
        upper, lower = halves(long)
        over = (short - centre * upper) - centre * lower
        below = long + centre * short
        inverse = 1.0 / below
        r = over * inverse
        product, error = exact_product(r, below)
        rest = ((over - product) - error) * inverse
        z = r * r
        w = z * z
        p = (
            (-0.3333333333333333 + z * 0.19999999999999024)
            + w * (-0.14285714285714623 + z * 0.1111111072668161)
            + (w * w)
            * ((-0.0909083861491049 + z * 0.07685661588587737) + w * -0.06354310436757105)
        )
        high = TABLE[j, 0] + r
        low = ((TABLE[j, 0] - high) + r) + (TABLE[j, 1] + (rest + (r * z) * p))
    if y > abs(x):
        turned = HALF_PI - high
        low = ((HALF_PI - turned) - high) + (HALF_PI_REST - low)
        high = turned
    if x < 0.0:
        turned = PI - high
        low = ((PI - turned) - high) + (PI_REST - low)
        high = turned
    return high, low
