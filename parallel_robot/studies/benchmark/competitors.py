"""The laws of a benchmark: those of the suite by name, others by their file."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from parallel_robot_control.configuration import available
from parallel_robot_control.foreign.fmu_law import file_beside
from parallel_robot_control.law_loader import has_law_suffix
from parallel_robot_model.common.errors import InputError, UnknownNameError

SHIPPED = 'of the suite'


@dataclass(frozen=True)
class Competitors:
    """The laws that are judged.

    Attributes:
        names: Their names, in order.
        files: Files of those that are not of the suite.
    """

    names: tuple[str, ...]
    files: tuple[Path, ...]

    @property
    def code(self) -> dict[str, Any]:
        """Keys of the configuration that name the files."""
        return {'custom_laws': [str(path) for path in self.files]} if self.files else {}

    def sources(self) -> dict[str, str]:
        """Law to the SHA-256 of its file and of what stands beside it, or that it is shipped."""
        found = dict.fromkeys(self.names, SHIPPED)
        for path in self.files:
            beside = file_beside(path)
            called = beside.read_bytes() if beside else b''
            found[path.stem] = hashlib.sha256(path.read_bytes() + called).hexdigest()
        return found


def competitors(given: Sequence[str]) -> Competitors:
    """The laws by names and files.

    Args:
        given: Names of laws of the suite, and files of others.

    Raises:
        InputError: there is no such law or file, or a law is named twice.
    """
    files = [Path(each).resolve() for each in given if has_law_suffix(each)]
    for path in files:
        if not path.is_file():
            raise InputError(f'there is no file {path}')
    names = [Path(each).stem if has_law_suffix(each) else each for each in given]
    known = available([str(path) for path in files])
    for name in names:
        if name not in known:
            raise UnknownNameError('law', name, known)
        if names.count(name) > 1:
            raise InputError(f'{name} is named twice')
    return Competitors(tuple(names), tuple(files))
