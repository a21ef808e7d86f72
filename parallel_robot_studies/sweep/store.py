"""The directory of a sweep: what is done is kept, whatever happens, and nothing is done twice.

Finished rows go into small files of their own in ``parts``; each is complete or not there. The
last step merges them into ``runs.parquet``, sorted by row, and removes them.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot_base.errors import InputError, RunError
from parallel_robot_base.fields import plain
from parallel_robot_studies.sweep.plan import Plan
from parallel_robot_studies.sweep.table import Arrow, arrow, schema, with_floors
from parallel_robot_studies.sweep.tasks import version

FORMAT = 'parallel_robot sweep 1'
MANIFEST, STUDY, RUNS, PARTS, LOCK = 'sweep.json', 'study.yaml', 'runs.parquet', 'parts', 'lock'
UNFINISHED = '.unfinished'  # suffix of a file that is being written
WINDOW = 65536  # rows that are merged at once, about


class Store:
    """The directory of a sweep; a context manager that holds its lock.

    Attributes:
        directory: The directory.
        done: Which rows are done, shape (rows,).
    """

    def __init__(self, directory: Path, plan: Plan, text: str) -> None:
        """Prepare the directory for a plan, or to go on in it.

        Args:
            directory: The directory.
            plan: The plan.
            text: The file of the study.

        Raises:
            InputError: the directory holds something else, or cannot be written.
        """
        self.directory = directory
        self._plan = plan
        self._text = text
        self._schema = schema(plan)
        self._lock: IO[str] | None = None
        self._new = False
        self.done: NDArray[np.bool_] = np.zeros(plan.count, dtype=bool)

    def __enter__(self) -> Store:
        """Open the directory; see the constructor for errors."""
        try:
            self._open()
        except OSError as error:
            self.__exit__(type(error), error, None)
            raise InputError(f'cannot write to {self.directory}: {error.strerror}') from None
        except BaseException as error:
            self.__exit__(type(error), error, None)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Release the lock; of a new sweep that failed before its first row, nothing is left."""
        if error is not None and self._new and not self.done.any():
            shutil.rmtree(self.directory / PARTS, ignore_errors=True)
            with contextlib.suppress(OSError):
                for name in (MANIFEST, STUDY, LOCK):
                    (self.directory / name).unlink(missing_ok=True)
                self.directory.rmdir()
        if self._lock is not None:
            self._lock.close()

    def add(self, rows: Arrow) -> None:
        """Keep finished rows.

        Raises:
            RunError: they cannot be written.
        """
        numbers = rows['row'].to_numpy()
        name = f'{numbers.min():010d}_{numbers.max():010d}_{len(numbers)}.parquet'
        with self._writing(self.directory / PARTS / name) as stream:
            arrow().parquet.write_table(rows, stream)
        self.done[numbers] = True

    def finish(self) -> None:
        """Merge all parts into one file, sorted by row, and remove them.

        Raises:
            RunError: it cannot be written.
        """
        parts = self._parts()
        runs = self.directory / RUNS
        if parts or not runs.exists():
            self._merge(parts, runs)
        for *_, path in parts:
            path.unlink()
        with contextlib.suppress(OSError):  # somebody else's file is in it
            (self.directory / PARTS).rmdir()

    def _merge(self, parts: list[tuple[int, int, Path]], runs: Path) -> None:
        pa = arrow()
        if runs.exists():
            parts = [*parts, (0, self._plan.count, runs)]
        with (
            self._writing(runs) as stream,
            pa.parquet.ParquetWriter(stream, self._schema) as writer,
        ):
            cases = len(self._plan.cases)
            step = max(1, WINDOW // cases) * cases  # whole samples
            for low in range(0, self._plan.count, step):
                high = low + step
                inside = [path for first, last, path in parts if first < high and last >= low]
                rows = pa.concat_tables(
                    self._read(path, [('row', '>=', low), ('row', '<', high)]) for path in inside
                )
                _, first = np.unique(rows['row'].to_numpy(), return_index=True)
                ordered = rows.take(first).combine_chunks()
                writer.write_table(with_floors(ordered, self._plan).combine_chunks())

    @contextlib.contextmanager
    def _writing(self, path: Path) -> Iterator[IO[bytes]]:
        """Write a file that is complete or not there.

        Raises:
            RunError: it cannot be written.
        """
        unfinished = path.with_name(path.name + UNFINISHED)
        try:
            with unfinished.open('wb') as stream:
                yield stream
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(unfinished, path)
        except OSError as error:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
            raise RunError(
                f'cannot write {path}: {error.strerror or error}; {int(self.done.sum())} of '
                f'{len(self.done)} rows are kept, the same command continues'
            ) from None

    def _open(self) -> None:
        manifest = self.directory / MANIFEST
        if self.directory.exists() and not manifest.exists():
            others = {path.name for path in self.directory.iterdir()}
            if others - {STUDY, LOCK, PARTS, STUDY + UNFINISHED, MANIFEST + UNFINISHED}:
                raise InputError(
                    f'{self.directory} is not the directory of a sweep; choose another --out'
                )
        self.directory.mkdir(parents=True, exist_ok=True)
        self._lock = (self.directory / LOCK).open('w')
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError(f'another sweep is writing to {self.directory}') from None
        self._new = not manifest.exists()
        if not self._new:
            self._check(manifest_of(self.directory))
        (self.directory / PARTS).mkdir(exist_ok=True)
        for name, text in (STUDY, self._text), (MANIFEST, json.dumps(self._manifest(), indent=1)):
            with self._writing(self.directory / name) as stream:
                stream.write(text.encode())
        self._find_done()

    def _manifest(self) -> dict[str, Any]:
        return {
            'format': FORMAT,
            'version': version(),
            'runs': self._plan.study.runs,
            'scenarios': list(self._plan.study.scenarios),
            'set': plain(dict(self._plan.study.fixed)),
            'study': self._plan.description(),
        }

    def _check(self, found: dict[str, Any]) -> None:
        """Refuse to mix rows of different studies or versions, or to drop some."""
        doubt = study_doubt(found, self._plan) or version_doubt(found)
        if doubt:
            raise InputError(f'{self.directory}: {doubt}; choose another --out')
        runs = self._plan.study.runs
        if found['runs'] > runs:
            raise InputError(
                f'{self.directory} holds {found["runs"]} runs of each law and scenario, '
                f'--runs must be at least that, not {runs}'
            )

    def _find_done(self) -> None:
        """Find the rows that are done; remove what was being written when a sweep was killed."""
        for path in [*self.directory.glob(f'*{UNFINISHED}'), *self._unfinished_parts()]:
            path.unlink()
        runs = self.directory / RUNS
        for path in [runs] * runs.exists() + [path for *_, path in self._parts()]:
            try:
                numbers = self._read(path, columns=['row'])['row'].to_numpy()
            except (OSError, ValueError, KeyError, IndexError):  # not a table, or another one
                if path == runs:
                    raise InputError(f'{path} cannot be read; choose another --out') from None
                path.unlink()  # cut off with the power: its rows are run again
                continue
            self.done[numbers] = True

    def _unfinished_parts(self) -> list[Path]:
        return list((self.directory / PARTS).glob(f'*{UNFINISHED}'))

    def _parts(self) -> list[tuple[int, int, Path]]:
        """First and last row of each part, and its file."""
        found = []
        for path in sorted((self.directory / PARTS).glob('*.parquet')):
            name = re.fullmatch(r'(\d+)_(\d+)_\d+', path.stem)
            if name:
                found.append((int(name[1]), int(name[2]), path))
        return found

    def _read(self, path: Path, filters: Any = None, columns: Any = None) -> Arrow:
        pa = arrow()
        found = pa.parquet.read_table(path, columns=columns, filters=filters, partitioning=None)
        return found if columns else found.select(self._schema.names).cast(self._schema)


def manifest_of(directory: Path) -> dict[str, Any]:
    """What the directory of a sweep says of it.

    Raises:
        InputError: it is not the directory of a sweep.
    """
    path = directory / MANIFEST
    try:
        found: Any = json.loads(path.read_text())
    except OSError as error:
        raise InputError(
            f'{directory} is not the directory of a sweep: {error.strerror}'
        ) from None
    except ValueError:
        found = None
    kinds = {'version': str, 'runs': int, 'scenarios': list, 'set': dict, 'study': dict}
    known = isinstance(found, dict) and found.get('format') == FORMAT
    if not known or any(type(found.get(key)) is not kind for key, kind in kinds.items()):
        raise InputError(f'{path} is not that of a sweep of this version; choose another --out')
    return dict(found)


def study_doubt(manifest: dict[str, Any], plan: Plan) -> str:
    """What is wrong when a sweep was made of another study; empty if it was not."""
    for key, text in plan.description().items():
        if manifest['study'].get(key) != text:
            return f'the sweep of another study, whose {key} differs'
    return ''


def version_doubt(manifest: dict[str, Any]) -> str:
    """What is wrong when a sweep was made by another version; empty if it was not."""
    if manifest['version'] == version():
        return ''
    return f'made by another version of the suite, {manifest["version"]}, not {version()}'
