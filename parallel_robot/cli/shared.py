"""What commands share: their options, and how results are shown."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.analysis import evaluated_bag, readable_metrics, run_results, timing
from parallel_robot.analysis.evaluated_bag import EvaluatedBag
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.analysis.timing import Timing
from parallel_robot.bags import history
from parallel_robot.bags.bag_reader import AS_RECORDED
from parallel_robot.bags.limits import TRUSTED
from parallel_robot.bags.run import recorded_robot, run_log, run_windows
from parallel_robot.bags.run.recorded_robot import RobotCode
from parallel_robot_model.common import tables
from parallel_robot_model.common.options import number
from parallel_robot_model.common.tables import Part
from parallel_robot_model.configuration import config, yaml_file
from parallel_robot_model.configuration.loop import length
from parallel_robot_model.configuration.plain_data import LocatedDict

# What changes the configuration, on a command line.


def add_set_argument(parser: argparse.ArgumentParser) -> None:
    """Declare what changes the configuration: ``--param-file`` and ``--set``."""
    parser.add_argument(
        '--param-file',
        action='append',
        default=[],
        type=Path,
        metavar='FILE',
        help='YAML file with keys of the configuration, also as ROS has them; may be repeated, '
        'the later wins',
    )
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        dest='assignments',
        metavar='KEY=VALUE',
        help='change a key of the configuration, e.g. s_fotsmc.G=12; may be repeated and wins '
        'over --param-file',
    )


def layers(arguments: argparse.Namespace) -> list[Path | LocatedDict]:
    """What ``--param-file`` and ``--set`` say: files, and what wins over them."""
    assigned = yaml_file.parse_assignments(arguments.assignments)
    return [*arguments.param_file, LocatedDict(assigned)]


def given(arguments: argparse.Namespace) -> LocatedDict:
    """What ``--param-file`` and ``--set`` change together.

    Raises:
        InputError: a file cannot be read or names code, or a word is not KEY=VALUE.
    """
    return config.changes(layers(arguments), {})


# The part of a run that figures are of, on a command line.


def add_window_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare ``--from`` and ``--to``."""
    for name, dest, end in (('--from', 'start', 'first'), ('--to', 'stop', 'last')):
        parser.add_argument(
            name,
            dest=dest,
            type=time_on_line,
            metavar='S',
            help=f'{end} time of the part that all figures are of, default: errors are those of '
            'the second half of the motion',
        )


def time_on_line(text: str) -> float:
    """A time [s]."""
    found = number(text)
    if not math.isfinite(found):
        raise argparse.ArgumentTypeError(f'a time in s is wanted, not {text!r}')
    return found


# The option ``--format``: results as text, JSON, Markdown or LaTeX.

TEXT, JSON = 'text', 'json'
FORMATS = (TEXT, JSON, *(name for name in tables.FORMATS if name != TEXT))


def add_format_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the option."""
    parser.add_argument(
        '--format',
        choices=FORMATS,
        help='of the results: text (default), json, or tables in markdown or latex',
    )


def show(form: str | None, parts: Iterable[Part], data: Any, files: Iterable[str] = ()) -> None:
    """Print results.

    Args:
        form: One of FORMATS; None: text.
        parts: Their lines and tables.
        data: The same as plain data, for JSON; what is not finite is null.
        files: Lines on files that were written, see :func:`tell`.
    """
    if form == JSON:
        print(json.dumps(_finite(data), indent=2))
    elif form in (None, TEXT):
        print(tables.text(parts))
    else:
        print(tables.FORMATS[form](readable_metrics.titled(parts) if form == 'latex' else parts))
    tell(form, *files)


def tell(form: str | None, *lines: str) -> None:
    """Print lines on what is no result, such as files: in text alone."""
    if form in (None, TEXT):
        print(*lines, sep='\n', end='\n' if lines else '')


def warn(lines: Iterable[object]) -> None:
    """Print what to doubt of results, one line each."""
    for line in lines:
        print(f'warning: {line}', file=sys.stderr)


def _finite(data: Any) -> Any:
    """Plain data as JSON can have it."""
    if isinstance(data, dict):
        return {key: _finite(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(value) for value in data]
    return None if isinstance(data, float) and not math.isfinite(data) else data


# A run that was recorded, and its results.


class Made(NamedTuple):
    """A run that was recorded."""

    log: run_log.RunLog  # the run; of a long one, its last states
    past: history.History  # what happened beside the motion
    timed: Timing  # how it kept its time
    evaluated: Callable[[], EvaluatedBag]  # returns all of its figures

    @property
    def failure(self) -> str:
        """Why it has no figures; empty if it has."""
        return history.failure(self.past, self.log.start_stamp, int(self.log.stamps[-1]))


def read_run(out: Path, code: RobotCode) -> Made:
    """Read the bag of a run, a long one in windows.

    Raises:
        BagError: it has no state.
    """
    if evaluated_bag.long(out, AS_RECORDED):
        found = evaluated_bag.evaluate(out, code, motion_only=False)
        assert not isinstance(found, MotionAlone)
        return Made(found.log, found.past, found.timing, lambda: found)
    whole = recorded_robot.read(out, TRUSTED, code)
    timed = timing.evaluate(whole.log, whole.history)
    return Made(whole.log, whole.history, timed, lambda: evaluated_bag.of_whole(out, whole))


def run_lines(made: Made) -> list[str]:
    """The metrics of a run up to the first state without a pose, in lines."""
    log = made.log
    if made.failure:
        return [f'{log.scenario}, {log.law}: no figures of a run that was {made.failure}']
    found = made.evaluated()
    laws = ', then '.join(run_windows.laws_of(found.parts))
    head = readable_metrics.head(log.scenario, laws, found.metrics, length(log.config))
    told = [head, *readable_metrics.brief(found.metrics, log.messages)]
    return [*told, *_remarks(found)]


def _remarks(found: EvaluatedBag) -> list[str]:
    return [f'  {text}' for text in (*found.remarks, *run_windows.stretches_told(found.parts))]


def run_tables(made: Made) -> tuple[list[Part], dict[str, Any]]:
    """The metrics as tables, and as plain data."""
    verdict = [*filter(None, [timing.verdict(made.timed)])]
    if made.failure:
        names = {'scenario': made.log.scenario, 'law': made.log.law}
        told = {'failure': made.failure, 'timing': timing.as_json(made.timed)}
        return [*verdict, *run_lines(made)], names | told
    found = made.evaluated()
    data = run_results.summarise(made.log, found.metrics, made.timed)
    data['law'] = ', then '.join(run_windows.laws_of(found.parts))
    parts = run_results.tables(data, found.metrics, length(made.log.config))
    return [*verdict, *parts, *_remarks(found)], data
