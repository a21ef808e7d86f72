"""Laws that are named by their files: Python, a C function, an FMU."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from parallel_robot_control.prepared_laws import law_loader
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import plain

KEY = 'custom_laws'


def is_file(law: str) -> bool:
    """Whether a law is given as a file, by its name."""
    return '/' in law or law_loader.is_file(law)


def name_of(law: str) -> str:
    """Name of a law that is given by its name or as a file."""
    return Path(law).stem if is_file(law) else law


def files_of(laws: Iterable[str], values: Mapping[str, Any]) -> dict[str, Any]:
    """The key that names the files among some laws, beside those that are named already.

    Args:
        laws: Laws by names or as files.
        values: What is changed in the configuration.

    Raises:
        InputError: it is of no list of files.
    """
    files = [law for law in laws if is_file(law)]
    if not files:
        return {}
    given = config.absolute_modules(KEY, plain(values.get(KEY, [])))
    return {KEY: [*dict.fromkeys((*given, *config.absolute_modules(KEY, files)))]}


def chosen(law: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Keys that choose a law by its name, or by its file; `values` as of :func:`files_of`."""
    return {'law': name_of(law), **files_of([law], values)}
