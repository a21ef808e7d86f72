"""The least error of any controller, held against closed forms, a dense solution and runs."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from parallel_robot.cli.command_line import main
from parallel_robot.studies.calm import WHOLE, least_error
from parallel_robot.studies.limit import LinearMotion, Noise, errors, least, linearise, noise_of
from parallel_robot.studies.sweep import study
from parallel_robot.studies.sweep.plan import Plan, plan
from parallel_robot.studies.sweep.results import ERRORS
from parallel_robot.studies.sweep.run_chunk import run_chunk
from parallel_robot_control.configuration import resolve
from parallel_robot_model.configuration import config
from parallel_robot_sim.configuration import assemble_plant, configure
from parallel_robot_sim.ideal_torque import coordinates_of
from parallel_robot_sim.plant_run import Simulator

PERIOD = 1e-3  # s
SHORT = (
    2.0  # s, of runs of described machines, which take fifty times as long as the paper's robot
)
STUDIES = sorted(path.stem for path in (config.directory() / 'studies').glob('*.yaml'))
NOISY = {
    'sensor.position_noise': 1e-5, 'sensor.velocity_noise': 5e-3, 'sensor.delay': 2e-3,
    'disturbance.noise': 0.5, 'disturbance.bandwidth': 10.0,
}  # fmt: skip
AXES = {'friction.viscous': [0.0] * 5, 'friction.coulomb': [0.0] * 5, 'duration': 0.2}


def of(scenario, **changes):
    return configure(resolve(scenario, changes))


def noise_in(configuration):
    joints = len(configuration.loop.joints)
    return noise_of(configuration.imperfections, configuration.loop.period, joints)


def one_mass(mass=0.5, samples=400):
    """One joint with a mass and no friction."""
    times = np.array([0.0, samples * PERIOD])
    stay = np.array([[1.0, PERIOD], [0.0, 1.0]])
    push = np.array([[0.5 * PERIOD**2], [PERIOD]]) / mass
    each = (stay, push, np.eye(2), np.eye(2)[:1])
    return LinearMotion(times, *(np.array([part, part]) for part in each))


def noise(position=0.0, velocity=0.0, disturbance=0.0, memory=0.0, late=0):
    one = np.ones(1)
    return Noise(position * one, velocity * one, disturbance * one, memory, 0.0 * one, late)


def test_what_a_late_state_hides_is_nothing_where_its_stamp_tells():
    """The circle is run at 0.03 m x pi / 3 rad/s."""
    late = {'duration': 1.0, 'sensor.delay': 3e-3, 'sensor.position_noise': 1e-6}
    hidden = least_error(of('paper_circle', **late), causes=False)
    assert np.isclose(hidden.travelled, 3e-3 * 0.03 * np.pi / 3.0, rtol=1e-3)
    told = least_error(of('paper_circle', **late, **{'sensor.stamp': 'measured'}), causes=False)
    assert np.isnan(told.travelled) and told.errors == hidden.errors


def test_without_noise_there_is_no_error():
    configuration = of('paper_circle', duration=1.0, **{'sensor.delay': 3e-3})
    unknown = noise_of(configuration.imperfections, PERIOD, 3)
    assert least(linearise(configuration), unknown, PERIOD) < 1e-10
    assert set(least_error(configuration).errors.values()) == {0.0}


@pytest.mark.parametrize('late', [0, 1, 4])
def test_exact_states_leave_the_disturbance_since_the_measurement(late):
    """A mass that is pushed at random for late + 1 samples: a sum of squares."""
    share = np.arange(late + 1) + 0.5
    expected = 0.2 * PERIOD**2 / 0.5 * np.sqrt(np.sum(share**2))
    found = least(one_mass(), noise(1e-14, 1e-13, disturbance=0.2, late=late), PERIOD)
    assert found == pytest.approx(expected, rel=1e-6)


def test_the_axes_are_masses():
    changes = {'disturbance.noise': 0.2, 'sensor.delay': 2e-3}
    configuration = of('axes_step', **AXES, **changes)
    inertia = np.array(configuration.true_robot.parameters.inertia)
    share = np.arange(3) + 0.5
    each = 0.2 * PERIOD**2 / inertia * np.sqrt(np.sum(share**2))
    found = least_error(configuration).errors[WHOLE]
    assert found == pytest.approx(np.sqrt(np.mean(each**2)), rel=1e-4)


def test_the_limit_is_that_of_all_measurements_at_once():
    """The filter step by step, and the conditional variance of one large Gaussian vector."""
    samples, late, sigma, memory = 60, 2, 0.3, 0.94
    told = noise(1e-5, 5e-3, sigma, memory, late)
    motion = one_mass(samples=samples)
    # Each state is a linear function of the draws: w_0, xi_0, xi_1, ...
    draws = samples + 2
    state, pushed = np.zeros((samples + 1, 2, draws)), np.zeros(draws)
    pushed[0] = sigma
    for k in range(samples):
        state[k + 1] = motion.transition[0] @ state[k] + np.outer(motion.torque[0, :, 0], pushed)
        pushed = memory * pushed
        pushed[k + 1] += sigma * np.sqrt(1.0 - memory**2)
    times, found = errors(motion, told, PERIOD)
    for at in np.round(times / PERIOD).astype(int):
        heard = state[: at - late].reshape(-1, draws)
        variance = heard @ heard.T + np.diag(np.tile([1e-10, 2.5e-5], at - late))
        wanted = state[at, 0]
        known = np.linalg.solve(variance, heard @ wanted)
        expected = np.sqrt(wanted @ wanted - (heard @ wanted) @ known)
        assert found[times == at * PERIOD][0] == pytest.approx(expected, rel=1e-6)


def test_a_filter_that_runs_has_the_error_of_the_limit():
    """Monte Carlo on the 3-RRR robot: 300 noisy motions, predicted by a filter of its own."""
    configuration = of('paper_circle', duration=1.0, **NOISY)
    motion, told = linearise(configuration), noise_in(configuration)
    chance, runs, joints, states = np.random.default_rng(1), 300, 3, 6
    wide = states + joints
    count, ratio = round(1.0 / PERIOD), round((motion.times[1] - motion.times[0]) / PERIOD)
    deviation = np.zeros((runs, wide))
    deviation[:, states:] = told.disturbance * chance.standard_normal((runs, joints))
    guess, history = np.zeros((runs, wide)), []
    covariance = np.diag([0.0] * states + [*told.disturbance**2])
    spread = np.concatenate((told.position, told.velocity))
    fresh = np.sqrt(1.0 - told.memory**2) * told.disturbance
    squares = []

    def system(k):
        place = min(round(k / ratio), len(motion.times) - 1)
        whole = np.zeros((wide, wide))
        whole[:states, :states], whole[:states, states:] = (
            motion.transition[place], motion.torque[place],
        )  # fmt: skip
        whole[states:, states:] = told.memory * np.eye(joints)
        return whole, np.hstack((motion.measured[place], np.zeros((6, 3)))), motion.error[place]

    for k in range(count):
        whole, output, shown = system(k)
        if len(history) > told.late and k >= count // 2:
            predicted = history[-told.late - 1]
            for j in range(k - told.late - 1, k):
                predicted = predicted @ system(j)[0].T
            missed = (deviation - predicted)[:, :states] @ shown.T
            squares.append(np.sum(missed**2, axis=1))
        heard = deviation @ output.T + spread * chance.standard_normal((runs, 6))
        inner = output @ covariance @ output.T + np.diag(spread**2)
        gain = covariance @ output.T @ np.linalg.inv(inner)
        guess = guess + (heard - guess @ output.T) @ gain.T
        covariance = covariance - gain @ output @ covariance
        history.append(guess)
        deviation = deviation @ whole.T
        deviation[:, states:] += fresh * chance.standard_normal((runs, joints))
        guess = guess @ whole.T
        covariance = whole @ covariance @ whole.T
        covariance[states:, states:] += np.diag(fresh**2)
    assert np.sqrt(np.mean(squares)) == pytest.approx(least(motion, told, PERIOD), rel=0.03)


def test_the_linear_motion_is_that_of_the_plant():
    """A robot that is pushed a little while it rests, against the plant itself."""
    changes = {'trajectory.shape': 'hold', 'friction.coulomb': [0.0] * 3, 'duration': 0.1}
    configuration = of('paper_circle', **changes)
    configuration = of('paper_circle', **changes, **{
        'plant.initial_pose': configuration.trajectory.sample(0.0).pose[0].tolist(),
    })  # fmt: skip
    motion, plant = linearise(configuration), Simulator(configuration)
    start, torque = plant.pose[:2], np.array([0.3, -0.2, 0.1])
    deviation = np.zeros(6)
    for _ in range(20):
        plant.advance(torque)
        deviation = motion.transition[0] @ deviation + motion.torque[0] @ torque
    assert motion.error[0] @ deviation == pytest.approx(plant.pose[:2] - start, rel=2e-3)


@pytest.mark.parametrize('scenario', ['paper_circle', 'axes_step', 'serial_2r_circle'])
def test_the_coordinates_along_a_motion_are_those_at_which_the_robot_would_start(scenario):
    configuration = of(scenario, duration=4.0)
    robot, poses = configuration.true_robot, configuration.trajectory.sample(
        np.arange(0.0, 4.0, 0.05)
    ).pose  # fmt: skip
    found = coordinates_of(robot, assemble_plant(configuration), poses)
    expected = [robot.module.start(robot.parameters, pose) for pose in poses]
    assert found == pytest.approx(np.array(expected), abs=1e-12)


def test_a_motion_out_of_reach_costs_one_line(capsys):
    assert main(['limit', 'paper_circle', '--set', 'circle.radius=0.5', '--duration', '1']) == 2
    assert 'out of reach' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('setting', 'says'),
    [
        ('sensor.counts_per_turn=65536', 'step counts as noise: an estimate'),
        ('stiction.stiffness=5000', 'rigid gears that do not stick: no bound'),
    ],
)
def test_what_is_no_bound_is_told(setting, says, capsys):
    words = ['--set', setting, '--set', 'disturbance.noise=0.1', '--duration', '1']
    assert main(['limit', 'paper_circle', *words]) == 0
    assert says in capsys.readouterr().err
    assert main(['limit', 'paper_circle', *words[2:]]) == 0
    assert 'no bound' not in capsys.readouterr().err


def test_what_the_limit_counts_as_noise():
    changes = {**NOISY, 'sensor.resolution': 1.2e-4, 'actuator.delay': 1e-3, 'actuator.noise': 0.1}
    found = noise_in(of('paper_circle', duration=1.0, **changes))
    assert found.late == 3 and found.motor.tolist() == [0.1] * 3
    assert found.position == pytest.approx(np.hypot(1e-5, 1.2e-4 / np.sqrt(12.0)))
    assert found.memory == pytest.approx(np.exp(-2 * np.pi * 10.0 * PERIOD))
    silent = noise_in(of('paper_circle', duration=1.0, **{**NOISY, 'sensor.differentiate': True}))
    assert np.isinf(silent.velocity).all()


@pytest.mark.parametrize('every', [4, pytest.param(1, marks=pytest.mark.endurance)])
@pytest.mark.parametrize('name', STUDIES)
def test_no_law_is_below_the_limit(name, every):
    """A robot of each scenario of a study that is shipped, which can be planned, all along.

    Each fourth law, in the next study the laws after these; all of them in make endurance. All
    laws are planned; values at the ends of the uncertainty, with the laws that run.
    """
    file = study.file_of(name)
    asked = study.parse(study.read(file), str(file), file.parent)
    if resolve(asked.scenarios[0], asked.fixed)['robot_description']:
        asked = replace(asked, duration=SHORT)
    first = STUDIES.index(name) % min(every, len(asked.laws))
    assert plan(replace(asked.changed(asked.scrambles, {}), uncertainties=())).cases
    asked = replace(asked, laws=asked.laws[first::every])  # the checks of others cost most of it
    planned = plan(asked.changed(asked.scrambles, {}))
    whole = Plan(asked, planned.cases)
    assert bool(whole.row(whole.count - 1).drawn) == bool(asked.uncertainties)
    limits, below = {}, []
    for case in range(len(planned.cases)):
        rows = planned.rows(case, 0, 1)
        configurations = [configure(resolve(row.scenario, row.overrides)) for row in rows]
        leader = planned.leader(case)
        if leader not in limits:
            limits[leader] = [
                least_error(each, causes=False).errors[WHOLE] for each in configurations
            ]
        ran = run_chunk(configurations)
        for row, outcome, limit in zip(rows, ran, limits[leader], strict=True):
            if outcome.metrics is None:
                continue
            errors = (metric.of(outcome.metrics) for metric in ERRORS)
            error = next(each for each in errors if not np.isnan(each))
            if not error >= limit:
                below.append((row.law, row.scenario, row.sample, error, limit))
    assert limits and not below


def test_the_command_writes_one_row_for_each_robot(tmp_path, capsys):
    out = tmp_path / 'limit.csv'
    words = ['--runs', '2', '--out', str(out)]
    assert main(['limit', 'robustness', *words]) == 0
    rows = [*csv.DictReader(out.open())]
    assert [row['sample'] for row in rows] == ['0', '1']
    late = [float(row['as_it_is_m']) / float(row['without_delays_m']) for row in rows]
    assert late[0] > 1.5 and late[1] > 1.1  # four samples late, and one
    shown = capsys.readouterr().out
    assert 'paper_circle, 2 robots: least end-effector error of any controller, rms [µm]' in shown
    for name, column in {
        'as it is': 'as_it_is_m',
        'without delays': 'without_delays_m',
        'travelled while a state is late': 'travelled_m',
    }.items():
        found = [float(row[column]) for row in rows]
        [line] = [line for line in shown.splitlines() if line.strip().startswith(f'{name} ')]
        median = float(line.split(name)[1].split()[0])
        assert median == pytest.approx(1e6 * np.median(found), rel=1e-3)
    assert main(['limit', 'robustness', *words]) == 2
    assert 'exists' in capsys.readouterr().err
    assert main(['limit', 'robustness', '--duration', '1']) == 2
    assert 'the study robustness has its own' in capsys.readouterr().err


def test_a_scenario_has_one_robot(capsys):
    assert main(['limit', 'axes_step', '--set', 'disturbance.noise=0.1']) == 0
    assert 'axes_step: least joint error' in capsys.readouterr().out
    assert main(['limit', 'paper_circle', '--runs', '3']) == 2
    assert '--runs is for studies' in capsys.readouterr().err


def test_what_cannot_be_costs_one_line(tmp_path, capsys):
    file = tmp_path / 'binary.yaml'
    file.write_bytes(b'\xff\xfe\x00')
    for words in ([str(file)], ['paper_circle', '--duration', '0']):
        assert main(['limit', *words]) == 2
        assert capsys.readouterr().err.count('\n') == 1
    assert main(['limit', 'paper_circle', '--duration', '0.01']) == 0  # less than an interval
