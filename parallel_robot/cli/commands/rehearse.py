"""The command ``rehearse``: the first power-up of a robot, step by step, on the simulated one."""

from __future__ import annotations

import argparse
import re
import shlex
import signal
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from parallel_robot.analysis import metrics, recorded_motions, timing
from parallel_robot.analysis.readable_metrics import TRUE_AND_SEEN_ERRORS, defined, shown, told
from parallel_robot.bags import history, output
from parallel_robot.bags.history import ControllerStatus
from parallel_robot.bags.limits import TRUSTED
from parallel_robot.bags.run import recorded_robot, run_log
from parallel_robot.bags.run.recorded_robot import RobotCode
from parallel_robot.bags.run.run_log import RunLog
from parallel_robot.cli import command_line
from parallel_robot.cli.commands import run
from parallel_robot.cli.shared import add_set_argument, given
from parallel_robot.studies.identification import bag_identification, motor_lag
from parallel_robot.studies.identification.regression_rows import CUTOFF
from parallel_robot_control.configuration import resolve
from parallel_robot_control.messages import NO_FAULT
from parallel_robot_model.common.errors import (
    DRIVEN_OUT,
    InputError,
    ParallelRobotError,
    RunError,
    StoppedError,
)
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.configuration import yaml_file
from parallel_robot_model.messages.topics import add_namespace_argument, full
from parallel_robot_model.processes.node_processes import NodeProcesses
from parallel_robot_sim.configuration import configure

if TYPE_CHECKING:
    from parallel_robot.cli.ros_session import Session

# What a recorded drill shows: stops, processes that stand still, and what the robot did then.


class Finding(NamedTuple):
    """Whether something held, what was seen, and from when to when, since t = 0 [s]."""

    holds: bool
    text: str
    span: tuple[float, float] = (0.0, 0.0)


def fault_between(
    log: RunLog, statuses: Sequence[ControllerStatus], wanted: str, begin: float, end: float
) -> Finding:
    """Whether the controller was in one fault within a time, and in none at its end.

    Args:
        log: The run.
        statuses: Of its controller, in order.
        wanted: Code of the fault.
        begin: When it may begin, since t = 0 [s].
        end: When it must have been cleared [s].
    """
    times = [(status.stamp - log.start_stamp) / NANOSECONDS for status in statuses]
    seen = [
        (time, status.fault)
        for time, status in zip(times, statuses, strict=True)
        if begin <= time <= end
    ]
    began = next((time for time, fault in seen if fault == wanted), None)
    if began is None:
        others = sorted({fault for _, fault in seen} - {NO_FAULT})
        return Finding(False, f'no fault {wanted}' + (f', but {", ".join(others)}' * bool(others)))
    last = seen[-1][1]
    if last != NO_FAULT:
        return Finding(False, f'{last} was not cleared')
    cleared = next(time for time, fault in seen if time > began and fault == NO_FAULT)
    text = f'{wanted} at t = {began:.2f} s, cleared at {cleared:.2f} s'
    return Finding(True, text, (began, cleared))


def _noise_of(rows: Array) -> Array:
    """Noise of each joint, rms: that of the usual change from a sample to the next."""
    usual: Array = np.median(np.abs(np.diff(rows, axis=0)), axis=0)
    return usual * 1.4826 / 2**0.5  # as of a normal distribution


def motors_braked(log: RunLog, begin: float, end: float) -> Finding:
    """Whether the motors took away energy all the time, and how far the joints went.

    Args:
        log: The run.
        begin: When the motors had their safe action, since t = 0 [s].
        end: Until when [s].
    """
    rows = (log.time >= begin) & (log.time <= end)
    if rows.sum() < 2:
        return Finding(False, f'no states from t = {begin:.2f} to {end:.2f} s')
    if not (log.has_efforts and log.has_velocities):
        return Finding(False, 'the bag does not tell: it has no efforts or no velocities')
    effort, velocity, step = log.effort[rows], log.velocity[rows], np.diff(log.time[rows])
    drift = float(np.abs(np.ptp(log.position[rows], axis=0)).max())
    speed = float(np.abs(velocity[-1]).max())
    work = np.concatenate([[0.0], np.cumsum((effort * velocity).sum(axis=1)[1:] * step)])
    driven = float((work - np.minimum.accumulate(work)).max())
    of_effort, of_velocity = _noise_of(effort), _noise_of(velocity)
    random = np.square(effort * of_velocity) + np.square(velocity * of_effort)
    limit = (of_effort * of_velocity).sum() * step.sum() + LEAST_WORK
    limit += CLEAR_OF_NOISE * float(np.sqrt(np.square(step) @ random[1:].sum(axis=1)))
    rad, rate = log.units.of('rad'), log.units.of('rad/s')
    text = f'joints went {drift:.2g} {rad}, {speed:.2g} {rate} at the end'
    if driven > limit:
        noise = f'where the noise of efforts and velocities makes up to {limit:.2g} J'
        return Finding(False, f'the motors drove with {driven:.2g} J, {noise}; {text}')
    return Finding(True, f'the motors braked; {text}')


IDENTIFIES = '  ...     the robot is identified from this bag, which takes a minute or more'
LEAST_WORK, CLEAR_OF_NOISE = 1e-6, 5.0  # J; standard deviations of the work of noise alone
LAW = 'observer_s_fotsmc'
NOISE = {'sensor.position_noise': 1e-5, 'sensor.velocity_noise': 1e-3}  # rad, rad/s
INERTIA = re.compile(r'true_robot\.(m|I)(\d|p)?|true_robot\.inertia')
HEAVIER = 1.15  # times the inertia that is assumed
SLOW, DURATION = 0.2, 8.0  # share of the speed; s of each motion
MARGIN = 0.1  # s, for a signal or a request to arrive
# Of the drill: seconds since t = 0, and what is done to the running nodes.
STOP, CLEAR = 'controller/emergency_stop', 'controller/clear_fault'
DRILL: tuple[tuple[float, str, int], ...] = (
    (1.5, STOP, 0),
    (2.5, CLEAR, 0),
    (3.5, 'controller', signal.SIGSTOP),
    (4.2, 'controller', signal.SIGCONT),
    (5.0, CLEAR, 0),
    (6.0, 'plant', signal.SIGSTOP),
    (6.8, 'plant', signal.SIGCONT),
    (7.6, CLEAR, 0),
)
DRILLED = 9.0  # s


STEPS = ('rest', 'drill', 'identify', 'slow', 'fast')


class Step(NamedTuple):
    """A step of the rehearsal: its name, what is done, what it changes in the configuration."""

    name: str
    text: str
    changes: dict[str, Any]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        'scenario', nargs='?', default='paper_circle', help='default: paper_circle'
    )
    parser.add_argument(
        '--out', type=Path, required=True, metavar='DIR', help='of all bags; must not exist'
    )
    parser.add_argument(
        '--only', nargs='+', choices=STEPS, metavar='STEP', help=f'of {", ".join(STEPS)}'
    )
    add_set_argument(parser)
    add_namespace_argument(parser, 'of the nodes')


def execute(arguments: argparse.Namespace) -> int:
    """Run the command."""
    if 'duration' in yaml_file.parse_assignments(arguments.assignments):
        raise InputError('--set duration: each step has its own')
    base = base_of(arguments.scenario, given(arguments))
    steps = steps_of(arguments.scenario, base)
    steps = {name: steps[name] for name in arguments.only or STEPS}
    for step in steps.values():
        configure(resolve(arguments.scenario, base | step.changes))  # before anything moves
    space = full(arguments.namespace)
    output.check_directory(arguments.out)
    arguments.out.mkdir(parents=True)
    failed = 0
    learnt: dict[str, Any] = {}
    for step in steps.values():
        number = STEPS.index(step.name) + 1
        print(f'{number} {step.name}: {step.text}', flush=True)
        bag = arguments.out / f'{number}_{step.name}'
        changed = base | step.changes | learnt
        during = drill() if step.name == 'drill' else lambda *_: None
        values = resolve(arguments.scenario, changed)
        ended = run.move(configure(values), arguments.scenario, changed, bag, space, during)
        if ended.signal:
            raise StoppedError(ended.signal)
        if ended.driven_out:
            raise RunError(f'{DRIVEN_OUT} in step {step.name}')
        for finding in findings(step.name, bag, values):
            print(f'  {"ok" if finding.holds else "FAILED":7} {finding.text}')
            failed += not finding.holds
        if step.name == 'identify':
            print(IDENTIFIES, flush=True)
            learnt = _learn(bag, arguments.out / 'robot.yaml')
    print(f'bags    {arguments.out}')
    moved = sorted(map(str, arguments.out.glob('[45]_*')))
    if moved:
        words = ['report', *moved, '--out', str(arguments.out / 'report')]
        print(f'next    {shlex.join([*command_line.invocation_words(), *words])}')
    return 1 if failed else 0


def base_of(scenario: str, changed: Mapping[str, Any]) -> dict[str, Any]:
    """The changes of all steps: a robot that is not the one that is assumed, with noisy sensors.

    What the user has changed stays.
    """
    values = resolve(scenario, changed)
    truth = {key: values[key] for key in values if key.startswith('true_robot.')}
    heavier = {
        key: (np.asarray(value) * HEAVIER).tolist()
        for key, value in truth.items()
        if INERTIA.fullmatch(key) and key not in changed
    }
    ideal = not any(np.any(values[key]) for key in NOISE)
    laboratory = dict(NOISE) if ideal else {}
    return {'law': LAW, **laboratory, **truth, **heavier, 'time_mode': 'wall', **changed}


def steps_of(scenario: str, base: Mapping[str, Any]) -> dict[str, Step]:
    """The steps, in their order, by name."""
    values = resolve(scenario, base)
    still = {'trajectory.shape': 'hold', 'hold.pose': []}  # where it is
    exciting = {
        'law': 'adaptive_s_fotsmc',
        'trajectory.shape': 'excitation',
        'plant.initial_pose': list(values['excitation.center']),
    }
    slow = {'trajectory.speed_factor': SLOW * float(values['trajectory.speed_factor'])}
    soft = {'approach.duration': max(1.0, float(values['approach.duration']))}
    steps = (
        Step('rest', 'the robot holds still', {**still, 'duration': 3.0}),
        Step(
            'drill',
            'slowly, with an emergency stop; then controller and plant stand still for a while',
            {**slow, **soft, 'duration': DRILLED},
        ),
        Step('identify', 'a motion that excites it', {**exciting, 'duration': 12.0}),
        Step('slow', 'the motion of the scenario, slowly, with the identified robot',
             {**slow, **soft, 'duration': DURATION}),
        Step('fast', 'as fast as the scenario says', {**soft, 'duration': DURATION}),
    )  # fmt: skip
    return {step.name: step for step in steps}


def drill() -> run.During:
    """Make a function that does what DRILL says, each at its time."""
    left = [*DRILL]

    def act(processes: NodeProcesses, session: Session, time: float) -> None:
        while left and time >= left[0][0]:
            _, what, number = left.pop(0)
            if number:
                processes.signal(what, number)
            else:
                session.trigger(what)

    return act


def findings(name: str, bag: Path, values: Mapping[str, Any]) -> Iterator[Finding]:
    """What a step has shown, by its name."""
    code = RobotCode(files=tuple(values['custom_robots']))
    log, past, _ = recorded_robot.read(bag, TRUSTED, code)
    if name == 'drill':
        yield from _drilled(log, past, values)
        return
    faults = sorted({status.fault_text for status in past.statuses if status.fault != NO_FAULT})
    yield Finding(not faults, f'fault: {", ".join(faults)}' if faults else 'no fault')
    missing = sum(count.missing for count in log.messages.values())
    verdict = timing.verdict(timing.evaluate(log, past)) or 'real time: held'
    yield Finding(not missing, f'{len(log.time)} states, {missing} messages missing; {verdict}')
    if name == 'rest':
        yield _noise(log, values)
    if name in ('slow', 'fast'):
        motions = recorded_motions.of_bag(log, past).motions
        found = metrics.figures(motions)
        texts = [told(metric, found, shown) for metric in defined(TRUE_AND_SEEN_ERRORS, found)]
        yield Finding(True, f'over the second half: {"; ".join(texts)}')


def _noise(log: run_log.RunLog, values: Mapping[str, Any]) -> Finding:
    """Whether the noise that is found at rest is that of the sensors."""
    found = motor_lag.rest_of(log)
    if found is None:
        return Finding(False, motor_lag.NO_REST)
    told = np.broadcast_to(values['sensor.position_noise'], found.position.shape)
    close = bool(np.all(np.abs(found.position - told) <= 0.2 * told + 1e-9))
    rad, rate = log.units.of('rad'), log.units.of('rad/s')
    noise = f'{found.position.max():.3g} {rad}, {found.velocity.max():.3g} {rate}'
    return Finding(close, f'noise of the sensors, rms: {noise}; simulated: {told.max():.3g} {rad}')


def _drilled(
    log: run_log.RunLog, past: history.History, values: Mapping[str, Any]
) -> Iterator[Finding]:
    stop, _, still, resumed, _, lost, *_ = (at for at, _, _ in DRILL)
    name = 'emergency stop'
    found = fault_between(log, past.statuses, 'emergency_stop', stop, still)
    yield _named(name, found)
    begin, cleared = found.span
    yield _named(name, motors_braked(log, begin + MARGIN, cleared - MARGIN))
    name = 'controller stands still'
    acts = still + float(values['plant.command_timeout']) + 2 * MARGIN
    yield _named(name, motors_braked(log, acts, resumed - MARGIN))
    name = 'states stay away'
    yield _named(name, fault_between(log, past.statuses, 'states_stale', lost, DRILLED))
    last = past.statuses[-1].fault
    yield Finding(last == NO_FAULT, f'at the end: {"no fault" if last == NO_FAULT else last}')


def _named(name: str, finding: Finding) -> Finding:
    return finding._replace(text=f'{name}: {finding.text}')


def _learn(bag: Path, file: Path) -> dict[str, Any]:
    """Identify the robot into a file; what it changes, without what is the plant's own."""
    try:
        found = bag_identification.identify(bag, cutoff=CUTOFF)
        found.write(file, None)
    except ParallelRobotError as error:
        print(f'  FAILED  {error}')
        return {}
    before, now = (
        float(np.max(each)) for each in (found.checked.nominal_error, found.checked.error)
    )
    nm = found.found.nominal.robot.joint_units.of('N m')
    print(f'  ok      {file}: torque error, rms, {before:.2g} {nm} before, now {now:.2g} {nm}')
    learnt = yaml_file.read_parameter_file(file)
    return {key: value for key, value in learnt.items() if not key.startswith('friction.')}
