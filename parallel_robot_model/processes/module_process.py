"""Modules of the suite in separate processes: their command lines, and their end."""

from __future__ import annotations

import ctypes
import signal
import sys
from pathlib import Path

# Linux prctl: signal to this process when its parent dies; its name
PR_SET_PDEATHSIG, PR_SET_NAME = 1, 15

# As ``python -m``, but without the current directory first on the path, so that nothing in it is
# imported. The folder of the code of this process goes there, unless it is on the path anyway.
START = (
    'import sys; sys.path[:1] = [entry for entry in sys.path[:1] if entry]; '
    'root = sys.argv.pop(1); root in sys.path or sys.path.insert(0, root); '
    "import runpy; runpy.run_module(sys.argv.pop(1), run_name='__main__', alter_sys=True)"
)


def command(module: str, *words: str) -> list[str]:
    """Command line that runs a module of the suite, the same code as here, from anywhere."""
    root = Path(__file__).parents[2]  # as on the path, not resolved
    return [sys.executable, '-c', START, str(root), module, *words]


def die_with_parent() -> None:
    """Let this process end with its parent; for ``preexec_fn`` of a child."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def set_name(name: str) -> None:
    """Name this process, as `ps -e` shows it; 15 letters at most."""
    ctypes.CDLL(None).prctl(PR_SET_NAME, name.encode())
