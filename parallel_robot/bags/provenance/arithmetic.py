"""How this machine computes, and what is said of a bag that was computed otherwise.

Kernels, and Python where its numbers reach a bag, use elementary functions and equations of the
suite's own: their bits are the same on every x86-64. Earlier versions took those of the C library
(libm) and of LAPACK, which choose their code by the processor.
"""

from __future__ import annotations

import platform
from collections.abc import Mapping
from pathlib import Path

from parallel_robot_model.common.errors import printable

OWN = 'own functions'


def fingerprint() -> str:
    """What tells machines apart that give other last digits."""
    return f'{OWN}, {platform.machine()}'


def doubt(facts: Mapping[str, str]) -> str:
    """What is said of a bag whose last digits may not be those of this machine; empty if they are.

    Args:
        facts: What the bag says of its experiment; an older one does not say it.
    """
    said = facts.get('arithmetic', fingerprint())
    if said == fingerprint():
        return ''
    theirs = ', '.join(printable(facts[key]) for key in ('processor', 'platform') if key in facts)
    here = f'{theirs}; here {processor()}, {platform.platform()}'
    why = 'the bag is of another kind of processor'
    if not said.startswith(OWN):
        why = 'the bag was computed with the libm of its machine, now the functions are our own'
    return f'{why} ({here}): last digits differ, and what follows from them'


def processor() -> str:
    """Name of the processor, for people."""
    try:
        lines = Path('/proc/cpuinfo').read_text().splitlines()
    except OSError:
        lines = []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()
