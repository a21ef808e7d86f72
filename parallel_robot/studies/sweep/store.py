"""The directory of a sweep: what is done is kept, whatever happens, and nothing is done twice.

Finished rows go into small files of their own in ``parts``; each is complete or not there. The
last step merges them into ``runs.parquet``, sorted by row, and removes them.
"""

from __future__ import annotations

import contextlib
import re
import shutil
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot.studies.locked_directory import LOCK, LockedDirectory
from parallel_robot.studies.sweep.plan import Plan
from parallel_robot.studies.sweep.run_chunk import version
from parallel_robot.studies.sweep.table import Arrow, arrow, schema, with_floors
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.configuration.fields import plain

STUDY, RUNS, PARTS = 'study.yaml', 'runs.parquet', 'parts'
WINDOW = 65536  # rows that are merged at once, about


class Store(LockedDirectory):
    """The directory of a sweep.

    Attributes:
        done: Which rows are done, shape (rows,).
    """

    KIND = 'sweep'
    MANIFEST = 'sweep.json'
    FIRST = (STUDY, PARTS)
    FORMAT = 'parallel_robot sweep 1'

    def __init__(self, directory: Path, plan: Plan, text: str) -> None:
        """Prepare the directory for a plan, or to go on in it.

        Args:
            directory: The directory.
            plan: The plan.
            text: The file of the study.
        """
        super().__init__(directory)
        self._plan = plan
        self._text = text
        self._schema = schema(plan)
        self.done: NDArray[np.bool_] = np.zeros(plan.count, dtype=bool)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Release the lock; of a new sweep that failed before its first row, nothing is left."""
        if error is not None and self.new and not self.done.any():
            shutil.rmtree(self.directory / PARTS, ignore_errors=True)
            with contextlib.suppress(OSError):
                for name in (self.MANIFEST, STUDY, LOCK):
                    (self.directory / name).unlink(missing_ok=True)
                self.directory.rmdir()
        super().__exit__(kind, error, trace)

    def add(self, rows: Arrow) -> None:
        """Keep finished rows.

        Raises:
            RunError: they cannot be written.
        """
        numbers = rows['row'].to_numpy()
        name = f'{numbers.min():010d}_{numbers.max():010d}_{len(numbers)}.parquet'
        with self.writing(self.directory / PARTS / name) as stream:
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
        with contextlib.suppress(OSError):  # a foreign file is in it
            (self.directory / PARTS).rmdir()

    def _merge(self, parts: list[tuple[int, int, Path]], runs: Path) -> None:
        pa = arrow()
        if runs.exists():
            parts = [*parts, (0, self._plan.count, runs)]
        with (
            self.writing(runs) as stream,
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

    def _open(self) -> None:
        if not self.new:
            self._check(manifest_of(self.directory))
        (self.directory / PARTS).mkdir(exist_ok=True)
        with self.writing(self.directory / STUDY) as stream:
            stream.write(self._text.encode())
        self._write_manifest(self._content())
        self._find_done()

    def _kept(self) -> str:
        return f'{int(self.done.sum())} of {len(self.done)} rows'

    def _content(self) -> dict[str, Any]:
        return {
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
        """Find the rows that are done."""
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
    found = Store.manifest(directory)
    kinds = {'version': str, 'runs': int, 'scenarios': list, 'set': dict, 'study': dict}
    if any(type(found.get(key)) is not kind for key, kind in kinds.items()):
        path = directory / Store.MANIFEST
        raise InputError(f'{path} is not that of a sweep of this version; choose another --out')
    return found


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
