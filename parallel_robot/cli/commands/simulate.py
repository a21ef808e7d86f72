"""The command ``simulate``: the closed loop without ROS, written as a bag."""

from __future__ import annotations

import argparse
import functools
import shlex
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from parallel_robot.analysis import metrics, readable_metrics
from parallel_robot.analysis.metrics import Metrics
from parallel_robot.analysis.run_results import SimulatedFigures
from parallel_robot.bags import output
from parallel_robot.bags.history import remark_lines
from parallel_robot.bags.writing import simulation_bag
from parallel_robot.cli import command_line
from parallel_robot.cli.shared import (
    TEXT,
    add_format_argument,
    add_set_argument,
    given,
    show,
    tell,
    warn,
)
from parallel_robot_control import law_loader
from parallel_robot_control.configuration import resolve
from parallel_robot_control.estimation.lock_in import delay_text
from parallel_robot_control.messages import limits_text
from parallel_robot_model.common.errors import InputError, ParallelRobotError, RunError, first_line
from parallel_robot_model.common.options import number
from parallel_robot_model.common.tables import Part
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.configuration.hazards import parse
from parallel_robot_model.configuration.loop import DURATION, length
from parallel_robot_model.configuration.plain_data import LocatedDict, merged
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.motions import of_simulation
from parallel_robot_sim.scenario_run import fitted
from parallel_robot_sim.simulation import (
    RunSummary,
    Simulation,
    parts,
    plant_warnings,
    saturation_of,
)
from trajectory_gen.configuration import with_duration
from trajectory_gen.preflight import motion_warnings


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_run_arguments(parser)
    parser.add_argument(
        '--row',
        type=int,
        metavar='N',
        help='one run of a study: SCENARIO is the directory of its sweep, its file or its name',
    )
    add_format_argument(parser)


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of a command that writes a run as a bag."""
    add_scenario_arguments(parser)
    add_law_argument(parser)
    parser.add_argument(
        '--out', type=Path, required=True, metavar='DIR', help='bag; must not exist'
    )
    parser.add_argument(
        '--fit-speed',
        type=number,
        metavar='SHARE',
        help='run the motion at this share, e.g. 0.5, of the fastest speed that limits of joint '
        'speed and torque allow',
    )


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of every command that makes a run."""
    add_scenario_argument(parser)
    parser.add_argument(
        '--duration',
        type=float,
        metavar='S',
        help='seconds of motion, default: that of the scenario, else the length of its motion, '
        f'else {DURATION:g}',
    )
    parser.add_argument(
        '--hold',
        type=number,
        metavar='S',
        help='seconds for which the robot is held where its motion ended, default: none',
    )
    add_set_argument(parser)


def add_law_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the law."""
    parser.add_argument(
        '--law',
        metavar='LAW|FILE',
        help='control law, or the file of one: .py, .so, .fmu; default: that of the configuration',
    )


def add_scenario_argument(parser: argparse.ArgumentParser) -> None:
    """Declare the scenario."""
    parser.add_argument(
        'scenario', help='name of a scenario in config/scenarios, or the path of a YAML file'
    )


def overrides(arguments: argparse.Namespace) -> LocatedDict:
    """What the arguments change in the configuration.

    Raises:
        InputError: no such scenario, or an argument is wrong.
    """
    assigned, law = (
        yaml_file.parse_assignments(arguments.assignments),
        getattr(arguments, 'law', None),
    )
    of_law = {} if law is None else law_loader.chosen(law, assigned)
    options = {'law': of_law.get('law'), 'duration': arguments.duration}
    options = {key: value for key, value in options.items() if value is not None}
    for key, value in assigned.items():
        if key in options and options[key] != value:
            raise InputError(f'--{key} {options[key]} and --set {key}={value} differ; give one')
    changed = merged([given(arguments), options, of_law])
    changed |= law_loader.files_of(getattr(arguments, 'laws', None) or (), changed)
    share, scenario = getattr(arguments, 'fit_speed', None), arguments.scenario
    if share is not None:
        changed, told = fitted(scenario, changed, share)
        print(told, file=sys.stderr)
    return with_duration(scenario, changed, getattr(arguments, 'hold', None))


def remarks(simulation: Simulation, summary: RunSummary) -> list[str]:
    """Remarks on a simulation: gains that the theory doubts, hazards, limits, faults.

    Args:
        simulation: The simulation, or any part of it.
        summary: What is told of it as a whole.
    """
    limits, loop = (
        limits_text(summary.active_limits) if summary.active_limits else '',
        simulation.experiment.loop,
    )
    acting = [each.told for each in parse(loop.hazards) if each.at <= loop.duration]
    return [
        *simulation.experiment.control.law.warnings,
        *([f'hazards: {", ".join(acting)}'] if acting else []),
        *saturation_of(simulation.configuration.values, summary.saturated, summary.steps),
        *remark_lines(limits, summary.faults, summary.refused),
    ]


def evaluate(part: Simulation, failure: str, figures: Callable[[], Metrics]) -> list[str]:
    """The metrics of a simulation, the same as those of its bag, in lines.

    Args:
        part: The simulation, or any part of it.
        failure: Why there are no figures; empty if there are.
        figures: Returns the metrics.
    """
    loop = part.experiment.loop
    if failure:
        return [f'{loop.scenario}, {failure}: no figures']
    found = figures()
    head = readable_metrics.head(loop.scenario, loop.law, found, length(part.configuration.values))
    return [head, *readable_metrics.brief(found, {})]


def _tables(
    part: Simulation, failure: str, figures: Callable[[], Metrics]
) -> tuple[list[Part], dict[str, Any]]:
    """The metrics as a table, and as plain data; arguments as of :func:`evaluate`."""
    loop, lines = part.experiment.loop, evaluate(part, failure, figures)
    data: dict[str, Any] = {'scenario': loop.scenario, 'law': loop.law}
    if failure:
        return [*lines], data | {'failure': failure}
    found = figures()
    data |= {'duration_s': found.duration_s}
    return [*lines[0].split('\n'), readable_metrics.whole(found)], data | readable_metrics.as_data(
        found
    )


def result(bag: Path, evaluate: Callable[[], list[str]], shown: bool = False) -> str:
    """Last lines of a command that made a bag: metrics, its directory, the next command.

    Args:
        bag: Directory of the bag.
        evaluate: Returns the lines of the metrics. Whatever it raises, the bag is good.
        shown: Whether the page that has shown the run has ended: another one plays the bag.
    """
    try:
        lines = evaluate()
    except ParallelRobotError as error:
        lines = [f'no metrics: {error}']
    except Exception as error:
        lines = [f'no metrics: {first_line(error)}']
    words = [['analyze', str(bag)], *([['live', '--bag', str(bag)]] if shown else [])]
    following = [shlex.join([*command_line.invocation_words(), *each]) for each in words]
    return '\n'.join([*lines, f'bag     {bag}', *(f'next    {each}' for each in following)])


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if arguments.row is None:
        return record(arguments.scenario, overrides(arguments), arguments.out, arguments.format)
    from parallel_robot.studies.sweep.store import row_of  # needed for rows alone

    for option in ('law', 'duration', 'hold', 'fit_speed'):
        if getattr(arguments, option) is not None:
            name = option.replace('_', '-')
            raise InputError(f'--{name} and --row exclude each other: the study has it')
    row, doubts = row_of(arguments.scenario, arguments.row, given(arguments))
    warn(doubts)
    return record(row.scenario, dict(row.overrides), arguments.out, arguments.format)


def record(scenario: str, changed: dict[str, Any], out: Path, form: str | None = None) -> int:
    """Simulate a scenario with changes of its configuration into a bag; returns an exit code.

    Args:
        scenario: Name or file of the scenario.
        changed: Keys of its configuration and their values.
        out: Directory of the bag.
        form: Format of the results, see :mod:`shared`.

    Raises:
        InputError: something is wrong with the configuration or the place of the bag.
        RunError: the run failed, and the bag has it up to there; or the disk is full.
    """
    output.check_directory(out)
    changed = changed | {'time_mode': 'lockstep'}  # whose stamps it has
    values = resolve(scenario, changed)
    configuration = configure(values)
    warn(motion_warnings(configuration.trajectory))
    run = _Run(parts(configuration))
    simulation_bag.save(out, values, run)
    part, summary = run.last, run.summary
    warn((*plant_warnings(configuration), *remarks(part, summary)))
    rate = summary.duration / summary.loop_time
    units = configuration.trajectory.robot.joint_units
    delay = delay_text(part.experiment.control.setup, summary.phase, units)
    if delay:
        tell(form, f'delay of the states: {delay}')
    tell(
        form,
        f'{summary.duration:g} s of motion in {summary.loop_time:.3f} s '
        f'({rate:.0f} times real time)',
    )
    if form in (None, TEXT):
        print(result(out, lambda: evaluate(part, summary.failure, run.figures)))
    else:
        show(form, *_tables(part, summary.failure, run.figures))
    if summary.failure:
        raise RunError(summary.failure)
    return 0


class _Run:
    """The parts of a run as they come; what is told of them is kept."""

    def __init__(self, parts: Iterator[Simulation]) -> None:
        self._parts = parts
        self._running: SimulatedFigures | None = None
        self.last: Simulation  # the last part
        self.summary = RunSummary()  # what is told of all of them
        # returns the metrics of the run, or tells why there are none
        self.figures = functools.cache(
            lambda: (
                self._running.result()
                if self._running
                else metrics.figures(of_simulation(self.last))
            )
        )

    def __iter__(self) -> Iterator[Simulation]:
        for part in self._parts:
            self.last = part
            self.summary.add(part)
            if self._running is None and part.run.steps <= (part.experiment.loop.last_index or 0):
                self._running = SimulatedFigures()
            if self._running is not None:
                self._running.add(part)
            yield part
