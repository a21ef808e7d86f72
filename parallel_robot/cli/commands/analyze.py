"""The command ``analyze``: metrics and a picture of one bag."""

from __future__ import annotations

import argparse
import contextlib
import json
import os
from pathlib import Path
from typing import Any

from parallel_robot.analysis import evaluated_bag, pictures, run_results, timing
from parallel_robot.analysis.evaluated_bag import PartFigures
from parallel_robot.analysis.metrics import named
from parallel_robot.analysis.readable_metrics import TRUE_AND_SEEN_ERRORS, defined, shown, told
from parallel_robot.analysis.report import figures
from parallel_robot.analysis.report.looks import add_scale_argument
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.bags import history, output
from parallel_robot.bags.run import run_windows
from parallel_robot.bags.run.recorded_robot import code_of
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.from_function import VIEW_OF_BAG
from parallel_robot.cli.shared import (
    add_format_argument,
    add_window_arguments,
    show,
    warn,
)
from parallel_robot_model.common.tables import Part
from parallel_robot_model.configuration.loop import length


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the metrics as JSON')
    parser.add_argument(
        '--figure',
        type=Path,
        metavar='FILE',
        help='picture; png, pdf, svg; default: BAG/run.png in a bag of the suite, '
        'where there is none yet',
    )
    add_format_argument(parser)
    add_window_arguments(parser)
    add_scale_argument(parser)
    VIEW_OF_BAG.add_arguments(parser)
    add_trust_argument(parser, 'the robot')


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    directory = arguments.bag if arguments.bag.is_dir() else arguments.bag.parent
    figure: Path = arguments.figure or directory / 'run.png'
    if arguments.json:
        output.check_new(arguments.json, '--json')
    if arguments.figure:
        pictures.check_new(figure)
    view = VIEW_OF_BAG.call(arguments)._replace(whole=True)
    code = code_of(arguments.trust, view)
    times = arguments.start, arguments.stop
    run = evaluated_bag.evaluate(arguments.bag, code, view, times, lambda text: warn([text]))
    if isinstance(run, MotionAlone):
        return _without_reference(arguments, run)
    log, past, timed, found = run.log, run.past, run.timing, run.metrics
    failure = '' if found.window.requested else history.failure(past, log.start_stamp, run.last)
    result = run_results.summarise(log, found, timed, failure)
    result['law'] = ', then '.join(run_windows.laws_of(run.parts))
    foreign = log.foreign and not arguments.figure
    kept = not arguments.figure and os.path.lexists(figure)
    with contextlib.ExitStack() as written:
        if arguments.json:
            written.enter_context(output.written(arguments.json, as_json(result)))
        if not kept and not foreign:
            marks = [one.begin for one in run.parts[1:]]
            named = log._replace(law=result['law'])
            figures.draw_run(named, run.motion, figure, arguments.scale, marks, run.path.poses)
    quiet = ['no limit acted, no fault'] if past.statuses and not run.saturated else []
    remarks = [*(history.remarks(past, log.start_stamp) or quiet), *timing.remarks(timed, past)]
    remarks += timing.never_sent(timed, log.messages, past)
    remarks += history.new_motions(past, log.start_stamp)
    remarks += [
        *run.remarks,
        *run_windows.stretches_told(run.parts),
        *map(of_stretch, run.figures),
    ]
    verdict = timing.verdict(timed)
    printed: list[Part] = [verdict] if verdict else []
    printed += run_results.tables(result, found, length(log.config))
    printed += [f'  {text}' for text in remarks]
    old = ' exists and is kept; --figure draws another' if kept else ''
    drawn = figures.NOT_IN_FOREIGN if foreign else f'{figure}{old}'
    files = [f'bag     {arguments.bag}', f'figure  {drawn}']
    show(arguments.format, printed, result, files)
    return 0


def _without_reference(arguments: argparse.Namespace, motion: MotionAlone) -> int:
    """Print what is known of a motion that has no reference."""
    with contextlib.ExitStack() as written:
        if arguments.json:
            written.enter_context(output.written(arguments.json, as_json(motion.as_data())))
        if arguments.figure:
            motion.drawn(figures.draw_motion, arguments.figure)
    figure = [f'figure  {arguments.figure}'] if arguments.figure else []
    files = [f'bag     {arguments.bag}', *figure]
    show(arguments.format, motion.parts(), motion.as_data(), files)
    return 0


def of_stretch(part: PartFigures) -> str:
    """Figures of a stretch of a run, over its second half, as a line."""
    stretch, found, last = part
    texts = [
        told(metric, found, shown)
        for metric in defined([*TRUE_AND_SEEN_ERRORS, *named('chattering_nm')], found)
    ]
    return f'{stretch.begin:g} to {last:g} s, {stretch.law}: {"; ".join(texts)}'


def as_json(result: dict[str, Any]) -> bytes:
    """Plain data as JSON for a file."""
    return (json.dumps(result, indent=2) + '\n').encode()
