"""The command ``replay``: the torques of a bag computed again, by its law or another."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.analysis.replay import replayed
from parallel_robot.analysis.report import figures
from parallel_robot.bags import arithmetic, new_files, recording
from parallel_robot.bags.history import History
from parallel_robot.bags.limits import add_memory_argument
from parallel_robot.bags.run_log import RunLog
from parallel_robot.bags.trust import add_trust_argument, custom_files
from parallel_robot.cli.commands.simulate import add_set_argument, given
from parallel_robot_control.configuration import available, configure, custom_defaults
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.configuration import is_known
from trajectory_gen.shapes import shapes

# Beginnings of keys on which torques depend, beside those of the laws.
GROUPS = ('controller', 'estimator', 'lock_in', 'approach', 'safety')
USED = ('law', *config.CUSTOM, 'robot', *GROUPS)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag, or one file of it')
    parser.add_argument('--law', help='control law, default: the recorded one')
    add_set_argument(parser)
    parser.add_argument(
        '--figure',
        type=Path,
        metavar='FILE',
        help='picture of both torques; with --law or --set: default BAG/replay_LAW.png',
    )
    add_trust_argument(parser)
    add_memory_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    changes = given(arguments)
    if arguments.law is not None:
        changed_law = changes.setdefault('law', arguments.law)
        if changed_law != arguments.law:
            raise InputError(f'--law is {arguments.law}, but --set law={changed_law}')
    if arguments.figure is not None:
        _check_figure(arguments.figure)
    bag = arguments.bag
    memory = arguments.max_memory
    log, past, _ = recording.read(bag, memory=memory)
    for warning in log.warnings:
        print(f'warning: {warning}', file=sys.stderr)
    if np.isnan(log.answer).all() or not (log.used is None or log.used.stamps.any()):
        raise BagError(f'{bag}: no command answers a state')
    with tempfile.TemporaryDirectory() as directory:
        needed = {key: found for key, found in past.sources.items() if key not in changes}
        if changes.get('law') in LAWS:
            needed.pop('custom_laws', None)
        robot = str(log.config['robot_model'])
        files = custom_files(bag, needed, log.config, Path(directory), arguments.trust)
        values = configuration(log, past, files, changes)
        law = str(values['law'])
        if law not in available(values['custom_laws']) and not changes:
            what = 'say which law ran' if law == 'unknown' else f'hold the law {law}'
            raise BagError(
                f'{bag} does not {what}; --law tries one, --set custom_laws=[FILE] adds one'
            )
        if not is_known(values):
            raise BagError(
                f'{bag} does not hold the robot {robot}; --set custom_robots=[FILE] adds one'
            )
        shape = values['trajectory.shape']
        if shape not in shapes(values['custom_trajectories']):
            raise BagError(
                f'{bag} does not hold the trajectory {shape}; '
                '--set custom_trajectories=[FILE] adds one'
            )
        figure = arguments.figure
        if changes and figure is None:
            figure = (bag if bag.is_dir() else bag.parent) / f'replay_{law}.png'
            _check_figure(figure)
        compute = replayed.instead if changes else replayed.again
        result = compute(log, past, configure(values))
    if figure is not None:
        try:
            figures.draw_torques(log, result.torque, law, figure)
        except OSError as error:
            raise InputError(f'cannot write {figure}: {error.strerror}') from None
    answered = int((~np.isnan(result.torque[:, 0])).sum())
    print(f'{log.scenario}, {log.law}: {answered} states answered again by {law}')
    lines = table(log, result) if changes else verdict(log, result)
    print('\n'.join([*lines, *([f'figure  {figure}'] if figure else [])]))
    if not changes and result.differing.any() and arithmetic.doubt(past.facts):
        print(f'warning: {arithmetic.doubt(past.facts)}', file=sys.stderr)
    return int(not changes and result.remembered and bool(result.differing.any()))


def configuration(
    log: RunLog, past: History, files: Mapping[str, list[str]], changes: dict[str, Any]
) -> dict[str, Any]:
    """Configuration of a bag's controller at the first state, with changes.

    Args:
        log: The run.
        past: What happened beside the motion.
        files: Custom modules by key; files that the bag only names are not loaded.
        changes: Key to value.

    Raises:
        InputError: a key does not exist, is not one of the controller, or its value is wrong.
    """
    known = log.config | {key: [] for key in config.CUSTOM}
    values = config.changed(known, files, custom_defaults)
    for node, parameters in past.parameters.items():
        if node.endswith('/controller'):
            values |= {
                key: value
                for key, value in parameters.items()
                if key in values and key not in config.CUSTOM
            }
    values = config.changed(values, changes, custom_defaults)
    for key in changes:
        if key.partition('.')[0] not in (*USED, *available(values['custom_laws'])):
            raise InputError(f'{key} does not change the torques on a recorded motion')
    return values


def verdict(log: RunLog, result: replayed.Replay) -> list[str]:
    """Whether the torques are the recorded commands."""
    count, differing = int(result.known.sum()), np.flatnonzero(result.differing)
    lines = []
    if result.late:
        lines.append(f'{result.late} states were answered with a reference that came late')
    if count < len(result.known):
        what = 'have no recorded command' if log.used is None else 'were not answered'
        lines.append(f'{len(result.known) - count} states {what}')
    if not differing.size:
        return [*lines, f'identical: {count} commands']
    difference = np.abs(result.torque - result.recorded)[differing].max()
    if not result.remembered:
        lines.append(
            'not compared: the bag begins while the controller ran, and what law and estimator '
            'remembered then is not in it; with an empty memory:'
        )
    return [
        *lines,
        f'{differing.size} of {count} commands differ, by up to {difference:.3g} N m, '
        f'from t = {log.time[differing[0]]:.3f} s on',
    ]


def table(log: RunLog, result: replayed.Replay) -> list[str]:
    """Difference to the recorded commands, joint by joint."""
    difference = (result.torque - result.recorded)[result.known]
    rows = {
        'rms': np.sqrt((difference**2).mean(axis=0)),
        'max': np.abs(difference).max(axis=0),
    }
    lines = ['difference of torques [N m]' + ''.join(f'{joint:>12}' for joint in log.joints)]
    return lines + [
        f'  {name:<25}' + ''.join(f'{value:>12.3f}' for value in values)
        for name, values in rows.items()
    ]


def _check_figure(figure: Path) -> None:
    figures.check_format(figure)
    new_files.check(figure, '--figure')
