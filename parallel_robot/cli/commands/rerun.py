"""The command ``rerun``: the experiment of a bag once more, from the bag alone."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from parallel_robot.analysis.replay import recorded_controller
from parallel_robot.bags import arithmetic, recording
from parallel_robot.bags.experiment import SIMULATION, software
from parallel_robot.bags.history import History
from parallel_robot.bags.indexed_reader import BagReader
from parallel_robot.bags.limits import MEMORY, Allowance, add_memory_argument
from parallel_robot.bags.run_log import RunLog
from parallel_robot.bags.trust import add_trust_argument, custom_files
from parallel_robot.cli.commands import run, simulate
from parallel_robot_control.configuration import available, configure, custom_defaults, resolve
from parallel_robot_model.common.errors import BagError, RunError
from parallel_robot_model.common.printable import printable
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_model.configuration.parameter_file import MOTION
from parallel_robot_model.messages.topics import SLOW
from parallel_robot_model.robots.configuration import is_known
from trajectory_gen.shapes import shapes

LONGER, SHORT = 100, 20_000  # a rerun is at most so many times as long, or so many states
OBJECT = 200  # bytes that a message takes beside its own
BASE = 'paper_circle'  # of a scenario that is not shipped
MODULES = ('robot_model', *sorted(config.CUSTOM))  # keys that decide which other keys there are
MADE_BY = ('version', 'revision')  # facts that say which code made a bag


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument('bag', type=Path, help='directory of a bag of simulate or run')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='new bag; must not exist; default: BAG_rerun'
    )
    parser.add_argument(
        '--duration', type=float, metavar='S', help='seconds of motion, default: as recorded'
    )
    add_trust_argument(parser)
    add_memory_argument(parser)


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    bag, memory = Path(os.path.realpath(arguments.bag)), arguments.max_memory
    out = arguments.out or bag.parent / f'{bag.name.removesuffix(".mcap")}_rerun'
    log, past, _ = recording.read(bag, memory=memory)
    if not past.facts:
        raise BagError(f'{bag} does not say what experiment made it')
    planned = loop_of(log.config).last_index or 0
    simulated = past.facts.get('source') == SIMULATION
    if simulated and arguments.duration is None and planned > max(LONGER * len(log.time), SHORT):
        raise BagError(
            f'{bag} holds {len(log.time)} states of {planned}; --duration says how much to run'
        )
    with tempfile.TemporaryDirectory() as directory:
        robot = str(log.config['robot_model'])
        files = custom_files(bag, past.sources, log.config, Path(directory), arguments.trust)
        values = log.config | files
        if not is_known(values):
            raise BagError(f'{bag} does not hold the robot {robot}')
        if values['trajectory.shape'] not in shapes(values['custom_trajectories']):
            raise BagError(f'{bag} does not hold the trajectory {values["trajectory.shape"]}')
        values = custom_defaults(values) | values  # a recorder started by hand has no gains
        if values['law'] not in available(values['custom_laws']):
            raise BagError(f'{bag} does not hold the law {values["law"]}')
        recorded = length(log) if not simulated or not values['duration'] else values['duration']
        values['duration'] = recorded if arguments.duration is None else arguments.duration
        for text in (*log.warnings, *doubts(values, past)):
            print(f'warning: {text}', file=sys.stderr)
        record = simulate.record if simulated else run.record
        code = 0
        try:
            code = record(*again(values, Path(directory)), out)
        except RunError as error:
            if not os.path.lexists(out):
                raise
            print(f'warning: {error}', file=sys.stderr)  # as in the bag, perhaps
    unlike = ''
    if not simulated and values['time_mode'] != 'lockstep':
        unlike = 'a run in real time'
    elif past.facts.get('start_stamp', '0') == '0':
        unlike = 'nodes that were started by hand'
    if unlike:
        print(f'{unlike}: bytes cannot be compared')
        return code
    until, part = None, ''
    if not simulated or values['duration'] != recorded:
        until = common_end(log, recording.read(out, memory=memory).log)
    if until is not None:
        part = f', as far as both bags go, t = {(until - log.start_stamp) / NANOSECONDS:g} s'
    count, difference = compare(bag, out, memory, until)
    print(f'differs: {difference}' if difference else f'identical: {count} messages{part}')
    if difference:
        print(f'         {size(log, recording.read(out, memory=memory).log)}')
    return code or int(bool(difference))


def common_end(log: RunLog, other: RunLog) -> int | None:
    """Log time [ns] up to which two runs in lockstep can be the same.

    A run that was stopped ends with messages of its stop, and without some that are sent for
    several samples together.

    Returns:
        The log time; None where both runs came to their end.
    """
    ends, last = [int(each.stamps[-1]) for each in (log, other)], 2 * SLOW
    planned = loop_of(log.config)
    early = planned.last_index and length(log) < (planned.last_index - last) * planned.period
    if ends[0] == ends[1] and not early:
        return None
    return min(ends) - last * planned.period_ns


def length(log: RunLog) -> float:
    """Length of the motion that a bag holds, in whole periods [s]."""
    period = log.config['period']
    return float(round(round(log.time[-1] / period) * period, 9))


def again(values: Mapping[str, Any], directory: Path) -> tuple[str, dict[str, Any]]:
    """What to run for a recorded configuration, whether or not its scenario is shipped.

    Args:
        values: The configuration.
        directory: Where to write a scenario that is not.

    Returns:
        Name or path of the scenario, and what changes in it.

    Raises:
        BagError: no file can hold the scenario.
        InputError: a custom module is not valid.
    """
    name = str(values['scenario'])
    modules = {key: values[key] for key in MODULES}
    if name in config.scenarios():
        return name, modules | changes(values, name, modules)
    code = {key: values[key] for key in config.CUSTOM}  # which no scenario can name
    robot = {'robot_model': values['robot_model']}
    found = {'base': BASE, **robot, **changes(values, BASE, modules)}
    path = directory / f'{name.replace("/", "_")}.yaml'  # a bag may hold any name
    try:
        path.write_text(plain_data.dump(found), encoding='utf-8')
    except (OSError, ValueError):  # too long, no characters
        raise BagError(f'no file can hold the scenario {printable(name)}') from None
    return str(path), code


def changes(
    values: Mapping[str, Any], scenario: str, modules: Mapping[str, Any]
) -> dict[str, Any]:
    """What of a recorded configuration a scenario with its robot and custom modules does not give.

    Raises:
        InputError: a custom module is not valid.
    """
    known = resolve(scenario, modules)
    left = {*modules, 'scenario', 'preset', *run.OWN}
    found = {
        key: value
        for key, value in values.items()
        if key in known and key not in left and known[key] != value
    }
    # A true_robot key that is not set would follow its robot key, changed or not.
    followers = {f'true_{key}' for key in found if key.startswith('robot.')} & values.keys()
    return found | {key: values[key] for key in followers}


def doubts(values: dict[str, Any], past: History) -> list[str]:
    """Why a rerun may not be the same."""
    lines = []
    now = software()
    others = [f'{key} {printable(past.facts[key])}' for key in MADE_BY if key in past.facts]
    ours = [f'{key} {now[key]}' for key in MADE_BY if key in now]
    if others != ours:
        lines.append(f'the bag was made by {", ".join(others)}; this is {", ".join(ours)}')
    lines += filter(None, [arithmetic.doubt(past.facts)])
    happened = recorded_controller.events(past, configure(values))
    if happened:
        lines.append(
            f'{len(happened)} changes of law, gains or fault during the run are not repeated'
        )
    motions = sum(MOTION in change.values for change in past.changes)
    if motions:
        lines.append(f'the motion was changed {motions} times during the run: not repeated')
    return lines


def size(log: RunLog, other: RunLog) -> str:
    """How large the difference of two runs is, as far as both go."""
    pairs = ((log.position, other.position), (log.command, other.command))
    counts = [min(map(len, pair)) for pair in pairs]
    apart = [abs(one[:n] - two[:n]) for (one, two), n in zip(pairs, counts, strict=True)]
    angle, torque = (np.max(each, initial=0.0, where=~np.isnan(each)) for each in apart)
    return f'joints by up to {angle:.2g} rad, commands by up to {torque:.2g} N m'


class _Difference(NamedTuple):
    """Where two streams part: time [ns], topic and what is there."""

    log_time: int
    topic: str
    what: str


def compare(
    bag: str | Path, other: str | Path, memory: int = MEMORY, until: int | None = None
) -> tuple[int, str]:
    """Compare two bags topic by topic, message by message.

    Args:
        bag: A bag.
        other: Another.
        memory: What may be held of them [bytes].
        until: Log time up to which they are compared [ns]; None: to their ends.

    Returns:
        How many messages the first has, and the first difference in words; empty without one.

    Raises:
        BagError: one cannot be read to its end, or takes too much.
    """
    first, second = _streams(bag, memory, until), _streams(other, memory, until)
    found = []
    for topic in sorted({*first, *second}):
        pair = first.get(topic, []), second.get(topic, [])
        for (time, data), (other_time, other_data) in zip(*pair, strict=False):
            if (time, data) != (other_time, other_data):
                what = 'another time' if data == other_data else 'other bytes'
                found.append(_Difference(time, topic, what))
                break
        else:
            longer = max(pair, key=len)
            shared = min(map(len, pair))
            if len(longer) > shared:
                what = f'{len(pair[0])} messages, now {len(pair[1])}'
                found.append(_Difference(longer[shared][0], topic, what))
    count = sum(map(len, first.values()))
    if not found:
        return count, ''
    earliest = min(found)
    start = min(stream[0][0] for stream in first.values() if stream)
    return count, (
        f'first on {earliest.topic} at t = {(earliest.log_time - start) / 1e9:.3f} s: '
        f'{earliest.what}; {len(found)} topics differ'
    )


def _streams(
    bag: str | Path, memory: int, until: int | None
) -> dict[str, list[tuple[int, bytes]]]:
    """Time and bytes of all messages by topic, up to a log time."""
    reader, allowance = BagReader(bag, memory), Allowance(Path(bag), 0, memory)
    streams: dict[str, list[tuple[int, bytes]]] = {}
    for message in reader.messages(reader.topics, reader.start):
        if until is not None and message.log_time > until:
            continue
        allowance.hold(OBJECT + len(message.data))
        streams.setdefault(message.topic, []).append((message.log_time, message.data))
    reader.close()
    return streams
