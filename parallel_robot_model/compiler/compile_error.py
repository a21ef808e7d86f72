"""Why a kernel of a custom module does not compile, in one line."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

COLORS = re.compile(r'\x1b\[[0-9;]*m')  # Numba's, where colorama is installed


def reason(error: Exception, function: Any) -> str:
    """The cause and the line that Numba reports; failing that, the line of the function."""
    text = COLORS.sub('', str(error))
    lines = [line.strip() for line in text.splitlines()]
    said = [line for line in lines if line and not line.startswith('Failed in ')]
    cause = said[0] if said else type(error).__name__
    if cause.endswith(':'):
        cause = ' '.join(said[:2])
    cause, _, raised = cause.partition('. Raised from ')
    place = re.search(r'^File "(.*)", line (\d+):$', text, re.MULTILINE)
    place = place or re.fullmatch(r'(.*) \((\d+)\)', raised or str(getattr(error, 'loc', '')))
    code = function.__code__
    file, line = place.groups() if place else (code.co_filename, code.co_firstlineno)
    return f'{cause} ({Path(file).name}:{line})'
