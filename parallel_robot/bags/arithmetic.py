"""How this machine computes: the last digits differ between processors and their libraries.

The library of elementary functions (libm) and that of linear algebra (LAPACK) choose their code by
the processor, so that equal programs give other last digits elsewhere.
"""

from __future__ import annotations

import functools
import hashlib
import math
import platform
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from parallel_robot_model.common.printable import printable

COUNT, SIZE = 1000, 24  # arguments of each function, equations
LENGTH = 8  # characters of a hash


@functools.cache
def fingerprint() -> str:
    """What tells machines apart that give other last digits: of libm, of LAPACK."""
    arguments = [0.37 * k + 1e-3 * k * k for k in range(1, COUNT)]
    functions = (math.sin, math.cos, math.tan, math.atan, math.tanh, math.log)
    values = [function(x) for function in functions for x in arguments]
    values += [math.exp(-0.01 * x) for x in arguments]
    values += [math.pow(x, 0.67) for x in arguments]
    values += [math.atan2(x, 1.0 + 0.3 * x * x) for x in arguments]
    rows, columns = np.indices((SIZE, SIZE))
    matrix = 3.0 * np.eye(SIZE) + (7 * rows * columns + 3 * rows + columns) % 11 / 11.0
    solved = np.linalg.solve(matrix, 1.0 / (1.0 + np.arange(SIZE)))
    return '-'.join(
        hashlib.sha256(np.asarray(each).tobytes()).hexdigest()[:LENGTH]
        for each in (values, solved)
    )


def doubt(facts: Mapping[str, str]) -> str:
    """What is said of a bag whose last digits are not those of this machine; empty if they are.

    Args:
        facts: What the bag says of its experiment; an older one does not say it.
    """
    if facts.get('arithmetic', fingerprint()) == fingerprint():
        return ''
    theirs = ', '.join(printable(facts[key]) for key in ('processor', 'platform') if key in facts)
    return (
        f'the bag is of another processor or libm ({theirs}; here {processor()}, '
        f'{platform.platform()}): last digits differ, and what follows from them'
    )


def processor() -> str:
    """Name of the processor, for people."""
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()
