"""The command ``simulate``: the closed loop without ROS, written as a bag."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot_analysis.bags import bag_writer, simulation_bag
from parallel_robot_analysis.bags.history import remark_lines
from parallel_robot_control.faults import FAULT_TEXT
from parallel_robot_control.messages import limits_text
from parallel_robot_interface import config
from parallel_robot_interface.errors import RunError
from parallel_robot_sim.simulation import Simulation, simulate

DURATION = 12.0  # s, two turns of the paper's circle


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    add_scenario_arguments(parser)
    parser.add_argument('--law', help='control law, default: that of the configuration')
    parser.add_argument(
        '--out', type=Path, required=True, metavar='DIR', help='bag; must not exist'
    )


def add_scenario_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of every command that makes a run."""
    parser.add_argument('scenario', help='name of a scenario in config/scenarios')
    parser.add_argument(
        '--duration', type=float, metavar='S', help=f'seconds of motion, default {DURATION:g}'
    )
    add_set_argument(parser)


def add_set_argument(parser: argparse.ArgumentParser) -> None:
    """Declare ``--set``."""
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        dest='assignments',
        metavar='KEY=VALUE',
        help='change a key of the configuration, e.g. s_fotsmc.G=12; may be repeated',
    )


def overrides(arguments: argparse.Namespace) -> dict[str, Any]:
    """What the arguments change in the configuration."""
    changed = config.parse_overrides(arguments.assignments)
    if getattr(arguments, 'law', None) is not None:
        changed['law'] = arguments.law
    if arguments.duration is not None:
        changed['duration'] = arguments.duration
    return {'duration': DURATION, **changed}


def remarks(simulation: Simulation) -> list[str]:
    """What a user should know of a simulation: doubts of the theory, limits, a fault."""
    acted = int(np.bitwise_or.reduce(simulation.run.acted))
    fault = None
    if simulation.fault is not None:
        time, code = simulation.fault
        fault = time, FAULT_TEXT[code]
    limits = limits_text(acted) if acted else ''
    return [*simulation.law.warnings, *remark_lines(limits, fault)]


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    return record(arguments.scenario, overrides(arguments), arguments.out)


def record(scenario: str, changed: dict[str, Any], out: Path) -> int:
    """Simulate a scenario with changes of its configuration into a bag; returns an exit code.

    Raises:
        InputError: something is wrong with the configuration or the place of the bag.
        RunError: the robot left its workspace, or the disk is full.
    """
    bag_writer.check(out)
    changed = changed | {'time_mode': 'lockstep'}  # whose stamps it has
    values = config.resolve(scenario, changed)
    simulation = simulate(values)
    for text in remarks(simulation):
        print(f'warning: {text}', file=sys.stderr)
    try:
        simulation_bag.write(out, values, simulation)
    except OSError as error:
        raise RunError(f'cannot write {out}: {error.strerror}') from None
    rate = simulation.loop.duration / simulation.loop_time
    print(
        f'{simulation.loop.duration:g} s of motion in {simulation.loop_time:.3f} s '
        f'({rate:.0f} times real time)\nbag     {out}'
    )
    return 0
