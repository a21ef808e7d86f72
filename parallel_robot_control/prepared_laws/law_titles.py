"""Titles of custom laws: a line ``TITLE = 'my law'`` of their files, which is read, not run."""

from __future__ import annotations

import re
from collections.abc import Mapping
from types import ModuleType

from parallel_robot_control.laws import CUSTOM_TITLES, TITLES
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.processes import custom_module

MAX_TITLE_LENGTH = 40  # characters
LINE = re.compile(rb"""^TITLE *= *(['"])([^'"\\\r\n]+)\1 *(?:#.*)?\r?$""", re.MULTILINE)


def learn(sources: Mapping[str, bytes]) -> None:
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


def check(name: str, law: ModuleType) -> None:
    """Learn the title of a law that was loaded.

    Raises:
        InputError: it has one that cannot be used.
    """
    learn({name: custom_module.source_of(law)})
    given = getattr(law, 'TITLE', None)
    if given in TITLES.values():
        raise InputError(f'custom_laws: {name}: TITLE {given!r} is that of a law of the suite')
    if given is not None and given != CUSTOM_TITLES[name]:
        raise InputError(
            f"custom_laws: {name}: TITLE must be one line with a text, TITLE = 'my law', of up to "
            f'{MAX_TITLE_LENGTH} characters that can be printed'
        )
