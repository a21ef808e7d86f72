"""Constants of the elementary functions, computed with whole numbers and then rounded."""

from __future__ import annotations

import math

DIGITS = 1300  # bits behind the point of numbers in this module; pi has to serve all floats
SHORT = 200  # bits behind the point of logarithms and arcus tangents


def _series(first: int, ratio: int, bits: int) -> int:
    """The sum of first ratio^k / (2 k + 1), k = 0, 1, ...; numbers times 2^bits."""
    total, term, k = 0, abs(first), 1
    while term:
        total += term // k if ratio > 0 or k % 4 == 1 else -(term // k)
        term = (term * abs(ratio)) >> bits
        k += 2
    return total if first > 0 else -total


def _pi() -> int:
    """pi 2^DIGITS, by Machin (1706): pi/4 = 4 arctan(1/5) - arctan(1/239)."""
    bits = DIGITS + 32
    fifth, small = (_series((1 << bits) // n, -((1 << bits) // (n * n)), bits) for n in (5, 239))
    return (16 * fifth - 4 * small) >> 32


def _arctangent(numerator: int, denominator: int) -> int:
    """arctan(numerator / denominator) 2^SHORT, of a ratio of at most 1."""
    # arctan t = 2 arctan(t / (1 + sqrt(1 + t^2))), three times: then the series is short.
    one = 1 << SHORT
    t = (numerator << SHORT) // denominator
    for _ in range(3):
        t = (t << SHORT) // (one + math.isqrt((one << SHORT) + t * t))
    return _series(t, -((t * t) >> SHORT), SHORT) << 3


def _logarithm(numerator: int, denominator: int) -> int:
    """log(numerator / denominator) 2^SHORT = 2 artanh((n - d) / (n + d)) 2^SHORT."""
    t = ((numerator - denominator) << SHORT) // (numerator + denominator)
    return 2 * _series(t, (t * t) >> SHORT, SHORT)


def rounded(number: int, bits: int) -> float:
    """The float nearest to number / 2^bits."""
    return number / (1 << bits)


def parts(number: int, bits: int, *digits: int) -> tuple[float, ...]:
    """Floats whose sum is number / 2^bits: cut behind so many binary places, and the rest."""
    found = []
    for places in digits:
        cut = number >> (bits - places)
        found.append(rounded(cut, places))
        number -= cut << (bits - places)
    return (*found, rounded(number, bits))


PI = _pi()
HALF_PI = PI, DIGITS + 1  # as number and bits
LN_2 = _logarithm(2, 1), SHORT
PER_DIGIT = 28  # bits of a digit of 2/pi
TWO_BY_PI = tuple(
    ((1 << (2 * DIGITS + 1)) // PI >> (DIGITS - PER_DIGIT * k)) % (1 << PER_DIGIT)
    for k in range(45)
)  # digits of 2/pi; number k has the weight 2^(-28 k)


def double(number: int, bits: int) -> tuple[float, float]:
    """Two floats whose sum is number / 2^bits to twice the digits of one."""
    high = rounded(number, bits)
    numerator, denominator = high.as_integer_ratio()
    return high, rounded(number - (numerator << bits) // denominator, bits)


def arctangent(numerator: int, denominator: int) -> tuple[float, float]:
    """arctan(numerator / denominator) as two floats."""
    return double(_arctangent(numerator, denominator), SHORT)


def logarithm(numerator: int, denominator: int, places: int) -> tuple[float, ...]:
    """log(numerator / denominator) as two floats, the first with so many binary places."""
    return parts(_logarithm(numerator, denominator), SHORT, places)
