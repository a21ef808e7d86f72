"""Custom laws: control laws from files that are not part of the suite, Python or foreign."""

from __future__ import annotations

import contextlib
import functools
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from parallel_robot_control.contract import Law
from parallel_robot_control.foreign.law import is_foreign, source_of
from parallel_robot_control.laws import CUSTOM_TITLES, TITLES
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import plain
from parallel_robot_model.processes import custom_module
from parallel_robot_model.processes.child_process import CALL_LIMIT, trial_step
from parallel_robot_model.processes.custom_module import RAISED

# Titles of custom laws: a line ``TITLE = 'my law'`` of their files, which is read, not run.

MAX_TITLE_LENGTH = 40  # characters
LINE = re.compile(rb"""^TITLE *= *(['"])([^'"\\\r\n]+)\1 *(?:#.*)?\r?$""", re.MULTILINE)


def learn_titles(sources: Mapping[str, bytes]) -> None:
    """Let laws be called by their titles in pictures and reports.

    Args:
        sources: Name of a law to the text of its file, of any origin.
    """
    for name, source in sources.items():
        match = LINE.search(source)
        text = match[2].decode(errors='replace').strip() if match else ''
        good = (
            text.isprintable()
            and 0 < len(text) <= MAX_TITLE_LENGTH
            and text not in TITLES.values()
        )
        CUSTOM_TITLES[name] = text if good else name


def _learn_title(name: str, law: Law) -> None:
    """Learn the title of a law that was loaded."""
    learn_titles({name: custom_module.source_of(law)})
    given = law.TITLE
    if given in TITLES.values():
        raise InputError(f'custom_laws: {name}: TITLE {given!r} is that of a law of the suite')
    if given is not None and given != CUSTOM_TITLES[name]:
        raise InputError(
            f"custom_laws: {name}: TITLE must be one line with a text, TITLE = 'my law', of up to "
            f'{MAX_TITLE_LENGTH} characters that can be printed'
        )


LAWS_KEY = 'custom_laws'
NEEDED = ('Gains', 'initial_memory', 'update')
_law = functools.cache(Law.of)  # one of each module


def has_law_suffix(law: str) -> bool:
    """Whether a law is given as a file, by how the name ends."""
    return law.endswith('.py') or is_foreign(law)


def load(path: str) -> tuple[str, Law]:
    """Import a law file once.

    Args:
        path: The file; its stem is the name of the law.

    Returns:
        Name and law.

    Raises:
        InputError: the file does not exist, cannot be imported or is not a law.
    """
    translate = source_of if is_foreign(path) else None
    name, module = custom_module.load(path, LAWS_KEY, NEEDED, NEEDED[:1], dry_run, translate)
    law = _law(module)
    _learn_title(name, law)
    return name, law


def dry_run(law: ModuleType) -> None:
    """Call what a law has in Python; what it raises is reported where it is called again."""
    with contextlib.suppress(*RAISED), trial_step('validate_gains', CALL_LIMIT):
        law.validate_gains(law.Gains())
    with contextlib.suppress(*RAISED), trial_step('initial_memory', CALL_LIMIT):
        law.initial_memory(3)


def custom_laws(paths: Sequence[str]) -> dict[str, Law]:
    """Custom laws from their files, by name."""
    return dict(map(load, paths))


# Laws that are named by their files: Python, a C function, an FMU.


def is_law_file(law: str) -> bool:
    """Whether a law is given as a file, by its name."""
    return '/' in law or has_law_suffix(law)


def name_of(law: str) -> str:
    """Name of a law that is given by its name or as a file."""
    return Path(law).stem if is_law_file(law) else law


def files_of(laws: Iterable[str], values: Mapping[str, Any]) -> dict[str, Any]:
    """The key that names the files among some laws, beside those that are named already.

    Args:
        laws: Laws by names or as files.
        values: What is changed in the configuration.

    Raises:
        InputError: it is of no list of files.
    """
    files = [law for law in laws if is_law_file(law)]
    if not files:
        return {}
    given = config.absolute_modules(LAWS_KEY, plain(values.get(LAWS_KEY, [])))
    return {LAWS_KEY: [*dict.fromkeys((*given, *config.absolute_modules(LAWS_KEY, files)))]}


def chosen(law: str, values: Mapping[str, Any]) -> dict[str, Any]:
    """Keys that choose a law by its name, or by its file; `values` as of :func:`files_of`."""
    return {'law': name_of(law), **files_of([law], values)}
