"""Keeps the parts of a motion or of other rows, those of a long one in a file without a name."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator

import numpy as np

from parallel_robot_model.common.errors import InputError

HELD = 1 << 24  # bytes that are held in memory; what is longer is in the file


class KeptParts:
    """Tuples of arrays, which are read as often as they are wanted."""

    def __init__(self, what: str) -> None:
        """Begin without any; `what` they are of, for error messages."""
        self._what = what
        self._file = tempfile.SpooledTemporaryFile(HELD)  # noqa: SIM115  closed with this
        self._counts: list[int] = []  # arrays of each part

    def add(self, *arrays: np.ndarray) -> None:
        """Keep the next part.

        Raises:
            InputError: there is no room for it.
        """
        try:
            self._file.seek(0, os.SEEK_END)
            for array in arrays:
                np.save(self._file, array, allow_pickle=False)
            self._file.flush()
        except OSError as error:
            where = 'a temporary file; TMPDIR names the directory of such files'
            raise InputError(f'cannot keep {self._what} in {where}: {error.strerror}') from None
        self._counts.append(len(arrays))

    def __iter__(self) -> Iterator[list[np.ndarray]]:
        """The parts in order, from the first one on each time."""
        place = 0
        for count in self._counts:
            self._file.seek(place)
            part = [np.load(self._file, allow_pickle=False) for _ in range(count)]
            place = self._file.tell()
            yield part
