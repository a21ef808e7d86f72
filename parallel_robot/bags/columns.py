"""Arrays that grow row by row, those of a long run in files that are mapped into memory."""

from __future__ import annotations

import os
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.processes.user_directory import user_directories
from parallel_robot_sim.motions import Motion, Motions

SMALL = 1 << 24  # bytes that are held in memory; what is longer is in files
MOUNTS = Path('/proc/self/mounts')
IN_MEMORY = ('tmpfs', 'ramfs')  # file systems whose files are no less memory
BLOCK = 1 << 17  # rows that are looked at at once


def blocks(begin: int, stop: int) -> Iterator[slice]:
    """Rows from one up to another, at most BLOCK at once."""
    for start in range(begin, stop, BLOCK):
        yield slice(start, min(start + BLOCK, stop))


class Columns:
    """Arrays by name, with one row more for each sample.

    Files have no names, so that nothing is left of them when the process ends, however it does.
    """

    def __init__(self, what: str) -> None:
        """Begin without rows; `what` they are of, for error messages."""
        self._what = what
        self._parts: dict[str, list[Array]] = {}  # in memory
        self._files: dict[str, IO[bytes]] = {}
        self._rows: Counter[str] = Counter()  # of each array
        self._held = 0  # bytes in memory

    def add(self, rows: dict[str, Array]) -> None:
        """Append rows to arrays.

        Args:
            rows: Rows by the name of the array, shape (N, ...); of one array always of one shape.

        Raises:
            InputError: there is no room for them.
        """
        for name, array in rows.items():
            self._parts.setdefault(name, []).append(np.array(array))
            self._rows[name] += len(array)
            self._held += array.nbytes
        if self._held > SMALL:
            self._write()

    def arrays(self) -> dict[str, Any]:
        """All arrays so far, by name, which may be written into; no rows are added after that."""
        if self._files:
            self._write()
        return {name: self._array(name, parts) for name, parts in self._parts.items()}

    def _array(self, name: str, parts: list[Array]) -> Array:
        if name not in self._files:
            return np.concatenate(parts)
        shape = self._rows[name], *parts[-1].shape[1:]
        if 0 in shape:  # nothing that could be mapped
            return np.empty(shape, parts[-1].dtype)
        return np.memmap(self._files[name], parts[-1].dtype, 'r+', shape=shape)

    def _write(self) -> None:
        """Move all rows into files."""
        folder = disk_directory()
        try:
            for name, parts in self._parts.items():
                if name not in self._files:
                    self._files[name] = tempfile.TemporaryFile('w+b', dir=folder)  # noqa: SIM115
                for part in parts:
                    self._files[name].write(np.ascontiguousarray(part).data)
                self._files[name].flush()
                parts[:] = [parts[-1][:0]]
        except OSError as error:
            raise InputError(
                f'cannot keep {self._what} in {folder}: {error.strerror}; XDG_CACHE_HOME names '
                'another directory'
            ) from None
        self._held = 0


def disk_directory() -> Path:
    """Directory of the user's cache, or of temporary files, whichever is on a disk."""
    places = [*user_directories(), Path('/var/tmp'), Path(tempfile.gettempdir())]
    writable = [place for place in places if os.access(place, os.W_OK)]
    return next((place for place in writable if not _is_memory(place)), writable[0])


def _is_memory(place: Path) -> bool:
    """Whether files in a directory take up memory."""
    try:
        mounts = [line.split() for line in MOUNTS.read_text().splitlines()]
    except OSError:
        return False
    kinds = {mount[1]: mount[2] for mount in mounts}
    above = (str(folder) for folder in (place.resolve(), *place.resolve().parents))
    return next((kinds[folder] for folder in above if folder in kinds), '') in IN_MEMORY


class MotionColumns:
    """The motions of a run that comes in parts, as those of all of it."""

    def __init__(self) -> None:
        self._columns = Columns('the motion')
        self._last: Motions | None = None
        self._has_ideal = True

    def add(self, motions: Motions) -> None:
        """Append the next part; what is `seen` is in all parts, or of no use.

        Raises:
            InputError: there is no room for it.
        """
        if self._last is not None and motions.seen is None:
            self._last = self._last._replace(seen=None)
        elif self._last is None:
            self._last = motions
        self._has_ideal &= motions.ideal is not None
        rows = {'ideal': motions.ideal} if motions.ideal is not None else {}
        for name in ('true', 'seen'):
            motion: Motion | None = getattr(motions, name)
            if motion is not None:
                arrays = motion._asdict() | motion.poses._asdict()
                rows |= {f'{name}.{key}': arrays[key] for key in (*MOTION, *POSES)}
        self._columns.add(rows)

    def motions(self) -> Motions:
        """All of them, when there was a part."""
        assert self._last is not None
        arrays = self._columns.arrays()
        true, seen = (
            motion and self._motion(name, motion, arrays)
            for name, motion in (('true', self._last.true), ('seen', self._last.seen))
        )
        return Motions(true, seen, arrays['ideal'] if self._has_ideal else None)

    def _motion(self, name: str, last: Motion, arrays: dict[str, Array]) -> Motion:
        actual, reference = (arrays[f'{name}.{key}'] for key in POSES)
        poses = last.poses._replace(actual=actual, reference=reference)
        return Motion._make([*(arrays[f'{name}.{key}'] for key in MOTION), poses])


MOTION = tuple(name for name in Motion._fields if name != 'poses')
POSES = ('actual', 'reference')
