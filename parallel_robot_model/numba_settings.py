"""The settings of Numba: those of the environment alone.

Numba reads the file .numba_config.yaml of the current directory, too, at its import and whenever
it compiles. Anybody may have put it there: it can fill the terminal, end every command, and name a
directory whose files are executed. Numba has no setting against it, hence this look at its code.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from types import CodeType, ModuleType

MODULE, FILE = 'numba.core.config', '.numba_config.yaml'
THREADS = 'NUMBA_NUM_THREADS'
NONE = ''  # path of a file that does not exist


class _Loader(SourceFileLoader):
    """Loads the module of Numba's settings with another name of the file."""

    def get_code(self, fullname: str) -> CodeType | None:
        """Code of the module."""
        code = super().get_code(fullname)
        if code is None:
            return None
        return code.replace(
            co_consts=tuple(NONE if value == FILE else value for value in code.co_consts)
        )


class _Finder:
    """Finds the module of Numba's settings."""

    @staticmethod
    def find_spec(
        name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Where a module is; None for all others, which Python finds itself."""
        if name != MODULE:
            return None
        spec = PathFinder.find_spec(name, path, target)
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


def take_from_environment_alone() -> None:
    """Let Numba read no file, also where it was imported already; it is not imported here.

    A number of threads with which it cannot be imported is left out.
    """
    threads = os.environ.get(THREADS, '1')
    if not threads.isdecimal() or not int(threads):
        del os.environ[THREADS]
        text = f'{THREADS} must be at least 1, not {threads!r}: it is left out'
        logging.getLogger('parallel_robot').warning(text)
    config = sys.modules.get(MODULE)
    if config is None:
        sys.meta_path.insert(0, _Finder)
    else:
        config._config_fname = NONE  # type: ignore[attr-defined]
        config.reload_config()
