"""The command ``analyze``: metrics and a picture of one bag."""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis import metrics, motion_alone, recorded_motions, timing
from parallel_robot.analysis.readable_metrics import (
    AS_SEEN,
    STEADY,
    TORQUE,
    as_data,
    defined,
    head,
    shown,
    whole,
)
from parallel_robot.analysis.report import figures
from parallel_robot.analysis.report.scale import add_scale_argument
from parallel_robot.bags import history, new_files, recorded_robot, run_log, stretches
from parallel_robot.bags.limits import add_memory_argument
from parallel_robot.bags.stretches import Stretch
from parallel_robot.bags.trust import add_trust_argument
from parallel_robot.cli.bag_options import add_bag_arguments, bag_view
from parallel_robot.cli.commands.simulate import add_set_argument, given
from parallel_robot.cli.result_format import add_format_argument, show
from parallel_robot.cli.robot_code import robot_code
from parallel_robot.cli.window import add_window_arguments
from parallel_robot_model.common.errors import BagError, InputError, KinematicsError
from parallel_robot_model.common.tables import Part, Table
from parallel_robot_model.configuration.loop import length
from parallel_robot_sim.motions import Motions

SHORTEST = 10  # states of a stretch of which there are figures


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the metrics as JSON')
    parser.add_argument(
        '--figure',
        type=Path,
        metavar='FILE',
        help='picture; png, pdf, svg; default: BAG/run.png, where there is none yet',
    )
    add_format_argument(parser)
    add_window_arguments(parser)
    add_scale_argument(parser)
    add_bag_arguments(parser, window=False)
    add_set_argument(parser)
    add_trust_argument(parser, 'the robot')
    add_memory_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    directory = arguments.bag if arguments.bag.is_dir() else arguments.bag.parent
    figure = arguments.figure or directory / 'run.png'
    if arguments.json:
        new_files.check(arguments.json, '--json')
    if arguments.figure:
        figures.check_new(figure)
    memory = arguments.max_memory
    values = given(arguments)
    code, view = robot_code(arguments, values), bag_view(arguments, values, whole=True)
    log, past, _ = recorded_robot.read(arguments.bag, memory, code, view=view, motion_only=True)
    for warning in log.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    if not np.isfinite(log.reference_position).any():
        return _without_reference(arguments, log)
    part_of = run_log.between(arguments.bag, log, arguments.start, arguments.stop)
    timed = timing.evaluate(part_of, past)
    try:
        part = recorded_motions.of_bag(log, past)
    except KinematicsError as error:
        raise BagError(f'{arguments.bag}: {error}') from None
    log = part.log
    if part.cut:
        print(f'warning: {part.cut}', file=sys.stderr)
    found = metrics.figures(part.motions, arguments.start, arguments.stop)
    failure = history.failure(past, log.start_stamp, int(log.stamps[-1]))
    if found.window.asked:
        failure = ''
    result = summarise(log, found, timed, failure)
    parts = stretches.of_run(past, log)
    result['law'] = ', then '.join(stretches.laws(parts))
    kept = not arguments.figure and os.path.lexists(figure)
    try:
        with contextlib.ExitStack() as written:
            if arguments.json:
                written.enter_context(new_files.written(arguments.json, as_json(result)))
            if not kept:
                marks = [one.begin for one in parts[1:]]
                drawn, motion = log._replace(law=result['law']), part.motions.best
                figures.draw_run(drawn, motion, figure, arguments.scale, marks)
    except OSError as error:
        raise InputError(f'cannot write {error.filename}: {error.strerror}') from None
    quiet = ['no limit acted, no fault'] if past.statuses and not part.saturated else []
    remarks = [*(history.remarks(past, log.start_stamp) or quiet), *timing.remarks(timed, past)]
    remarks += history.new_motions(past, log.start_stamp)
    remarks += [*part.remarks, *stretches.told(parts), *of_stretches(part.motions, parts)]
    verdict = timing.verdict(timed)
    printed: list[Part] = [verdict] if verdict else []
    printed += tables(result, found, length(log.config))
    printed += [f'  {text}' for text in remarks]
    old = ' exists and is kept; --figure draws another' if kept else ''
    files = [f'bag     {arguments.bag}', f'figure  {figure}{old}']
    show(arguments.format, printed, result, files)
    return 0


def _without_reference(arguments: argparse.Namespace, log: run_log.RunLog) -> int:
    """Print what is known of a motion that has no reference."""
    if arguments.json or arguments.figure:
        given = '--json' if arguments.json else '--figure'
        raise BagError(f'{arguments.bag} has no reference: no errors, and no {given}')
    log = run_log.between(arguments.bag, log, arguments.start, arguments.stop)
    parts, data = motion_alone.parts(log), motion_alone.as_data(log)
    show(arguments.format, parts, data, [f'bag     {arguments.bag}'])
    return 0


def of_stretches(motions: Motions, parts: Sequence[Stretch]) -> Iterator[str]:
    """Figures of each of several stretches of a run, in lines, over the second half of each."""
    ends = [*(one.begin for one in parts[1:]), math.inf]
    for one, end in zip(parts, ends, strict=True):
        part = motions.between(one.begin, end)
        if len(parts) == 1 or len(part.best.time) < SHORTEST:
            continue
        found = metrics.figures(part)
        last = float(part.best.time[-1])
        texts = [
            f'{metric.name} {shown(metric.value(found))} {metric.unit}'
            for metric in defined((*STEADY[::2], AS_SEEN[2], AS_SEEN[4], TORQUE[2]), found)
        ]
        yield f'{one.begin:g} to {last:g} s, {one.law}: {"; ".join(texts)}'


def as_json(result: dict[str, Any]) -> bytes:
    """Plain data as JSON for a file."""
    return (json.dumps(result, indent=2) + '\n').encode()


def summarise(
    log: run_log.RunLog, found: metrics.Metrics, timed: timing.Timing, failure: str = ''
) -> dict[str, Any]:
    """Metrics and timing as plain data, for JSON; of a run that failed, why in their place."""
    return {
        'scenario': log.scenario,
        'law': log.law,
        'duration_s': found.duration_s,
        **({'failure': failure} if failure else as_data(found)),
        'timing': timing.as_json(timed),
        'messages': {name: asdict(count) for name, count in log.messages.items()},
    }


def tables(result: dict[str, Any], found: metrics.Metrics, planned: float = 0.0) -> list[Part]:
    """Metrics and messages.

    Args:
        result: See :func:`summarise`.
        found: The metrics.
        planned: How long the motion was to be [s]; 0 if not known.
    """
    rows = [
        [name, f'{count["count"]}', f'{count["missing"]}']
        for name, count in result['messages'].items()
    ]
    messages = Table(['messages', 'count', 'missing'], rows)
    if 'failure' in result:
        names = f'{result["scenario"]}, {result["law"]}'
        why = (
            f'{names}, {result["duration_s"]:g} s: no figures of a run that was '
            f'{result["failure"]}; --from and --to choose a part'
        )
        return [why, messages]
    lines = head(result['scenario'], result['law'], found, planned).split('\n')
    return [*lines, whole(found), messages]
