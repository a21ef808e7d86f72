"""The directory of a sweep: what is done is kept, whatever happens, and nothing is done twice.

Finished rows go into small files of their own in ``parts``; each is complete or not there. The
last step merges them into ``runs.parquet``, sorted by row, and removes them.
"""

from __future__ import annotations

import contextlib
import re
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot.analysis.metrics import METRICS, Metrics
from parallel_robot.studies.result_store import LOCK, ResultStore
from parallel_robot.studies.sweep import study
from parallel_robot.studies.sweep.plan import Plan, Row, plan
from parallel_robot.studies.sweep.run_chunk import Floor, Outcome, version
from parallel_robot_model.common.errors import InputError, optional
from parallel_robot_model.common.units import HINGES, JointUnits
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.config_files import scenario_stem
from parallel_robot_model.configuration.fields import plain

# The table of a sweep: one row for each run, units in the names of the columns.

# Which run it is, and what became of it.
IDENTITY = ('row', 'law', 'scenario', 'sample', 'seed', 'status', 'reason', 'limits')
Arrow = Any  # a pyarrow.Table; pyarrow is optional, and untyped


DURATION = 'duration_s'
COLUMNS = (DURATION, *(metric.key for metric in METRICS))


def columns_of(found: Metrics) -> dict[str, float]:
    """Metrics of a run by column; NaN is written as null, a state never reached as infinite."""
    return {DURATION: found.duration_s, **{metric.key: metric.of(found) for metric in METRICS}}


# Of the sample, not of the run: the first law of the scenario has it until a sweep is finished.
FLOOR = Floor._fields
CALM = ('calm_chattering_nm', 'calm_error')  # limit by chattering, lists, likewise [m or rad]


def arrow() -> ModuleType:
    """The module pyarrow, with ``parquet``.

    Raises:
        InputError: it is not installed.
    """
    optional('pyarrow.parquet')
    return optional('pyarrow')


def schema(plan: Plan) -> Any:
    """Columns of the table of a plan, as a pyarrow.Schema."""
    pa = arrow()
    words = ('law', 'scenario', 'status', 'reason', 'limits', 'limit_reason')
    fields = [(name, pa.string() if name in words else pa.int64()) for name in IDENTITY]
    key = plan.units.key
    fields += [(key(name), pa.float64()) for name in COLUMNS]
    names = dict.fromkeys(map(key, FLOOR))  # limits of slides are in um as those of a place
    fields += [(name, pa.string() if name in words else pa.float64()) for name in names]
    if plan.study.calm:
        fields += [(key(name), pa.list_(pa.float64())) for name in CALM]
    fields += [
        (name, pa.float64() if numeric else pa.string())
        for name, numeric in plan.columns().items()
    ]
    return pa.schema(fields)


def table(schema: Any, rows: Iterable[tuple[Row, Outcome]], units: JointUnits = HINGES) -> Arrow:
    """Rows with their outcomes as a table.

    Args:
        schema: See :func:`schema`.
        rows: The rows.
        units: Those of the joints of all robots of the plan.
    """
    entries = [_entry(row, outcome, units) for row, outcome in rows]
    return arrow().Table.from_pylist(entries, schema=schema)


def _with_floors(rows: Arrow, plan: Plan) -> Arrow:
    """Whole samples, each row with the limit of the first law of its scenario."""
    numbers = rows['row'].to_numpy()
    leaders = np.array([plan.leader(case) for case in range(len(plan.cases))])
    cases = numbers % len(leaders)
    first = np.searchsorted(numbers, numbers - cases + leaders[cases])
    of_sample = (*FLOOR, *(CALM if plan.study.calm else ()))
    for name in dict.fromkeys(map(plan.units.key, of_sample)):
        place = rows.column_names.index(name)
        rows = rows.set_column(place, rows.schema.field(name), rows[name].take(first))
    return rows


def _entry(row: Row, outcome: Outcome, units: JointUnits) -> Mapping[str, Any]:
    """One row by column; columns that are left out are null."""
    found = outcome.metrics
    values = {} if found is None else columns_of(found)
    floor = {} if outcome.floor is None else outcome.floor._asdict()
    calm = {}
    if outcome.calm is not None:
        pairs = zip(CALM, outcome.calm, strict=True)
        calm = {units.key(name): curve.tolist() for name, curve in pairs}
    numbers = {
        units.key(name): value for name, value in {**values, **floor}.items() if value == value
    }
    return {
        'row': row.row,
        'law': row.law,
        'scenario': scenario_stem(row.scenario),
        'sample': row.sample,
        'seed': row.seed,
        'status': outcome.status,
        'reason': outcome.reason,
        'limits': outcome.limits,
        **numbers,
        **calm,
        **row.drawn,
    }


STUDY, RUNS, PARTS = 'study.yaml', 'runs.parquet', 'parts'
WINDOW = 65536  # rows that are merged at once, about


class Store(ResultStore):
    """The directory of a sweep."""

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
        content = {
            'version': version(),
            'runs': plan.study.runs,
            'scenarios': list(plan.study.scenarios),
            'set': plain(dict(plan.study.fixed)),
            'study': plan.description(),
        }
        super().__init__(directory, content)
        self._plan = plan
        self._text = text
        self._schema = schema(plan)
        # which rows are done, shape (rows,)
        self.done: NDArray[np.bool_] = np.zeros(plan.count, dtype=bool)

    def __exit__(self, kind: object, error: object, *_: object) -> None:
        """Release the lock; of a new sweep that failed before its first row, nothing is left."""
        if error is not None and self.new and not self.done.any():
            shutil.rmtree(self.directory / PARTS, ignore_errors=True)
            with contextlib.suppress(OSError):
                for name in (self.MANIFEST, STUDY, LOCK):
                    (self.directory / name).unlink(missing_ok=True)
                self.directory.rmdir()
        super().__exit__(kind, error)

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
                writer.write_table(_with_floors(ordered, self._plan).combine_chunks())

    def _open(self) -> None:
        if not self.new:
            self._check(manifest_of(self.directory))
        (self.directory / PARTS).mkdir(exist_ok=True)
        self.write(STUDY, self._text.encode())
        self._write_manifest()
        self._find_done()

    def _kept(self) -> str:
        return f'{int(self.done.sum())} of {len(self.done)} rows'

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


# One row of a study, to be run alone.


def row_of(name: str, number: int, fixed: Mapping[str, Any]) -> tuple[Row, list[str]]:
    """Find a row.

    Args:
        name: Directory of a sweep, file of a study, or name of one in config/studies.
        number: Number of the row.
        fixed: What the command line sets; for the row of a sweep, its custom modules alone.

    Returns:
        The row, and doubts whether it is the one that was run.

    Raises:
        InputError: there is no such row.
    """
    directory = Path(name)
    if not directory.is_dir():
        file = study.file_of(name)
        asked = study.parse(study.read(file), str(file), file.parent).changed(None, fixed)
        return plan(asked).row(number), []
    manifest = manifest_of(directory)
    for key in fixed:
        if key not in config.CUSTOM:
            raise InputError(f'--set {key}: a row of a sweep is run as it was; only code is given')
    for key in config.CUSTOM:
        if manifest['set'].get(key) and key not in fixed:
            raise InputError(
                f'{directory} was made with code of its own; give --set {key}=... once more'
            )
    file = directory / STUDY
    parsed = study.parse(study.read(file), str(file))
    asked = replace(parsed, scenarios=tuple(map(str, manifest['scenarios'])))  # it is a copy
    found = plan(asked.changed(manifest['runs'], {**manifest['set'], **fixed}))
    doubts = [study_doubt(manifest, found), version_doubt(manifest)]
    return found.row(number), [f'{directory}: {doubt}' for doubt in doubts if doubt]
