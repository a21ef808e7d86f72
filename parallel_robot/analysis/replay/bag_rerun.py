"""The experiment of a bag once more, from the bag alone: what to run, and what came of it."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from parallel_robot.analysis.replay import recorded_controller
from parallel_robot.bags import bag_reader, experiment, output
from parallel_robot.bags.experiment import OF_RUN, SIMULATION, software
from parallel_robot.bags.history import History
from parallel_robot.bags.limits import MEMORY
from parallel_robot.bags.run import bag_difference, run_windows
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.bags.trust import check_held_code, custom_files
from parallel_robot.bags.writing import simulation_bag
from parallel_robot_control.configuration import available, configure, load, resolve
from parallel_robot_model.common.errors import BagError, InputError, printable
from parallel_robot_model.common.options import optional_path, path
from parallel_robot_model.common.tables import Part, ShownResult
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.config import Place
from parallel_robot_model.configuration.loop import loop_of
from parallel_robot_model.configuration.yaml_file import MOTION
from parallel_robot_model.messages.topics import SLOW
from parallel_robot_sim import configuration as simulated_loop
from parallel_robot_sim.simulation import RunSummary
from parallel_robot_sim.simulation import parts as simulated_parts

LONGER, SHORT = 100, 20_000  # a rerun is at most so many times as long, or so many states
BASE = 'paper_circle'  # of a scenario that is not shipped
ROBOT = ('robot_model', 'robot_description', 'robot_compiled')
MODULES = (*ROBOT, *sorted(config.CUSTOM))  # keys that decide which other keys there are
MADE_BY = ('version', 'revision')  # facts that say which code made a bag
NO_EXPERIMENT = (
    '{} does not say what experiment made it, so there is none to repeat; '
    'parallel_robot replay --law computes the torques of a law on its motion'
)


@dataclass(frozen=True, repr=False)
class Rerun(ShownResult):
    """An experiment that was run again."""

    bag: Path  # the new bag
    messages: int = 0  # number of messages that were compared
    difference: str = ''  # the first difference in words; empty without one
    reach: str = ''  # how far both bags go, in words; empty where both came to their end
    size: str = ''  # how large the difference is, in words
    unlike: str = ''  # why they cannot be compared, in words; empty where they were
    warnings: tuple[str, ...] = ()  # why it may not be the same, one line each

    @property
    def identical(self) -> bool:
        """Whether both bags have the same messages."""
        return not (self.unlike or self.difference)

    def parts(self) -> list[Part]:
        """What came of it."""
        if self.unlike:
            return [f'{self.unlike}: bytes cannot be compared']
        if self.difference:
            return [f'differs: {self.difference}', f'         {self.size}']
        return [f'identical: {self.messages} messages{self.reach}']

    def as_data(self) -> dict[str, Any]:
        """The same as plain data; what is not compared is null."""
        return {
            'compared': not self.unlike,
            'identical': None if self.unlike else self.identical,
            'messages': None if self.unlike else self.messages,
            'difference': self.difference or None,
            'size': self.size or None,
            'reach': self.reach.removeprefix(', ') or None,
            'unlike': self.unlike or None,
        }


@dataclass(frozen=True)
class Experiment:
    """The experiment of a bag."""

    bag: Path
    log: RunLog  # its run, with times of a few states and the last one alone
    past: History  # what happened beside the motion
    values: Mapping[str, Any]  # the configuration that is run
    scenario: str  # name or path of the scenario that is run
    changes: dict[str, Any]  # what changes in it
    warnings: tuple[str, ...]  # what to know of the bag, and why a rerun may not be the same

    @property
    def simulated(self) -> bool:
        """Whether the bag is of a simulation, not of nodes."""
        return simulated(self.past)

    def compare(self, out: Path, memory: int = MEMORY) -> Rerun:
        """Compare with the bag that came of it.

        Args:
            out: The bag.
            memory: What may be held of each [bytes].

        Raises:
            BagError: one cannot be read to its end, or takes too much.
        """
        log, until, reach = self.log, None, ''
        if not self.simulated and self.values['time_mode'] != 'lockstep':
            return Rerun(out, unlike='a run in real time', warnings=self.warnings)
        if self.past.facts.get('start_stamp', '0') == '0':
            return Rerun(out, unlike='nodes that were started by hand', warnings=self.warnings)
        if not self.simulated or self.values['duration'] != planned_length(log, self.past):
            until = _common_end(log, run_windows.run_end(out, memory)[0])
        if until is not None:
            reach = f', as far as both bags go, t = {(until - log.start_stamp) / NANOSECONDS:g} s'
        count, difference = bag_difference.compare(self.bag, out, memory, until)
        size = ''
        if difference:
            size = bag_difference.size(self.bag, out, memory)
        return Rerun(out, count, difference, reach, size, warnings=self.warnings)


def default_place(bag: Path) -> Path:
    """Where the new bag is written unless told."""
    bag = Path(os.path.realpath(bag))
    return bag.parent / f'{bag.name.removesuffix(".mcap")}_rerun'


@contextmanager
def prepared(
    bag: Path,
    duration: float | None = None,
    trust: bool = False,
    memory: int = MEMORY,
) -> Iterator[Experiment]:
    """Read a bag of which the experiment is run again; its code stands in files meanwhile.

    Args:
        bag: Directory of the bag, or its MCAP file.
        duration: Length of the motion [s]; None: as recorded.
        trust: Whether the code that it holds may run.
        memory: What may be held of it [bytes].

    Raises:
        BagError: it is no bag of a run, does not say what experiment made it, or needs code that
            it does not hold or that may not run.
        InputError: a value is wrong.
    """
    bag = Path(os.path.realpath(bag))
    try:
        log, past, states = run_windows.run_end(bag, memory)
    except BagError:
        if not bag_reader.read(bag, (), lambda *_: None, memory).metadata:
            raise BagError(NO_EXPERIMENT.format(bag)) from None
        raise
    if not past.facts:
        raise BagError(NO_EXPERIMENT.format(bag))
    planned = loop_of(log.config).last_index or 0
    if simulated(past) and duration is None and planned > max(LONGER * states, SHORT):
        raise BagError(
            f'{bag} holds {states} states of {planned}; --duration says how much to run'
        )
    with tempfile.TemporaryDirectory() as directory:
        files = custom_files(bag, past.sources, log.config, Path(directory), trust)
        values = log.config | files
        check_held_code(bag, values)
        own = load(values).defaults(values)
        values = own | values  # a recorder started by hand has no gains
        if values['law'] not in available(values['custom_laws']):
            raise BagError(f'{bag} does not hold the law {values["law"]}')
        values['duration'] = planned_length(log, past) if duration is None else duration
        warnings = (*log.warnings, *doubts(values, past))
        yield Experiment(bag, log, past, values, *again(values, Path(directory)), warnings)


def simulated(past: History) -> bool:
    """Whether a bag is of a simulation."""
    return past.facts.get('source') == SIMULATION


def planned_length(log: RunLog, past: History) -> float:
    """Length of the motion of a bag: of a simulation that which was asked for [s]."""
    asked = float(log.config['duration'])
    return asked if asked and simulated(past) else length(log)


def _common_end(log: RunLog, other: RunLog) -> int | None:
    """Log time [ns] up to which two runs in lockstep can be the same.

    A run that was stopped ends with messages of its stop, and without some that are sent for
    several samples together.
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
    robot = {key: values[key] for key in ROBOT}
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
    left = {*modules, 'scenario', 'preset', *OF_RUN}
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
    lines += filter(None, [experiment.arithmetic_doubt(past.facts)])
    if values['robot_compiled']:
        from parallel_robot_model.robots.described.robot import compiler_warning  # it takes long

        told = compiler_warning(values['robot_description'], values['robot_compiled'])
        lines += filter(None, [told])
    happened = recorded_controller.events(past, configure(values))
    if happened:
        lines.append(
            f'{len(happened)} changes of law, gains or fault during the run are not repeated'
        )
    motions = sum(MOTION in change.values for change in past.changes)
    if motions:
        lines.append(f'the motion was changed {motions} times during the run: not repeated')
    return lines


def rerun(
    bag: Place,
    out: Place | None = None,
    *,
    duration: float | None = None,
    trust: bool = False,
    memory: int = MEMORY,
) -> Rerun:
    """Run the experiment of a simulated bag once more, as ``parallel_robot rerun`` does.

    >>> import parallel_robot as pr
    >>> pr.save(pr.simulate('paper_circle', law='smc', duration=0.1), 'runs/first')
    >>> pr.rerun('runs/first', 'runs/second')
    identical: 382 messages

    Args:
        bag: Directory of the bag, or its MCAP file.
        out: Directory of the new bag, which must not exist; default: beside the bag, its name
            ends with ``_rerun``.
        duration: Length of the motion [s]; default: as recorded.
        trust: Whether the code of laws, robot and trajectory that the bag holds may run: with all
            your rights.
        memory: What may be held of each bag [bytes].

    Returns:
        Whether both bags are ``identical``, and the first ``difference``.

    Raises:
        BagError: not a bag of a run, it needs code that it does not hold or that may not run, or
            the new one cannot be written.
        InputError: the bag is of nodes, or a value is wrong.
        RunError: the disk is full.
    """
    place = path('a bag', bag)
    target = optional_path('out', out) or default_place(place)
    with prepared(place, duration, trust, memory) as experiment:
        if not experiment.simulated:
            raise InputError(f'{bag} is of nodes, which `parallel_robot rerun` starts again')
        output.check_directory(target)
        values = resolve(experiment.scenario, experiment.changes | {'time_mode': 'lockstep'})
        summary = RunSummary()
        simulation_bag.save(
            target, values, summary.taken(simulated_parts(simulated_loop.configure(values)))
        )
    found = experiment.compare(target, memory)
    failure = (summary.failure,) if summary.failure else ()
    return replace(found, warnings=(*found.warnings, *failure))
