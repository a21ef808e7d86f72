"""Every law, every hazard, every duration: how far, how hard, how fast, told when and by what.

Usage: python benchmarks/hazards.py [--quick] [--laws NAMES] [--json FILE]

Simulations of config/studies/hazards.yaml without ROS. The whole matrix writes its section of
docs/safety.md, and docs/images/hazards.png.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from reliability import page

from parallel_robot.studies.sweep import study
from parallel_robot_control import assembly as control
from parallel_robot_control.configuration import resolve
from parallel_robot_control.controller_state import join
from parallel_robot_control.messages import limit_codes
from parallel_robot_control.safety import faults
from parallel_robot_control.safety.limiting import EFFORT, REFERENCE
from parallel_robot_model.compiler import Struct, vector
from parallel_robot_model.configuration.hazard_table import UNPUBLISHED
from parallel_robot_model.configuration.hazards import KINDS, Hazard, parse
from parallel_robot_sim.closed_loop import ClosedLoopRun, run
from parallel_robot_sim.configuration import Configuration, assemble_plant, configure
from parallel_robot_sim.plant import PlantState
from trajectory_gen.trajectory import Reference

ROOT = Path(__file__).parents[1]
PICTURE = ROOT / 'docs' / 'images' / 'hazards.png'
BEGIN = {'paper_circle': 4.0, 'serial_2r_circle': 4.0, 'axes_step': 1.0}  # s: on the way
DURATIONS = (0.05, 0.1, 0.2, 0.4, 1.0, 4.0, 10.0)  # s
QUICK = (0.4, 4.0)  # s
WAIT, WATCHED = 1.5, 4.0  # s, from the end of a hazard to the call of ~/clear_fault, and after it
BRIEF = 0.1  # s
MOVES = 1e-3  # of a robot that does not rest: m/s, or rad/s
ARMS = {  # other robots, and the hazards that are tried on them
    'serial_2r_circle': ('commands_lost', 'motors_off', 'states_lost', 'states_frozen'),
    'axes_step': ('commands_lost', 'motors_clipped', 'states_lost', 'controller_restarted'),
}
BOUNDS = {'torque': 1.5, 'distance': 1e-3, 'told': 0.2}  # ratio, m or rad, s


class Cell(NamedTuple):
    """What became of a run: a scenario, a law, a hazard."""

    scenario: str  # name of the scenario
    law: str  # name of the law
    hazard: str  # the hazard as it is typed
    # of the true end effector from its reference [m], of axes the joint error [rad]: largest
    # while the hazard lasted, after it, and after the call of ~/clear_fault
    distance: tuple[float, ...]
    commanded: tuple[float, ...]  # largest torque asked for, likewise [N m]
    applied: tuple[float, ...]  # largest torque of the motors, likewise [N m]
    speed: tuple[float, ...]  # largest joint speed, likewise [rad/s]
    told: float | None  # when somebody was told, after the begin [s]; None: never
    code: str  # by which code: of a fault, of what the status tells, or by the plant
    fault: str  # code of the fault at the call of ~/clear_fault; empty for none
    # way of the end effector from the fault until it rested, or until it was cleared [m]
    way: float
    share: float  # largest torque after the hazard, of what an approach from there takes
    driven_out: bool  # whether the robot left its workspace
    last: str  # code of the fault at the end; empty for none
    # whether it stays, rightly: the robot is where its cause, or another, lasts, or a person
    # must confirm its pose
    stays: bool

    @property
    def what(self) -> str:
        """Kind of the hazard."""
        return self.hazard.split()[0]

    @property
    def lasts(self) -> float:
        """How long it lasted [s]."""
        return parse([self.hazard])[0].lasts

    @property
    def further(self) -> float:
        """How much further from the reference the robot came on its way back than before it.

        While a fault lasts, the reference goes on and the robot does not.
        """
        before, after, cleared = self.distance
        if self.stays:
            return 0.0
        return cleared - max(before, after) if self.fault else max(after, cleared) - before


def simulated(scenario: str, law: str, hazard: Hazard) -> Cell:
    """Do a run with a hazard and with a way back, and measure it."""
    clear = hazard.end + WAIT
    texts = [str(hazard), str(Hazard('clear_fault', clear))]
    values = resolve(
        scenario,
        {'law': law, 'time_mode': 'lockstep', 'duration': clear + WATCHED, 'hazards': texts},
    )
    configuration = configure(values)
    period = configuration.loop.period
    begin, end, cleared = (round(t / period) for t in (hazard.at, hazard.end, clear))
    count = cleared + round(WATCHED / period) + 1
    reference = configuration.trajectory.sample(np.arange(count) * period)
    controller = control.assemble(configuration)
    made = run(controller, assemble_plant(configuration), reference, period)
    steps = made.steps
    windows = [slice(begin, end), slice(end, cleared), slice(cleared, None)]
    distance, ways = _distances(configuration, made, reference)
    known = faults.of(configuration.robot.module)

    def code(number: int) -> str:
        return known[int(number)].key if number else ''

    def largest(rows: np.ndarray) -> tuple[float, ...]:
        return tuple(_largest(rows[:steps], window) for window in windows)

    # 1. Who was told what, and when.
    shown = (made.fault != faults.NONE) | (made.active_limits & (EFFORT | REFERENCE) > 0)
    when = np.flatnonzero(shown[begin:steps])
    told = float(when[0] * period) if when.size else None
    first = begin + int(when[0]) if when.size else 0
    name = (
        (code(made.fault[first]) or limit_codes(int(made.active_limits[first])))
        if when.size
        else ''
    )
    timeout = configuration.plant.command_timeout
    silent = (
        hazard.what in {*UNPUBLISHED, 'commands_lost', 'velocity_nan'} and hazard.lasts >= timeout
    )
    if silent and (told is None or told > timeout):
        told, name = timeout, 'command time-out of the motors'
    # 2. The way after the fault.
    faulted = np.flatnonzero(made.fault[begin:cleared])
    way = float(ways[begin + faulted[0] : cleared].sum()) if faulted.size else 0.0
    # 3. What an approach takes from where the hazard, or the fault, is over.
    latched = cleared < steps and made.fault[cleared - 1] != faults.NONE
    back = cleared if latched else end
    of_law = np.where(made.fault[end:steps, np.newaxis], 0.0, made.command[end:steps])
    asked = _largest(of_law, slice(None))
    share = asked / _approach(configuration, made, back) if back + 1 < steps else np.nan
    return Cell(
        scenario,
        law,
        str(hazard),
        largest(distance),
        largest(made.command),
        largest(made.effort),
        largest(np.diff(made.joints[:steps], axis=0) / period),
        told,
        name,
        code(made.fault[cleared - 1]) if cleared <= steps else code(made.fault[steps - 1]),
        way,
        float(share),
        steps < count,
        code(made.fault[steps - 1]),
        bool(controller.setup.memory.state.lost or (made.cause and made.fault[steps - 1])),
    )


def _largest(rows: np.ndarray, window: slice) -> float:
    """Largest magnitude in some rows; 0 where there is none."""
    part = np.abs(rows[window])
    return float(np.nanmax(part)) if part.size and np.isfinite(part).any() else 0.0


def _distances(
    configuration: Configuration, made: ClosedLoopRun, reference: Reference
) -> tuple[np.ndarray, np.ndarray]:
    """Distance from the reference, and way from one state to the next, each shape (N,)."""
    steps = made.steps
    if configuration.robot.planar:
        place, wanted = made.pose[:steps, :2], reference.pose[:steps, :2]
    else:
        place, wanted = made.joints[:steps], reference.position[:steps]
    moved = np.linalg.norm(np.diff(place, axis=0, prepend=place[:1]), axis=1)
    moved[moved < MOVES * configuration.loop.period] = 0.0
    return np.linalg.norm(wanted - place, axis=1), moved


def _approach(configuration: Configuration, made: ClosedLoopRun, begin: int) -> float:
    """Largest torque of an approach with an empty memory from where the robot is [N m]."""
    loop, robot = configuration.loop, configuration.true_robot
    undisturbed = configuration.with_parts(loop=loop._replace(hazards=()))
    plant = assemble_plant(undisturbed)
    at = [robot.module.start(robot.parameters, made.pose[begin + k]) for k in (-1, 0, 1)]
    rate = (np.asarray(at[2]) - np.asarray(at[0])) / (2.0 * loop.period)
    torque = made.effort[begin]
    state = PlantState(
        vector(np.asarray(at[1])),
        vector(rate),
        vector(torque),
        begin * loop.period,
    )
    controller = control.assemble(configuration)
    joined = Struct(controller.state._replace(pose=vector(made.pose[begin])))
    join(joined, torque)
    controller = controller._replace(state=joined.value)
    samples = begin + np.arange(round(WATCHED / loop.period) + 1)
    reference = configuration.trajectory.sample(samples * loop.period)
    found = run(controller, plant._replace(state=state), reference, loop.period)
    return _largest(found.command[: found.steps], slice(None))


def cells(law: str, scenario: str, hazards: Sequence[Hazard]) -> list[Cell]:
    """All runs of a law in a scenario."""
    return [simulated(scenario, law, hazard) for hazard in hazards]


def matrix(laws: Sequence[str], durations: Sequence[float], kinds: Sequence[Hazard]) -> list[Cell]:
    """All runs of the study, and the fewer ones of the other robots."""
    tasks = [
        (law, scenario, [each._replace(at=BEGIN[scenario], lasts=lasts) for each in some])
        for scenario, law in itertools.product(BEGIN, laws)
        for some in [[each for each in kinds if each.what in ARMS.get(scenario, KINDS)]]
        for lasts in durations
    ]
    found: list[Cell] = []
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        waiting = [pool.submit(cells, *task) for task in tasks]
        for done, each in enumerate(waiting, start=1):
            found += each.result()
            print(f'\r{done} of {len(tasks)}', end='', file=sys.stderr)
    print(file=sys.stderr)
    return found


def failures(cell: Cell) -> list[str]:
    """What must not happen and happened."""
    found = []
    if cell.driven_out:
        return ['left its workspace']
    if cell.share > BOUNDS['torque']:
        found.append(f'torque {cell.share:.1f} times that of an approach')
    if cell.further > BOUNDS['distance']:
        found.append(f'{1e3 * cell.further:.1f} mm further than while it lasted')
    if cell.last and not cell.stays:
        found.append(f'{cell.last} at the end')
    if cell.lasts >= BOUNDS['told'] and (cell.told is None or cell.told > BOUNDS['told']):
        found.append('never told' if cell.told is None else f'told after {cell.told:.2f} s')
    return found


def table(found: Sequence[Cell]) -> str:
    """One row a kind: the worst of all laws, over all durations."""
    lines = [
        '| hazard | farthest [mm] | torque after it | told after [s], by |'
        ' way after the fault [mm] |',
        '|---|---|---|---|---|',
    ]
    for what, group in itertools.groupby(sorted(found, key=_by_kind), key=lambda cell: cell.what):
        some = [*group]
        told = {f'{cell.told:.2f}' for cell in some if cell.told is not None}
        codes = sorted({cell.code for cell in some if cell.code})
        stopped = sum(cell.stays for cell in some)
        stays = f'; a person must help it: {stopped} of {len(some)}' if stopped else ''
        times = ' to '.join(sorted({min(told), max(told)})) if told else ''
        cells = [
            f'`{what}`',
            f'{1e3 * max(max(cell.distance) for cell in some):.1f}',
            f'{np.nanmax([cell.share for cell in some]):.2f}',
            ' '.join(filter(None, [times, ', '.join(f'`{code}`' for code in codes)])),
            f'{1e3 * max(cell.way for cell in some):.0f}{stays}',
        ]
        lines.append('| ' + ' | '.join(cells) + ' |')
    return '\n'.join(lines)


def _by_kind(cell: Cell) -> int:
    return [*KINDS].index(cell.what)


def section(found: Sequence[Cell], laws: Sequence[str]) -> str:
    """The section of the page."""
    circle = [cell for cell in found if cell.scenario == 'paper_circle']
    wrong = [(cell, text) for cell in sorted(circle, key=_by_kind) for text in failures(cell)]
    lines = [
        f'The worst of {len(circle)} simulations by `benchmarks/hazards.py`: {len(laws)} laws,'
        f' each hazard for {", ".join(f"{each:g}" for each in DURATIONS)} s on the circle of the'
        ' paper, with faults cleared 1.5 s later. Torques are shares of what an approach from the'
        ' same place and speed takes. Runs that stay in their fault are not judged by distance.',
        '',
        '![How far the robot goes and what the way back takes, by hazard and duration]'
        '(images/hazards.png)',
        '',
        table(circle),
        '',
    ]
    lines += [*others(found), '']
    if not wrong:
        return '\n'.join([*lines, 'On the circle nothing that must not happen happened.'])
    lines.append(f'On the circle, what must not happen happened in {len(wrong)} of {len(circle)}:')
    lines.append('')
    for what, group in itertools.groupby(wrong, key=lambda pair: pair[0].what):
        some, texts = zip(*group, strict=True)
        names = ', '.join(f'`{law}`' for law in dict.fromkeys(cell.law for cell in some))
        told = '; '.join(page.joined(texts, page.NUMBER))
        lines.append(f'- `{what}`, {len(some)} runs of {names}: {told}')
    return '\n'.join(lines)


def others(found: Sequence[Cell]) -> list[str]:
    """A table of the other robots: how far, and how hard, one row a hazard."""
    arm, axes = (
        max(c.speed[1] for c in found if c.scenario == scenario and c.lasts <= BRIEF)
        for scenario in ARMS
    )
    lines = [
        f'The arm falls while nothing holds it, and the axes go on, with up to {arm:.1f} and'
        f' {axes:.1f} rad/s after {BRIEF:g} s: so they go further than while the hazard lasted. An'
        ' arm that has fallen hangs stretched, in its singularity, until a person moves it.',
        '',
        '| scenario | hazard | further than while it lasts, at most | torque after it |'
        ' faults at the end |',
        '|---|---|---|---|---|',
    ]
    for (scenario, what), group in itertools.groupby(
        sorted((cell for cell in found if cell.scenario in ARMS), key=_by_robot),
        key=lambda cell: (cell.scenario, cell.what),
    ):
        some = [*group]
        unit = 'mm' if scenario == 'serial_2r_circle' else 'mrad'
        worst = max(some, key=lambda cell: cell.further)
        last = sorted({cell.last for cell in some if cell.last})
        count = sum(bool(cell.last) for cell in some)
        cells = [
            f'`{scenario}`',
            f'`{what}`',
            f'{1e3 * worst.further:.0f} {unit}, after {worst.lasts:g} s',
            f'{np.nanmax([cell.share for cell in some]):.2f}',
            f'{count} of {len(some)}: {", ".join(last)}' if last else 'none',
        ]
        lines.append('| ' + ' | '.join(cells) + ' |')
    return lines


def _by_robot(cell: Cell) -> tuple[str, int]:
    return cell.scenario, _by_kind(cell)


def draw(found: Sequence[Cell]) -> None:
    """The picture: the worst law of each hazard and duration."""
    from matplotlib import pyplot
    from matplotlib.colors import LogNorm

    circle = [cell for cell in found if cell.scenario == 'paper_circle']
    kinds = sorted({cell.what for cell in circle}, key=[*KINDS].index)
    durations = sorted({cell.lasts for cell in circle})
    panels: list[tuple[str, str, tuple[float, float], Callable[[Cell], float]]] = [
        ('while it lasts [mm]', '%.1f', (1.0, 300.0), lambda cell: 1e3 * cell.distance[0]),
        ('after it [mm]', '%.1f', (1.0, 300.0), lambda cell: 1e3 * max(cell.distance[1:])),
        ('torque after it, of an approach', '%.2f', (0.9, 4.0), lambda cell: cell.share),
        (
            'told after [s]',
            '%.2f',
            (5e-3, 1.0),
            lambda cell: np.nan if cell.told is None else cell.told,
        ),
    ]
    figure, axes = pyplot.subplots(1, len(panels), figsize=(16, 7), sharey=True, layout='tight')
    for axis, (title, form, limits, number) in zip(axes, panels, strict=True):
        numbers = np.array([
            [
                max(number(c) for c in circle if (c.what, c.lasts) == (kind, lasts))
                for lasts in durations
            ]
            for kind in kinds
        ])  # fmt: skip
        shade = LogNorm(*limits)
        axis.imshow(np.maximum(numbers, limits[0]), norm=shade, aspect='auto', cmap='YlOrRd')
        for (k, j), value in np.ndenumerate(numbers):
            axis.text(j, k, form % value if value == value else '-', ha='center', va='center')
        axis.set_title(title)
        axis.set_xticks(range(len(durations)), [f'{each:g}' for each in durations])
        axis.set_xlabel('duration [s]')
        axis.set_yticks(range(len(kinds)), kinds)
    figure.savefig(PICTURE, dpi=80)


def main() -> int:
    """Run the matrix; 1 when something happened that must not happen."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').splitlines()[0])
    parser.add_argument('--quick', action='store_true', help='two durations')
    parser.add_argument('--laws', nargs='+', default=[], help='laws, default: those of the study')
    parser.add_argument('--only', nargs='+', default=[], help='kinds of hazards')
    parser.add_argument('--json', type=Path, help='file of the results')
    arguments = parser.parse_args()
    file = study.file_of('hazards')
    known = study.parse(study.read(file), str(file))
    (uncertain,) = known.uncertainties
    kinds = [parse(texts)[0] for texts in uncertain.given['values']]
    kinds = [each for each in kinds if not arguments.only or each.what in arguments.only]
    laws = arguments.laws or [variant.name for variant in known.laws]
    found = matrix(laws, QUICK if arguments.quick else DURATIONS, kinds)
    if arguments.json:
        arguments.json.write_text(json.dumps([cell._asdict() for cell in found], indent=1))
    for cell in found:
        for text in failures(cell):
            print(f'{cell.scenario} {cell.law} {cell.hazard}: {text}')
    if not (arguments.quick or arguments.laws or arguments.only):
        page.write('hazards', section(found, laws))
        draw(found)
    else:
        print(table([cell for cell in found if cell.scenario == 'paper_circle']))
    return int(any(map(failures, found)))


if __name__ == '__main__':
    sys.exit(main())
