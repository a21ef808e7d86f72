"""A sweep: all rows of a plan, run once each, kept, and summarised."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from parallel_robot.bags.output import as_it_is
from parallel_robot.studies.sweep import results, summary
from parallel_robot.studies.sweep.plan import Plan, plan
from parallel_robot.studies.sweep.run_chunk import tasks
from parallel_robot.studies.sweep.store import RUNS, Store, schema, table
from parallel_robot.studies.sweep.study import file_of, parse, read
from parallel_robot.studies.sweep.summary import Results
from parallel_robot.studies.sweep.workers import Cluster, Processes, Workers, completed
from parallel_robot_control import law_loader
from parallel_robot_model.common.errors import Frame, InputError, RunError, optional, pandas
from parallel_robot_model.common.options import named, path
from parallel_robot_model.common.tables import Part, ShownResult, returning
from parallel_robot_model.configuration.config import Changes, Place, changes
from parallel_robot_model.configuration.fields import Field, check

MOST_WORKERS = 1024
FILES = ('summary.txt', 'summary.csv', 'summary.tex', 'summary.html')


@dataclass(frozen=True, repr=False)
class Swept(ShownResult):
    """A sweep that has ended."""

    plan: Plan
    results: Results  # scenario by scenario
    out: Path  # its directory

    def parts(self) -> list[Part]:
        """The summary."""
        return summary.parts(self.plan, self.results)

    def as_data(self) -> list[dict[str, Any]]:
        """The same as plain data."""
        return summary.as_data(self.results)

    def file_lines(self) -> list[str]:
        """Its files."""
        out, picture = self.out, self.out / 'distributions.png'
        pages = f'summary {out / "summary.txt"} (.csv, .tex, .html), {picture} (.pdf)'
        return [f'rows    {out / RUNS}', pages]

    def frame(self) -> Frame:
        """One row a run."""
        frame: Frame = pandas().read_parquet(self.out / RUNS)
        return frame


@returning(Swept.frame, pandas)
def sweep(
    study: Place | Mapping[str, Any],
    out: Place,
    *,
    runs: int | None = None,
    laws: Sequence[Place] | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    param_file: Changes = None,
    **values: Any,
) -> Swept:
    """Run a study on several cores, or what is left of it, as ``parallel_robot sweep`` does.

    >>> import parallel_robot as pr
    >>> study = {'scenarios': ['paper_circle'], 'laws': ['smc', 'pid'], 'runs': 1, 'duration': 0.1}
    >>> pr.sweep(study, 'runs/swept', workers=1).law.tolist()
    ['smc', 'pid']

    Args:
        study: File of a study, name of one in ``config/studies``, or its keys and values.
        out: Directory of the results; new, or that of the same sweep, which is continued.
        runs: Runs of each law and scenario; default: the study's.
        laws: In place of the study's, names or files; a name of one of these keeps its gains.
        workers: Processes; default: one for each core.
        scheduler: Address of a dask scheduler, on whose cluster it runs instead.
        param_file: YAML file or mapping of keys of the configuration, or several; later ones win.
        values: Keys of the configuration and their values in all runs.

    Returns:
        The table of the runs, one row each, as a pandas.DataFrame; see docs/studies.md.

    Raises:
        InputError: something in the study or in the arguments is wrong.
        RunError: workers cannot run it, or the disk is full; finished rows are kept.
    """
    make, count = workers_of(workers, scheduler)
    started, directory = make(), path('out', out)
    if isinstance(study, Mapping):
        try:
            text = yaml.safe_dump(dict(study), sort_keys=False)
        except yaml.YAMLError:
            what = 'study must hold plain numbers, texts, lists and mappings'
            raise InputError(what) from None
        name, folder = 'study', None
    elif isinstance(study, str | Path):
        file = file_of(str(study))
        text, name, folder = read(file), str(file), file.parent
    else:
        raise InputError(f'study must be a name, a path or keys and values, not {study!r}')
    fixed = changes(param_file, values)
    listed = None if laws is None else [named('law', law) for law in laws]
    names = None if listed is None else [*map(law_loader.name_of, listed)]
    fixed |= law_loader.files_of(listed or (), fixed)
    asked = parse(text, name, folder, names).changed(runs, fixed)
    planned = plan(asked)
    return Swept(planned, run(planned, asked.text, directory, started, count), directory)


def run(plan: Plan, text: str, directory: Path, workers: Workers, count: int) -> Results:
    """Run what is left of a plan, and summarise it.

    Args:
        plan: The plan.
        text: The file of its study, which is kept with the results.
        directory: Where the results go; new, or that of the same sweep.
        workers: Who runs it; they are started only if something is left.
        count: Number of workers, by which the work is divided.

    Returns:
        The results, scenario by scenario.

    Raises:
        InputError: the directory holds something else, or workers cannot be reached.
        RunError: workers cannot run it, or the disk is full; finished rows are kept.
    """
    with Store(directory, plan, text) as store:
        if not store.done.all():
            _run(plan, store, workers, count)
        store.finish()
        return summarise(plan, directory)


def _run(plan: Plan, store: Store, workers: Workers, count: int) -> None:
    columns, done = schema(plan), store.done
    with progress(len(done), lambda: int(done.sum()), 'run', 'rows') as bar, workers as started:
        for task, outcomes in completed(started, tasks(plan, done, count)):
            rows = zip(task.rows, outcomes, strict=True)
            store.add(table(columns, rows, plan.units))
            bar.update(len(outcomes))


@contextlib.contextmanager
def progress(total: int, done: Callable[[], int], unit: str, kept: str = '') -> Iterator[Any]:
    """A bar with an estimate of the time left, on a terminal; says what an interruption leaves.

    Args:
        total: What there is to do.
        done: Tells what of it is done by now.
        unit: What is counted.
        kept: What stays of it, if that is not called so.

    Raises:
        InputError: tqdm is not installed.
    """
    tqdm: Any = optional('tqdm').tqdm
    stream = as_it_is(sys.stderr)
    try:
        with tqdm(
            total=total, initial=done(), unit=unit, file=stream, disable=None, leave=False
        ) as bar:
            yield bar
    except KeyboardInterrupt:
        what = f'{done()} of {total} {kept or f"{unit}s"} are kept'
        print(f'interrupted: {what}, the same command continues', file=sys.stderr)
        raise


def default_workers() -> int:
    """One worker for each core that this process may use."""
    return len(os.sched_getaffinity(0))


def worker_count(workers: int | None) -> int:
    """How many workers are asked for.

    Raises:
        InputError: they are none, or too many.
    """
    given = default_workers() if workers is None else workers
    return check('--workers', int, Field('', '', 1, MOST_WORKERS), given)


def workers_of(workers: int | None, scheduler: str | None) -> tuple[Callable[[], Workers], int]:
    """What makes those who run the work, processes here or a cluster, and how many they are.

    Raises:
        InputError: the options do not fit together.
    """
    if scheduler is not None:
        if workers is not None:
            raise InputError('--workers is for processes on this machine, not for --scheduler')
        return lambda: Cluster(scheduler), 2 * default_workers()
    count = worker_count(workers)
    return lambda: Processes(count), count


def summarise(plan: Plan, directory: Path) -> Results:
    """Write the summary of a finished sweep; returns the results.

    Raises:
        RunError: it cannot be written.
    """
    from parallel_robot.studies.sweep import picture  # slow to import: workers start meanwhile

    found = results.evaluate(directory / RUNS, plan)
    pictures = picture.draw(found)
    page = summary.page(plan, found, pictures['png'])
    contents = (summary.text(plan, found), summary.table(found), summary.latex(found), page)
    files = {name: content.encode() for name, content in zip(FILES, contents, strict=True)}
    files |= {f'distributions.{suffix}': content for suffix, content in pictures.items()}
    for name, content in files.items():
        unfinished = directory / f'{name}.unfinished'
        try:
            unfinished.write_bytes(content)
            os.replace(unfinished, directory / name)
        except OSError as error:
            with contextlib.suppress(OSError):
                unfinished.unlink(missing_ok=True)
            file = directory / name
            raise RunError(f'cannot write {file}: {error.strerror}; all rows are kept') from None
    return found
