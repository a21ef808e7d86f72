"""How much memory and time reading a bag may take; rows beyond that are kept in files."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.common.units import Array

MEMORY = 2 << 30  # bytes that a command may take for what is in bags
TRUSTED = 1 << 50  # the same, for a bag that this process has just had written
COPIES = 4  # copies of what is read that evaluation holds in memory
RATIO = 200  # bytes that one byte of a file may unpack to, where that is more than the memory
RECORDS = 250_000  # records of a small file; a larger one has at most one in RECORD bytes
RECORD = 16  # bytes; the index of a message alone has as many
DESCRIPTIONS = 20_000  # schemas, channels, attachments and metadata records of a file
DESCRIPTION = 1 << 20  # bytes of one of them
ATTACHMENT = 1 << 28  # bytes of an attachment
CHUNK_INDEX = 1 << 6  # bytes that the index of a chunk takes
CHUNK = 1 << 28  # bytes that a chunk unpacks to
MESSAGE = 1 << 16  # bytes of a message that is decoded; that of a hundred joints has five thousand
KINDS = 100  # kinds of messages that a topic may have: joints and their order
LENGTHS = 1000  # different lengths of the messages of a channel, among a few megabytes of them
CHANNELS = 1000  # channels that are read of a file
STATUSES = 10_000  # statuses of the controller, which it sends when something changes
SOURCE = 1 << 20  # bytes of the source of a law or robot
SOURCES = 100  # custom laws and robots
YAML = 4 << 20  # bytes of metadata.yaml
NAME = 200  # characters of the name of a joint, a law, a scenario or a node


def is_name(text: str) -> bool:
    """Whether a text of a bag can be the name of a joint, a law, a scenario or a node."""
    return text.isprintable() and len(text) <= NAME


class Allowance:
    """Budget for reading a file; each part is deducted before it is allocated.

    What a file unpacks to, and how many records that are, is bounded by the memory or the size of
    the file, whichever allows more.
    """

    def __init__(self, path: Path | str, size: int, memory: int = MEMORY) -> None:
        """Prepare.

        Args:
            path: The file or the bag, or what it is in words, for error messages.
            size: Its size on disk [bytes].
            memory: What may be held of it [bytes].
        """
        self._path = path
        self._memory = memory
        self._held = 0
        self._unpacked = max(memory, RATIO * size)
        self._records = max(RECORDS, size // RECORD)
        self._descriptions = DESCRIPTIONS

    @property
    def records(self) -> int:
        """How many records may still be walked."""
        return self._records

    def unpack(self, size: int) -> None:
        """Deduct bytes that will be unpacked.

        Raises:
            BagError: they are too many.
        """
        self._unpacked -= size
        if self._unpacked < 0:
            raise BagError(
                f'{self._path} unpacks to more than {RATIO} times its size and more than '
                f'{gigabytes(self._memory)}'
            )

    def walk(self, records: int) -> None:
        """Deduct records that will be walked.

        Raises:
            BagError: they are more than a file of this size holds.
        """
        self._records -= records
        if self._records < 0:
            raise BagError(f'{self._path} holds far more records than a file of its size would')

    def describe(self, records: int = 1) -> None:
        """Deduct schemas, channels, attachments and metadata records.

        Raises:
            BagError: they are too many.
        """
        self._descriptions -= records
        if self._descriptions < 0:
            raise BagError(
                f'{self._path} holds more than {DESCRIPTIONS} schemas, channels, attachments '
                'and metadata records'
            )

    def hold(self, size: int) -> None:
        """Deduct bytes that will be kept.

        Raises:
            BagError: they are more than the memory allows.
        """
        self._held += size
        if COPIES * self._held > self._memory:
            raise BagError(f'{self._path} takes more than {gigabytes(self._memory)} of memory')


def gigabytes(size: int) -> str:
    """A number of bytes in words."""
    return f'{size / (1 << 30):.3g} GB'


# Keeps the parts of a motion or of other rows, those of a long one in a file without a name.

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


# Rows of numbers in rising order, of which all or some are read; many are kept in a file.


class SortedRows:
    """Rows by a time or stamp each; equal ones stay in the order in which they came."""

    def __init__(self, what: str) -> None:
        """Begin without any; `what` they are, for error messages."""
        self.count = 0  # how many there are
        self._parts = KeptParts(what)
        self._newest: float | None = None
        self._rise = True

    def add(self, times: np.ndarray, rows: Array) -> None:
        """Take the next rows, shape (N, k), with their times, shape (N,).

        Raises:
            InputError: there is no room for them.
        """
        if not len(times):
            return
        before = times[:1] if self._newest is None else self._newest
        self._rise &= bool((np.diff(times, prepend=before) >= 0).all())
        self._newest = times[-1]
        self._parts.add(times, rows)
        self.count += len(times)

    def evenly(self, most: int | None = None) -> tuple[np.ndarray, Array]:
        """At most so many of the rows from the first to the last, evenly; None: all.

        Returns:
            Rising times, shape (M,), and rows, shape (M, k).
        """
        if most is None or most >= self.count:
            wanted = np.arange(self.count)
        else:
            wanted = np.linspace(0, self.count - 1, most).astype(int)
        if not self._rise:
            wanted = np.argsort(self._times(), kind='stable')[wanted]
        order = np.argsort(wanted, kind='stable')
        begin, parts = 0, []
        for times, rows in self._parts:
            low, high = np.searchsorted(wanted[order], [begin, begin + len(times)])
            inside = wanted[order[low:high]] - begin
            parts.append((times[inside], rows[inside]))
            begin += len(times)
        there = np.argsort(order)
        found, values = (np.concatenate(each) for each in zip(*parts, strict=True))
        return found[there], values[there]

    def _times(self) -> np.ndarray:
        found, begin = np.empty(self.count, type(self._newest)), 0
        for times, _ in self._parts:
            found[begin : begin + len(times)] = times
            begin += len(times)
        return found
