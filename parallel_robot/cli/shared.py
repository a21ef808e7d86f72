"""What commands share: their options, and how results are shown."""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from parallel_robot.analysis import evaluated_bag, readable_metrics, run_results, timing
from parallel_robot.analysis.evaluated_bag import EvaluatedBag
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.analysis.timing import Timing
from parallel_robot.bags import history
from parallel_robot.bags.bag_reader import AS_RECORDED, NAMES, BagView, view
from parallel_robot.bags.limits import TRUSTED
from parallel_robot.bags.run import recorded_robot, run_log, run_windows
from parallel_robot.bags.run.recorded_robot import KEY, RobotCode
from parallel_robot_model.common import tables
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.options import number
from parallel_robot_model.common.tables import Part
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.loop import length
from parallel_robot_model.messages.topics import add_namespace_argument, full

if TYPE_CHECKING:
    from parallel_robot.studies.sweep.workers import Workers

# The part of a run that figures are of, on a command line.

OF_FIGURES = (
    'time of the part that all figures are of, default: errors are those of the second half of '
    'the motion'
)


def add_window_arguments(parser: argparse.ArgumentParser, text: str = OF_FIGURES) -> None:
    """Declare ``--from`` and ``--to``; `text` says what they choose."""
    for name, dest, end in (('--from', 'start', 'first'), ('--to', 'stop', 'last')):
        parser.add_argument(
            name,
            dest=dest,
            type=_time,
            metavar='S',
            help=f'{end} {text}',
        )


def _time(text: str) -> float:
    """A time [s]."""
    found = number(text)
    if not math.isfinite(found):
        raise argparse.ArgumentTypeError(f'a time in s is wanted, not {text!r}')
    return found


# How a bag is to be read, on a command line: the same options for all commands that read one.

NOT_IN_FOREIGN = 'none in a bag of somebody else; --figure FILE draws one'


def add_bag_arguments(parser: argparse.ArgumentParser, window: bool = True) -> None:
    """Declare what a bag does not say itself, beside ``--param-file`` and ``--set``.

    Args:
        parser: Of the command.
        window: Whether ``--from`` and ``--to`` are declared, too, and choose what is read.
    """
    parser.add_argument(
        '--topic',
        action='append',
        default=[],
        dest='topics',
        metavar='NAME=TOPIC',
        help='topic of the bag in place of one of the suite, e.g. '
        'joint_states=/robot1/joint_states, reference=..., commands=...; may be repeated',
    )
    if not any(action.dest == 'namespace' for action in parser._actions):
        add_namespace_argument(parser, 'of the robot, in a bag of several', None)
    parser.add_argument(
        '--joints',
        metavar='A,B,C',
        help='names of the joints in the bag, in the order of those of the robot',
    )
    if not any(action.dest == 'scenario' for action in parser._actions):
        parser.add_argument(
            '--scenario',
            help='what a bag without a configuration is of, default: paper_circle',
        )
    parser.add_argument(
        '--override',
        action='store_true',
        help='--scenario, --joints, --param-file and --set take the place of what a bag says',
    )
    if window:
        add_window_arguments(parser, 'time of the part that is read, default: all')


def bag_view(
    arguments: argparse.Namespace, values: Mapping[str, Any], whole: bool = False
) -> BagView:
    """How a bag is to be read, by the arguments.

    Args:
        arguments: Of the command.
        values: Keys of the configuration, of ``--param-file`` and ``--set``.
        whole: Whether all is read, whatever ``--from`` and ``--to`` say.

    Raises:
        InputError: one of them is wrong.
    """
    joints = (arguments.joints or '').split(',')
    return view(
        _topics_of(arguments.topics),
        None if arguments.namespace is None else full(arguments.namespace),
        [name.strip() for name in joints if name.strip()],
        arguments.scenario,
        values,
        arguments.override,
        (arguments.start, arguments.stop),
    )._replace(whole=whole)


def _topics_of(words: list[str]) -> dict[str, str]:
    """Topics by name, of words NAME=TOPIC."""
    found = {}
    for word in words:
        name, equals, topic = word.partition('=')
        if not equals:
            names = ', '.join(list(NAMES)[:3])
            raise InputError(f'--topic takes NAME=TOPIC, with a name as {names}, not {word!r}')
        found[name.strip()] = topic.strip()
    return found


# The code of the robot of a bag, on a command line.


def robot_code(arguments: argparse.Namespace, values: Mapping[str, Any]) -> RobotCode:
    """What may run to know the robot of a bag.

    Args:
        arguments: Of the command.
        values: What ``--set`` says.

    Raises:
        InputError: it is of no list of files.
    """
    return RobotCode(arguments.trust, tuple(config.absolute_modules(KEY, values.get(KEY, []))))


# The options that say who runs the work of a command: processes here, or a cluster.


def add_worker_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument(
        '--workers', type=int, metavar='N', help='processes, default: one for each core'
    )
    parser.add_argument(
        '--scheduler', metavar='ADDRESS', help='run on the cluster of this dask scheduler instead'
    )


def workers_of(arguments: argparse.Namespace) -> tuple[Callable[[], Workers], int]:
    """What makes those who run the work, and how many they are.

    Raises:
        InputError: the options do not fit together.
    """
    # Studies take long to load, and few commands have workers.
    from parallel_robot.studies.sweep.sweep import default_workers, worker_count
    from parallel_robot.studies.sweep.workers import Cluster, Processes

    if arguments.scheduler is not None:
        if arguments.workers is not None:
            raise InputError('--workers is for processes on this machine, not for --scheduler')
        return lambda: Cluster(arguments.scheduler), 2 * default_workers()
    count = worker_count(arguments.workers, '--workers')
    return lambda: Processes(count), count


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
