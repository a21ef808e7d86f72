"""A sweep: all rows of a plan, run once each, kept, and summarised."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from parallel_robot.bags.output import as_it_is
from parallel_robot.studies.sweep import results, summary
from parallel_robot.studies.sweep.plan import Plan
from parallel_robot.studies.sweep.run_chunk import tasks
from parallel_robot.studies.sweep.store import RUNS, Store, schema, table
from parallel_robot.studies.sweep.summary import Results
from parallel_robot.studies.sweep.workers import Workers, completed
from parallel_robot_model.common.errors import RunError, optional
from parallel_robot_model.configuration.fields import Field, check

MOST_WORKERS = 1024
FILES = ('summary.txt', 'summary.csv', 'summary.tex', 'summary.html')


def sweep(plan: Plan, text: str, directory: Path, workers: Workers, count: int) -> Results:
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


def worker_count(workers: int | None, name: str) -> int:
    """How many workers are asked for, by an option or argument of this name.

    Raises:
        InputError: they are none, or too many.
    """
    given = default_workers() if workers is None else workers
    return check(name, int, Field('', '', 1, MOST_WORKERS), given)


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
            path = directory / name
            raise RunError(f'cannot write {path}: {error.strerror}; all rows are kept') from None
    return found
