"""Tables of the documentation from simulations, without ROS.

Usage: python benchmarks/doc_tables.py noise [seconds]
       python benchmarks/doc_tables.py delays [robots] [KEY=VALUE ...]
       python benchmarks/doc_tables.py repetition [robots] [KEY=VALUE ...]
       python benchmarks/doc_tables.py time_outs

Errors are true ones of the end effector, rms. Robots are those of config/studies/laboratory.yaml.

noise (docs/noise.md): what each law loses to noise and delay: error over the second half of
paper_circle, and mean change of the torque from sample to sample, over three seeds.
delays (docs/noise.md): how well the age of states is found where `sensor.stamp: sent` hides it, of
0 to 5 whole samples, under observer_s_fotsmc; it is identified, known, or taken to be 2 ms.
repetition (docs/laws.md): error over a turn, the last of eleven without learning, then those after
3 and 10 turns of learning; disturbances come back in each turn, or some do not.
time_outs (docs/safety.md): how far the robot goes astray while commands stay away.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from parallel_robot.bags.output import tracked
from parallel_robot.studies.sweep import plan, study
from parallel_robot_control.configuration import resolve
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_control.estimation.lock_in import KEPT, result
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.errors import ParallelRobotError
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import yaml_file
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.plant_run import Simulator
from parallel_robot_sim.simulation import Simulation, simulate

Values = Mapping[str, Any]

ENCODER = {'sensor.resolution': 2e-5, 'sensor.differentiate': True}
NOISES: dict[str, Values] = {
    'exact': {},
    'velocity noise': {'sensor.velocity_noise': 0.01},
    'encoder': ENCODER,
    'encoder, filter': {**ENCODER, 'estimator.kind': 'filter'},
    'encoder, levant': {**ENCODER, 'estimator.kind': 'levant'},
    'states 2 ms late': {'sensor.delay': 0.002},
    'motor lag 2 ms': {'actuator.lag': 0.002},
}
SEEDS = range(3)

LEARNERS = ('s_fotsmc', 'pid', 'lqg_tracking', 'tdc', 'computed_torque')
TURNS, LEARNT = 11, (3, 10)
NOISE = {
    'sensor.stamp': 'measured', 'sensor.delay': 0.002, 'sensor.position_noise': 5e-6,
    'sensor.velocity_noise': 0.005, 'disturbance.bandwidth': 10.0,
}  # fmt: skip
COGGING: Values = {'disturbance.ripple': 0.5, 'approach.duration': 0.4}
DISTURBANCES: dict[str, tuple[str, Values]] = {
    'masses + 10 %, friction, cogging': ('heavy_circle', COGGING),
    '5 N m at 3 Hz': ('disturbed_circle', {'approach.duration': 0.4}),
    'the first with noise': ('heavy_circle', {**COGGING, **NOISE, 'disturbance.noise': 0.5}),
}

PERIOD, START = 1e-3, 10**9  # s, ns
AFTER = 0.5  # s, simulated after a gap
EARLY = (0.01, 0.03, 0.06, 0.1, 0.2, 0.3)  # s, begin of a gap: the robot is pulled to the path
STEADY = (2.2, 3.1, 4.3, 5.05, 6.7, 8.0)  # s, when it moves along it
TIMEOUTS = (0.05, 0.1, 0.2, 0.5)  # s
GAPS = (  # law, moments, how long the commands stay away [s]
    ('s_fotsmc', STEADY, 0.1),
    ('s_fotsmc', STEADY, 0.2),
    ('s_fotsmc', STEADY, 0.5),
    ('s_fotsmc', EARLY, 1.0),
    ('pid', EARLY, 1.0),
)


def run(scenario: str, values: Values) -> Simulation | str:
    """A run, or what became of its robot."""
    try:
        made = simulate(configure(resolve(scenario, values)))
    except ParallelRobotError:
        return 'lost'
    return made if made.fault is None else 'fault'


def error(made: Simulation | str, turn: int = 0) -> Array:
    """Error of each turn of that many samples, or over the second half [um]; inf for none."""
    if isinstance(made, str):
        return np.full(TURNS if turn else 1, np.inf)
    squares = ((made.run.pose - made.reference.pose)[:, :2] ** 2).sum(axis=1)
    parts = squares[: TURNS * turn] if turn else squares[made.run.steps // 2 :]
    return np.asarray(1e6 * np.sqrt(parts.reshape(TURNS if turn else 1, -1).mean(axis=1)))


def laboratory(law: str, words: Sequence[str], count: int) -> tuple[Any, dict[str, Any]]:
    """The robots of the study, as many as the first word says, and the changes that follow it."""
    asked = study.parse(study.read(study.file_of('laboratory')), 'laboratory')
    planned = plan.plan(replace(asked, laws=tuple(x for x in asked.laws if x.name == law)))
    rows = planned.rows(0, 0, int(words[0]) if words else count)
    return rows, yaml_file.parse_assignments(words[1:])


def noise(words: Sequence[str]) -> None:
    """Print the table in Markdown."""
    seconds = float(words[0]) if words else 12.0
    print('| law | ' + ' | '.join(NOISES) + ' |')
    print('| --- |' + ' ---: |' * len(NOISES))
    for law in LAWS:
        cells = [loss(law, changes, seconds) for changes in NOISES.values()]
        print(f'| `{law}` | ' + ' | '.join(cells) + ' |', flush=True)


def loss(law: str, changes: Values, seconds: float) -> str:
    """A cell: error [um], and change of the torque [N m]."""
    errors, steps = [], []
    for seed in SEEDS if changes else SEEDS[:1]:
        made = run('paper_circle', {'law': law, 'duration': seconds, 'seed': seed, **changes})
        if isinstance(made, str):
            return made
        errors.append(error(made))
        half = made.run.command[made.run.steps // 2 :]
        steps.append(np.abs(np.diff(half, axis=0)).mean())
    return f'{np.mean(errors):.0f} ({np.mean(steps):.2g})'


def delays(words: Sequence[str]) -> None:
    """Print what was found, and the errors."""
    rows, changes = laboratory('observer_s_fotsmc', words, 256)
    misses, apart, kept = [], [], 0
    errors: dict[str, list[float]] = {'identified': [], 'known': [], '2 ms assumed': []}
    for row in tracked(rows, len(rows), 'robots'):
        given = {**row.overrides, 'sensor.stamp': 'sent', **changes}
        period = float(resolve(row.scenario, given)['period'])
        delay = float(np.floor(given['sensor.delay'] / period + 0.5) * period)
        for name, of in zip(errors, ('identify', delay, 0.002), strict=True):
            made = run(row.scenario, {**given, 'estimator.delay': of})
            errors[name].append(float(error(made)[0]))
            if of == 'identify' and not isinstance(made, str):
                found = result(made.experiment.control.setup)
                kept += found.phase == KEPT
                misses.append((found.delay - delay) / period)
                apart.append(float(np.ptp(found.of_joints)) / period)
    off = np.abs(misses)
    print(f'{len(rows)} robots, default kept on {kept}')
    print(f'  exact {np.sum(off < 1e-9)}, within half a period {np.sum(off <= 0.5)}')
    print(f'  joints apart [periods]: median {np.median(apart):.3f}, largest {max(apart):.3f}')
    for name, values in errors.items():
        low, middle, high = np.percentile(values, [5, 50, 95])
        print(f'  {name:<14}{middle:8.2f} um  (5 to 95 %: {low:.2f} to {high:.2f})')
        print(f'{"":16}{max(values):8.2f} um at worst')


def repetition(words: Sequence[str]) -> None:
    """Print the errors of each case."""
    rows, changes = laboratory('pid', words, 32)
    learning = {'repetition.gain': 0.5, **changes}
    cases = {name: [case] for name, case in DISTURBANCES.items()}
    robots = [(row.scenario, row.overrides) for row in rows]
    for name, some in {**cases, f'{len(rows)} robots of laboratory, median': robots}.items():
        print(f'{name}: without, after {", ".join(map(str, LEARNT))} turns [um]')
        for law in LEARNERS:
            found = [learnt(scenario, {**given, 'law': law}, learning) for scenario, given in some]
            values = np.median(np.array(found), axis=0)
            print(f'  {law:<16}' + ''.join(f'{value:9.3g}' for value in values), flush=True)


def learnt(scenario: str, given: Values, learning: Values) -> Array:
    """Errors without learning, and after LEARNT turns [um]."""
    values = resolve(scenario, given)
    turn = round(2.0 * np.pi / values['circle.rate'] / values['period'])
    whole = {**given, 'duration': TURNS * turn * values['period']}
    without, found = (
        error(run(scenario, {**whole, **gain}), turn)
        for gain in ({'repetition.gain': 0.0}, learning)
    )
    return np.array([without[-1], *found[list(LEARNT)]])


def time_outs(_: Sequence[str]) -> None:
    """Print the largest distances by law, gap and time-out."""
    print('largest distance [mm] at plant.command_timeout [s]')
    print(' ' * 24 + ''.join(f'{timeout:8g}' for timeout in TIMEOUTS))
    for law, moments, gap in GAPS:
        row = [max(astray(law, at, gap, timeout) for at in moments) for timeout in TIMEOUTS]
        head = f'{law}, {"start" if moments is EARLY else "circle"}, {gap:g} s'
        print(f'{head:<24}' + ''.join(f'{worst * 1e3:8.1f}' for worst in row), flush=True)


def astray(law: str, begin: float, gap: float, timeout: float) -> float:
    """Largest distance of the platform from the circle from the begin of a gap on [m]."""
    limits = {'plant.command_timeout': timeout, 'safety.reference_timeout': 10.0}
    made = configure(resolve('paper_circle', {'law': law, **limits}))
    controller, simulator = Controller(made), Simulator(made)
    controller.set_start(START)
    first, last = round(begin / PERIOD), round((begin + gap) / PERIOD)
    count = last + round(AFTER / PERIOD)
    motion = made.trajectory.sample(np.arange(count + 1) * PERIOD)
    command, worst = np.zeros(3), 0.0
    for k in range(count):
        stamp, joints = START + k * round(PERIOD * 1e9), simulator.measurement()
        rows = (motion.position, motion.velocity, motion.acceleration)
        controller.add_reference(stamp, JointReference(*(row[k] for row in rows)))
        away = first <= k < last
        measured = joints.position, joints.velocity, simulator.state.torque
        if not away and controller.add_state(stamp, measured):
            command = controller.torque
        simulator.advance(command, arrived=not away)
        if k >= first:
            distance = np.linalg.norm((simulator.pose - motion.pose[k + 1])[:2])
            worst = max(worst, float(distance))
    return worst


TABLES = {each.__name__: each for each in (noise, delays, repetition, time_outs)}

if __name__ == '__main__':
    TABLES[sys.argv[1]](sys.argv[2:])
