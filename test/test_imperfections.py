"""Sensors, motors and disturbances: their statistics and closed forms, and the same everywhere."""

import numpy as np
import pytest
from assembly import make_plant
from rclpy.serialization import deserialize_message
from scipy import stats
from sensor_msgs.msg import JointState

from parallel_robot.analysis import metrics, recorded_motions
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot.python import notebook
from parallel_robot.studies.sweep.run_chunk import run_chunk
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.compiler import kernel, read_row, vector, write_row
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.contract import Measurement
from parallel_robot_model.robots.poses import poses_of
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.configuration import assemble, configure
from parallel_robot_sim.ideal_torque import torque_of
from parallel_robot_sim.imperfections import reported_age
from parallel_robot_sim.noise_and_delay import mixed, uniform
from parallel_robot_sim.plant_run import Simulator
from parallel_robot_sim.sensors_actuators import driven, held_disturbance, record_sensed, sensed
from parallel_robot_sim.simulation import simulate

H = 1e-3  # s
N = 20_000
ZERO = vector(np.zeros(3))
ALL = {
    'sensor.zero_angle': 1e-4, 'sensor.position_noise': 1e-5, 'sensor.velocity_noise': 1e-2,
    'sensor.resolution': 1e-5, 'sensor.delay': 2e-3, 'sensor.jitter': 2e-3,
    'actuator.lag': 2e-3, 'actuator.noise': 0.1,
    'actuator.resolution': 0.01, 'actuator.delay': 1e-3, 'actuator.jitter': 1e-3,
    'actuator.effectiveness': [1.0, 0.9, 1.0], 'actuator.bias': 0.1, 'actuator.fault_time': 0.05,
    'disturbance.constant': 0.1, 'disturbance.pulse': 0.2, 'disturbance.pulse_start': 0.02,
    'disturbance.pulse_duration': 0.03, 'disturbance.noise': 0.1, 'disturbance.bandwidth': 10.0,
    'disturbance.ripple': 0.05, 'compliance.stiffness': [8e4, 0.0, 5e4],
    'compliance.rotor_inertia': [0.02, 0.0, 0.02], 'compliance.damping': [5.0, 0.0, 5.0],
    'compliance.backlash': [1e-5, 0.0, 0.0],
    'stiction.stiffness': 5e3, 'stiction.damping': 20.0,
}  # fmt: skip
DIFFERENTIATED = {'sensor.differentiate': True, 'estimator.kind': 'levant'}


def setup_of(**changes):
    keys = {key.replace('__', '.'): value for key, value in changes.items()}
    return make_plant(config.resolve('paper_circle', keys)).setup


@kernel
def _told(setup, positions, velocities, like, answers):
    for k in range(len(positions)):
        position, velocity = read_row(positions, k, like), read_row(velocities, k, like)
        joints = Measurement(position, velocity, position, velocity, position)
        for again in range(2):
            found = sensed(setup, joints, k * H, H)
            write_row(answers, 4 * k + 2 * again, found[0])
            write_row(answers, 4 * k + 2 * again + 1, found[1])
        record_sensed(setup, joints, joints.position, k * H, H)


def told(setup, positions, velocities=None):
    """What the sensors tell of a motion, one row a sample; asked again, they say the same."""
    velocities = np.zeros_like(positions) if velocities is None else velocities
    answers = np.empty((len(positions), 2, 2, 3))
    _told(setup, positions, velocities, ZERO, answers.reshape(-1, 3))
    assert np.array_equal(answers[:, 0], answers[:, 1])
    return answers[:, 0].transpose(1, 0, 2)


@kernel
def _torques(setup, commands, limits, found):
    for k in range(len(commands)):
        command = read_row(commands, k, limits)
        write_row(found, k, driven(setup, command, -limits, limits, k * H, H))


def torques(setup, commands, limit=1e3):
    found = np.empty_like(commands)
    _torques(setup, commands, vector(np.full(3, limit)), found)
    return found


@kernel
def _disturbances(setup, positions, like, found):
    for k in range(len(found)):
        position = read_row(positions, k, like)
        write_row(found, k, held_disturbance(setup, position, k * H, H))


def disturbances(setup, count, positions=None):
    found = np.empty((count, 3))
    positions = np.zeros((count, 3)) if positions is None else positions
    _disturbances(setup, positions, ZERO, found)
    return found


def assert_white(noise):
    """Standard normal; no element knows of an earlier one or of another joint."""
    assert stats.kstest(noise.ravel(), 'norm').pvalue > 1e-3
    assert noise.std() == pytest.approx(1.0, abs=0.02) and abs(noise.mean()) < 0.02
    spectrum = np.abs(np.fft.fft(noise, 2 * len(noise), axis=0)) ** 2
    lags = np.fft.ifft(spectrum, axis=0).real[1:100] / len(noise)
    assert np.abs(lags).max() < 5 / np.sqrt(len(noise))
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 5 / np.sqrt(len(noise))


def test_numbers_are_those_of_splitmix64():
    """Outputs of the reference implementation for the seed 1234567."""
    golden = 0x9E3779B97F4A7C15
    states = [np.uint64((1234567 + k * golden) % 2**64) for k in range(3)]
    expected = [6457827717110365317, 3203168211198807973, 9817491932198370423]
    assert [int(mixed(state)) for state in states] == expected


def test_uniform_numbers_are_uniform_along_each_argument():
    for along in range(3):
        places = np.zeros((5000, 3), int)
        places[:, along] = np.arange(5000)
        drawn = [uniform(float(seed), k, place) for seed, k, place in places]
        assert stats.kstest(drawn, 'uniform').pvalue > 1e-3
        assert abs(np.corrcoef(drawn[1:], drawn[:-1])[0, 1]) < 0.07


def test_sensor_noise_is_white_and_of_the_given_size():
    setup = setup_of(sensor__position_noise=[0.1, 0.2, 0.3], sensor__velocity_noise=2.0)
    position, velocity = told(setup, np.full((N, 3), 0.7), np.full((N, 3), -3.0))
    assert_white((position - 0.7) / [0.1, 0.2, 0.3])
    assert_white((velocity + 3.0) / 2.0)
    both = np.corrcoef(position[:, 0], velocity[:, 0])[0, 1]
    assert abs(both) < 5 / np.sqrt(N)


def test_another_seed_gives_other_noise():
    first, second = (
        told(setup_of(seed=seed, sensor__position_noise=1.0), np.zeros((N, 3)))[0]
        for seed in (1, 2)
    )
    assert abs(np.corrcoef(first[:, 0], second[:, 0])[0, 1]) < 5 / np.sqrt(N)


def test_encoders_round_and_velocities_are_differences():
    step = 2e-4
    q = 0.3 * np.sin(np.arange(500)[:, None] * H * np.array([1.0, 2.0, 3.0]))
    setup = setup_of(sensor__resolution=step, sensor__differentiate=True)
    position, velocity = told(setup, q, np.full_like(q, np.pi))  # the true ones are not used
    counts = position / step
    assert np.abs(counts - np.round(counts)).max() < 1e-9
    assert 0.45 * step < np.abs(position - q).max() <= 0.5 * step * (1 + 1e-9)
    assert not velocity[0].any()
    assert np.abs(velocity[1:] - np.diff(position, axis=0) / H).max() < 1e-9


def test_counts_per_turn_are_steps_of_that_share_of_a_turn():
    q = 0.3 * np.sin(np.arange(500)[:, None] * H * np.array([1.0, 2.0, 3.0]))
    counts = [4096, 0, 1 << 17]
    position, _ = told(setup_of(sensor__counts_per_turn=counts), q)
    sizes = [2 * np.pi / 4096, 0.0, 2 * np.pi / (1 << 17)]
    same, _ = told(setup_of(sensor__resolution=sizes), q)
    assert np.array_equal(position, same) and np.array_equal(position[:, 1], q[:, 1])
    told_counts = position[:, 0] / (2 * np.pi) * 4096
    assert np.abs(told_counts - np.round(told_counts)).max() < 1e-9 and told_counts[-1] > 90


def test_a_slide_has_no_counts_per_turn():
    values = resolve('hexapod_circle', {'sensor.counts_per_turn': 4096})
    with pytest.raises(InputError, match=r'must be 0 where a joint slides.*resolution is in m'):
        configure(values)


def test_states_come_late_by_whole_samples():
    q = np.arange(100.0)[:, None] + np.zeros(3)
    position, velocity = told(setup_of(sensor__delay=3.2e-3), q, -q)
    assert np.array_equal(position[:, 0], np.maximum(np.arange(100) - 3, 0))
    assert np.array_equal(velocity, -position)


def test_jitter_never_shows_an_older_state_after_a_newer_one():
    q = np.arange(2000.0)[:, None] + np.zeros(3)
    position, velocity = told(setup_of(sensor__delay=2e-3, sensor__jitter=3e-3), q, -q)
    age = np.arange(2000) - position[:, 0]
    assert set(age[10:]) == {2.0, 3.0, 4.0, 5.0}
    assert (np.diff(position, axis=0) >= 0.0).all() and np.array_equal(velocity, -position)
    # The newest of four uniform delays has arrived: at age 2 one time in four.
    assert np.mean(age == 2.0) == pytest.approx(0.25, abs=0.05)


def test_lag_has_the_closed_form_of_a_first_order_lag():
    lag = np.array([5e-3, 1e-3, 2e-2])
    found = torques(setup_of(actuator__lag=lag.tolist()), np.full((100, 3), 2.0))
    begin = np.arange(100)[:, None] * H
    mean = 2.0 * (1.0 - lag / H * (np.exp(-begin / lag) - np.exp(-(begin + H) / lag)))
    assert np.abs(found - mean).max() < 1e-12


def test_commands_come_late_and_there_is_no_torque_before_the_first():
    commands = 1.0 + np.arange(50.0)[:, None] + np.zeros(3)
    found = torques(setup_of(actuator__delay=4e-3), commands)
    assert not found[:4].any() and np.array_equal(found[4:], commands[:-4])


def test_torque_steps_noise_and_saturation():
    found = torques(setup_of(actuator__resolution=0.25), np.full((1, 3), 1.13))
    assert np.array_equal(found, np.full((1, 3), 1.25))
    noisy = torques(setup_of(actuator__noise=0.5), np.full((N, 3), 3.0))
    assert_white((noisy - 3.0) / 0.5)
    assert np.abs(torques(setup_of(actuator__noise=0.5), np.zeros((100, 3)), 0.3)).max() == 0.3


def test_faults_begin_at_their_time():
    setup = setup_of(
        actuator__effectiveness=[1.0, 0.6, 0.0], actuator__bias=[0.0, 5.0, 1.0],
        actuator__fault_time=0.3,
    )  # fmt: skip
    found = torques(setup, np.full((400, 3), 2.0))
    assert (found[:300] == 2.0).all()
    assert np.allclose(found[300:], [2.0, 6.2, 1.0], rtol=1e-15)


def test_constant_and_pulse():
    setup = setup_of(
        disturbance__constant=[1.0, 2.0, 3.0], disturbance__pulse=10.0,
        disturbance__pulse_start=0.1, disturbance__pulse_duration=0.05,
    )  # fmt: skip
    expected = np.tile([1.0, 2.0, 3.0], (300, 1))
    expected[100:150] += 10.0
    assert np.array_equal(disturbances(setup, 300), expected)


def test_noise_has_the_autocorrelation_of_its_bandwidth():
    setup = setup_of(disturbance__noise=[1.0, 2.0, 3.0], disturbance__bandwidth=20.0)
    noise = disturbances(setup, 5 * N) / [1.0, 2.0, 3.0]
    assert noise.std(axis=0) == pytest.approx(np.ones(3), abs=0.05)
    for lag in (1, 5, 10, 20):
        found = (noise[lag:] * noise[:-lag]).mean()
        assert found == pytest.approx(np.exp(-2 * np.pi * 20.0 * lag * H), abs=0.04)
    assert_white(disturbances(setup_of(disturbance__noise=1.0), N))


def test_cogging_is_a_sine_of_the_angle_of_each_motor():
    setup = setup_of(disturbance__ripple=[0.1, 0.0, 0.3], disturbance__ripple_periods=7.0)
    positions = np.random.default_rng(1).uniform(-4.0, 4.0, (50, 3))
    found = disturbances(setup, 50, positions)
    assert np.allclose(found, [0.1, 0.0, 0.3] * np.sin(7.0 * positions), rtol=1e-13, atol=1e-15)
    turn = disturbances(setup, 50, positions + 2 * np.pi)
    assert np.allclose(found, turn, atol=1e-13)


def test_the_ideal_torque_has_the_cogging_of_the_desired_motion():
    def ideal(ripple):
        keys = {'duration': 3.0, 'disturbance.ripple': ripple}
        made = configure(config.resolve('paper_circle', keys))
        return torque_of(made), made.trajectory.sample(np.arange(3001) * H)

    (calm, _), (rough, reference) = ideal(0.0), ideal([0.3, 0.0, 0.1])
    expected = [0.3, 0.0, 0.1] * np.sin(24.0 * reference.position[:-1])
    assert np.allclose((rough - calm)[1:], expected, atol=1e-6)


def test_a_motor_that_opposes_the_constant_keeps_the_robot_still():
    values = config.resolve('paper_circle', {'disturbance.constant': [5.0, -3.0, 2.0]})
    simulator = Simulator(configure(values))
    for _ in range(100):
        simulator.advance(np.array([5.0, -3.0, 2.0]))
    assert np.abs(simulator.pose - values['plant.initial_pose']).max() < 1e-12


def test_a_plant_driven_by_messages_is_that_of_the_simulation():
    loop = assemble(configure(resolve('paper_circle', {'duration': 0.1, 'seed': 0, **ALL})))
    reference = loop.trajectory.sample(np.arange(101) * H)
    whole = run(loop.control, loop.plant, reference, H)
    again = run(loop.control, loop.plant, reference, H)  # with what it remembers of the first
    assert np.array_equal(whole.command, again.command)
    values = resolve('paper_circle', {'duration': 0.1, **ALL, 'plant.publish_passive': False})
    simulator = Simulator(configure(values))
    for k in range(100):
        message = simulator.message(10**9)
        assert message == simulator.message(10**9)
        for rows in (whole.position, whole.velocity, whole.effort):
            assert np.ascontiguousarray(rows[k]).tobytes() in message
        assert np.array_equal(simulator.pose, whole.pose[k])
        simulator.advance(whole.command[k])


@pytest.mark.parametrize('late', [0, 1, 3])
def test_a_state_tells_the_torque_of_the_step_that_ended_when_it_was_measured(late):
    delayed = {'sensor.delay': late * H, 'sensor.stamp': 'measured'}
    simulator = Simulator(configure(resolve('paper_circle', delayed)))
    for k in range(12):
        state = deserialize_message(simulator.message(10**9 + k * 10**6), JointState)
        stamp = state.header.stamp.sec * 10**9 + state.header.stamp.nanosec
        assert stamp == 10**9 + (k - late) * 10**6
        ended = max(k - late, 0)  # and the torque of the step that ends at sample k is k / 10
        assert state.effort[:3].tolist() == pytest.approx([0.1 * ended] * 3, rel=1e-12)
        simulator.advance(np.full(3, 0.1 * (k + 1)))


@pytest.mark.parametrize('more', [{}, DIFFERENTIATED, {'estimator.kind': 'filter'}])
def test_bags_are_replayed_and_made_again(more, tmp_path, capsys):
    words = [f'{key}={value}' for key, value in {**ALL, **more, 'seed': 7}.items()]
    options = [word for each in words for word in ('--set', each)]
    bag = str(tmp_path / 'bag')
    assert main(['simulate', 'paper_circle', '--duration', '0.3', *options, '--out', bag]) == 0
    assert main(['replay', bag]) == 0 and main(['rerun', bag]) == 0
    out = capsys.readouterr().out
    assert 'identical: 301 commands' in out and 'identical:' in out.splitlines()[-1]


@pytest.mark.parametrize('scenario', config.scenarios())
def test_only_the_scenarios_of_faults_are_not_ideal(scenario):
    faulty = {'loss_of_effectiveness', 'actuator_bias', 'stuck_actuator'}
    on = configure(resolve(scenario)).imperfections.on
    assert on == (scenario in faulty)


@pytest.mark.parametrize(
    ('setting', 'reason'),
    [
        ('sensor.position_noise=-1', 'sensor.position_noise must be at least 0 rad'),
        ('sensor.delay=0.2', 'sensor.delay must be from 0 to 0.1 s'),
        ('sensor.resolution=[1,2]', 'sensor.resolution must be a number or a list of 3'),
        ('sensor.counts_per_turn=-1', 'sensor.counts_per_turn must be at least 0'),
        ('sensor.counts_per_turn=0.5', 'sensor.counts_per_turn must be 0 or at least 1, not 0.5'),
        ('sensor.counts_per_turn=many', 'sensor.counts_per_turn must be a number'),
        ('actuator.effectiveness=-0.1', 'actuator.effectiveness must be at least 0'),
        ('seed=1.5', 'seed must be a whole number'),
        ('estimator.kind=kalmann', 'estimator.kind'),
        ('estimator.acceleration=0', 'estimator.acceleration must be at least 0.001'),
    ],
)
def test_wrong_values_cost_one_line(setting, reason, tmp_path, capsys):
    out = tmp_path / 'bag'
    assert main(['simulate', 'paper_circle', '--set', setting, '--out', str(out)]) == 2
    assert reason in capsys.readouterr().err and not out.exists()


def test_steps_of_an_encoder_are_told_once(tmp_path, capsys):
    out = tmp_path / 'bag'
    both = ['--set', 'sensor.resolution=[0,1e-4,0]', '--set', 'sensor.counts_per_turn=4096']
    assert main(['simulate', 'paper_circle', *both, '--out', str(out)]) == 2
    said = capsys.readouterr().err
    assert 'sensor.resolution are the same: one must be 0 (joint 2)' in said and not out.exists()


def test_studies_and_bags_measure_the_true_motion(tmp_path, capsys):
    """A robot that is told its state late follows the circle late, whatever its sensors tell."""
    changes = {'duration': 1.0, 'law': 'computed_torque', 'sensor.delay': 5e-3}
    configuration = configure(resolve('paper_circle', changes))
    [outcome] = run_chunk([configuration])
    made = simulate(configuration).run
    found = poses_of(configuration.robot, made.joints, made.pose[0])
    np.testing.assert_allclose(found, made.pose, atol=1e-9)
    assert np.abs(made.joints - made.position)[500:].max() > 1e-4
    half = slice(len(made.pose) // 2, None)
    error = (made.pose - simulate(configuration).reference.pose)[half, :2]
    rms = np.sqrt((error**2).sum(axis=1).mean())
    assert outcome.metrics['xy_rms_m'] == pytest.approx(rms, rel=1e-6)
    bag = str(tmp_path / 'bag')
    words = ['--duration', '1', '--law', 'computed_torque', '--set', 'sensor.delay=0.005']
    assert main(['simulate', 'paper_circle', *words, '--out', bag]) == 0
    said = capsys.readouterr().out
    shown = f'{1e6 * rms:.3f} µm'
    assert f'  end-effector error, rms {shown}' in said and 'seen end-effector error, rms' in said
    assert main(['analyze', bag]) == 0
    assert shown.split() in (line.split()[-2:] for line in capsys.readouterr().out.splitlines())


def test_a_bag_that_is_not_of_its_plant_tells_what_is_seen_alone(tmp_path):
    """Commands that are not those of the plant lead to other states than the bag has."""
    run = notebook.simulate('axes_step', duration=0.1, **{'sensor.delay': 0.005})
    notebook.save(run, tmp_path / 'bag')
    log, past, _ = recording.read(tmp_path / 'bag')
    good = recorded_motions.of_bag(log, past)
    np.testing.assert_array_equal(good.motions.true.position, run.simulation.run.joints)
    other = recorded_motions.of_bag(log._replace(command=0.9 * log.command), past)
    assert other.motions.true is None and 'does not tell the true motion' in other.remark
    assert np.isnan(metrics.named('joint_rms_rad')[0].of(metrics.figures(other.motions)))
    unknown = recorded_motions.of_bag(log, past._replace(facts={}))
    assert unknown.motions.true is None and 'not known' in unknown.remark


@pytest.mark.parametrize('delay', ['late', None, -1.0, 1e300, float('nan'), [0.001]])
def test_a_bag_may_not_make_states_older_than_sensors_can(delay):
    values = {'sensor.stamp': 'measured', 'period': 1e-3, 'sensor.delay': delay}
    with pytest.raises(InputError, match=r'sensor\.delay must be'):
        reported_age(values)
    assert reported_age(values | {'sensor.delay': 0.0034}) == 3_000_000
    assert reported_age(values | {'sensor.stamp': 'sent'}) == 0
