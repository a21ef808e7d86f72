"""Sine, cosine, tangent, and the arcus functions."""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.compiler.elementary import float_bits
from parallel_robot_model.compiler.elementary.float_bits import (
    BIAS,
    FRACTION,
    SHIFT,
    bits_of,
    exact_product,
    exact_sum,
    halves,
    power_of_two,
    quotient,
)
from parallel_robot_model.compiler.kernels import inline_llvm, internal

# Sine, cosine and tangent.

PER_QUADRANT = float_bits.rounded(float_bits.TWO_BY_PI[1], 28) + sum(
    float_bits.rounded(digit, 28 * k) for k, digit in enumerate(float_bits.TWO_BY_PI[2:4], 2)
)  # 2/pi
FIRST, SECOND, REST = float_bits.parts(*float_bits.HALF_PI, 33, 66)  # of pi/2
*_, THIRD, LAST = float_bits.parts(*float_bits.HALF_PI, 33, 66, 99)
HALF_PI, HALF_PI_REST = float_bits.double(*float_bits.HALF_PI)
LARGE = 2.0**20  # from here on the number of quadrants has more digits than FIRST leaves
NEAR = 2.0**-58  # of the number of quadrants; nearer to one of them REST has too few digits
TINY = 2.0**-27  # sin x = x
DIGITS = np.array(float_bits.TWO_BY_PI)
PER_DIGIT, MASK = float_bits.PER_DIGIT, (1 << float_bits.PER_DIGIT) - 1


@inline_llvm
def sin(x: float) -> float:
    """Sine of an angle [rad], with an error of less than 1 unit in the last place.

    The angle less the nearest multiple of pi/2, in two floats, goes into polynomials of sine and
    cosine. There is no branch before the result of usual angles, so that a compiler finds what
    sine and cosine of one angle have in common.

    Source:
        Cody, Waite (1980), Software manual for the elementary functions, for the reduction, and
        fdlibm (Ng 1993) for the polynomials with a correction. The coefficients interpolate the
        functions at Chebyshev's points, up to 1.0005 pi/4.
    """
    quadrant, high, low, sure = _reduced(x)
    value = _turned(quadrant, high, low)
    if not sure:
        value = _hard_sine(x, 0)
    return x if abs(x) < TINY else value


@inline_llvm
def cos(x: float) -> float:
    """Cosine of an angle [rad], as :func:`sin`."""
    quadrant, high, low, sure = _reduced(x)
    value = _turned(quadrant + 1, high, low)
    if not sure:
        value = _hard_sine(x, 1)
    return value


@internal
def tan(x: float) -> float:
    """Tangent of an angle [rad], 2 t / (1 - t^2) by that of half the angle, each with a rest."""
    if abs(x) < TINY:
        return x
    quadrant, high, low, sure = _reduced(x)
    if not sure:
        quadrant, high, low = _hard(x)
    over, rest = exact_sum(*_sine(0.5 * high, 0.5 * low))
    below, more = exact_sum(*_cosine(0.5 * high, 0.5 * low))
    half, of_half = quotient(over, rest, below, more)
    square, error = exact_product(half, half)
    below, more = exact_sum(1.0, -square)
    more -= error + 2.0 * half * of_half
    over, rest = 2.0 * half, 2.0 * of_half
    if quadrant & 1:
        over, rest, below, more = below, more, -over, -rest
    value, error = quotient(over, rest, below, more)
    return value + error


@inline_llvm
def _turned(quadrant: int, high: float, low: float) -> float:
    """Sine of an angle high + low in a quadrant."""
    sine, cosine = _sine(high, low), _cosine(high, low)
    value = cosine[0] + cosine[1] if quadrant & 1 else sine[0] + sine[1]
    return -value if quadrant & 2 else value


@inline_llvm
def _sine(x: float, rest: float) -> tuple[float, float]:
    """Sine of x + rest, |x| <= pi/4, as a sum."""
    z = x * x
    w = z * z
    p = (
        (-0.16666666666666666 + z * 0.008333333333333331)
        + w * (-0.0001984126984126504 + z * 2.7557319219320575e-06)
        + (w * w)
        * ((-2.5052106225992787e-08 + z * 1.6058530596390244e-10) + w * -7.586636867766497e-13)
    )
    return x, (x * z) * p + rest * (1.0 - 0.5 * z)


@inline_llvm
def _cosine(x: float, rest: float) -> tuple[float, float]:
    """Cosine of x + rest, |x| <= pi/4, as a sum."""
    z = x * x
    w = z * z
    p = (
        (0.041666666666666664 + z * -0.0013888888888887389)
        + w * (2.48015872987544e-05 + z * -2.7557317265876615e-07)
        + (w * w) * (2.087614504910828e-09 + z * -1.1382544623404267e-11)
    )
    half = 0.5 * z
    value = 1.0 - half
    return value, ((1.0 - value) - half) + (w * p - x * rest)


@inline_llvm
def _reduced(x: float) -> tuple[int, float, float, bool]:
    """Quadrant, and what is left of an angle in two floats; whether they are right."""
    shifted = x * PER_QUADRANT + SHIFT
    n = shifted - SHIFT
    left, error = exact_sum(x - n * FIRST, -n * SECOND)
    rest = error - n * REST
    high = left + rest
    low = (left - high) + rest
    sure = (abs(x) < LARGE) & (abs(high) >= abs(n) * NEAR)
    return bits_of(shifted), high, low, sure


@internal
def _hard_sine(x: float, turn: int) -> float:
    """Sine of an angle and so many quadrants."""
    quadrant, high, low = _hard(x)
    return _turned(quadrant + turn, high, low)


@internal
def _hard(x: float) -> tuple[int, float, float]:
    """Quadrant, and what is left of an angle in two floats, near a multiple of pi/2 or large."""
    if not abs(x) < math.inf:
        return 0, math.nan, math.nan
    if abs(x) >= LARGE:
        return _far(x)
    shifted = x * PER_QUADRANT + SHIFT
    n = shifted - SHIFT
    left, error = exact_sum(x - n * FIRST, -n * SECOND)
    left, more = exact_sum(left, -n * THIRD)
    rest = (error + more) - n * LAST
    high = left + rest
    return bits_of(shifted), high, (left - high) + rest


@internal
def _far(x: float) -> tuple[int, float, float]:
    """Quadrant, and what is left of a large angle in two floats.

    Of the product with 2/pi only the digits are computed that change the place in a turn.

    Source:
        Payne, Hanek (1983), Radian reduction for trigonometric functions, ACM SIGNUM 18(1).
    """
    bits = bits_of(abs(x))
    exponent = (bits >> FRACTION) - (BIAS + FRACTION)
    whole = (bits & ((1 << FRACTION) - 1)) | (1 << FRACTION)
    upper, lower = whole >> PER_DIGIT, whole & MASK
    # The product is the sum of digit_j 2^(exponent - 28 j); those before `begin` are whole turns.
    begin = max(0, (exponent + PER_DIGIT - 1) // PER_DIGIT)
    above = 0
    if begin:
        above = lower * DIGITS[begin - 1] + upper * DIGITS[begin]
    carry = 0
    seventh, carry = _digit(upper, lower, begin + 7, carry)
    sixth, carry = _digit(upper, lower, begin + 6, carry)
    fifth, carry = _digit(upper, lower, begin + 5, carry)
    fourth, carry = _digit(upper, lower, begin + 4, carry)
    third, carry = _digit(upper, lower, begin + 3, carry)
    second, carry = _digit(upper, lower, begin + 2, carry)
    first, carry = _digit(upper, lower, begin + 1, carry)
    top = carry + lower * DIGITS[begin] + upper * DIGITS[begin + 1]
    top += (above & 3) << PER_DIGIT
    places = PER_DIGIT * begin - exponent  # of `top` behind the point, 0 to 32
    quadrant = top >> places
    unit = power_of_two(-places)
    high, low = float(top & ((1 << places) - 1)) * unit, 0.0
    if high + first * unit * 2.0**-28 >= 0.5:
        quadrant += 1
        high -= 1.0
    for digit in (first, second, third, fourth, fifth, sixth, seventh):
        unit *= 2.0**-28
        high, error = exact_sum(high, digit * unit)
        low += error
    high, low = exact_sum(high, low)
    angle, rest = exact_product(high, HALF_PI)
    rest += high * HALF_PI_REST + low * HALF_PI
    angle, rest = exact_sum(angle, rest)
    if x < 0.0:
        return -quadrant, -angle, -rest
    return quadrant, angle, rest


@inline_llvm
def _digit(upper: int, lower: int, k: int, carry: int) -> tuple[int, int]:
    """Digit `k` of the product with 2/pi, and what goes on to the next one."""
    total = carry + lower * DIGITS[k] + upper * DIGITS[k + 1]
    return total & MASK, total >> PER_DIGIT


# Arcus functions.

# Of a ratio up to 1, in units of 1/32; below the first the centre is 0.
CENTRES, FIRST_CENTRE = 32, 4
TABLE = np.array(
    [
        float_bits.arctangent(j, CENTRES) if j >= FIRST_CENTRE else (0.0, 0.0)
        for j in range(CENTRES + 1)
    ]
)
PI, PI_REST = float_bits.double(float_bits.PI, float_bits.DIGITS)
SMALL = 2.0**-60  # the arcus tangent of a ratio is the ratio
LARGEST, LEAST, SCALE = 2.0**500, 2.0**-500, 2.0**600  # lengths that are scaled


@internal
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


@internal
def atan(x: float) -> float:
    """Arcus tangent [rad], with an error of less than 1 unit in the last place."""
    return atan2(x, 1.0)


@internal
def asin(x: float) -> float:
    """Arcus sine [rad], with an error of less than 1 unit in the last place."""
    if abs(x) < SMALL:
        return x
    if not abs(x) <= 1.0:
        return math.nan
    other, rest = _other(x)
    angle, more = _angle(abs(x), other)
    return math.copysign(angle + (more - rest * abs(x)), x)


@internal
def acos(x: float) -> float:
    """Arcus cosine [rad], with an error of less than 1 unit in the last place."""
    if not abs(x) <= 1.0:
        return math.nan
    if x == 1.0:
        return 0.0
    other, rest = _other(x)
    angle, more = _angle(other, x)
    return angle + (more + rest * x)


@inline_llvm
def _other(x: float) -> tuple[float, float]:
    """sqrt(1 - x^2) as a sum, |x| <= 1."""
    square, error = exact_product(x, x)
    left, more = exact_sum(1.0, -square)
    left, more = exact_sum(left, more - error)
    root = math.sqrt(left)
    product, error = exact_product(root, root)
    return root, (((left - product) - error) + more) / (2.0 * root) if root > 0.0 else 0.0


@inline_llvm
def _axis(y: float, x: float) -> float:
    """Angle of a direction with a length that is zero or infinite, y >= 0."""
    back = math.copysign(1.0, x) < 0.0
    if y == math.inf:
        if abs(x) == math.inf:
            return 0.75 * PI if back else 0.25 * PI
        return HALF_PI
    return PI if back else 0.0


@internal
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
        j = j if j >= FIRST_CENTRE else 0
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
