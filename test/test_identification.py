"""Identification against Table 1 of the paper, with noise, and on motions that do not suffice."""

import weakref
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from assembly import simulated

from parallel_robot.bags import limits
from parallel_robot.bags.history import ControllerStatus
from parallel_robot.studies.identification import (
    identified,
    least_squares,
    measured_motion,
    motor_lag,
    readable,
    regression_rows,
)
from parallel_robot.studies.identification.measured_motion import MeasuredMotion
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common import tables
from parallel_robot_model.common.errors import BagError, InputError
from parallel_robot_model.common.units import HINGES
from parallel_robot_model.configuration import config
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.registry import robot_of

CUTOFF = 10.0  # Hz
# Table 1: a, b, h of a leg and Ip, mp of the platform; friction of section 4.
A = 0.091 + 5.12 * 0.2**2 + 7.39 * 0.4**2
B = 0.267 + 7.39 * 0.3**2
H = 7.39 * 0.4 * 0.3
TABLE_1 = {
    # The platform on its three joints: each adds mp / 3 to the end of a distal link.
    'a + 0.05333 mp': A + 3.84 / 3.0 * 0.4**2,
    'b + 0.12 mp': B + 3.84 / 3.0 * 0.6**2,
    'h + 0.08 mp': H + 3.84 / 3.0 * 0.4 * 0.6,
    'Ip - 0.04 mp': 0.065 - 3.84 * 0.2**2,
    **{f'viscous{k}': 2.5 for k in (1, 2, 3)},
    **{f'coulomb{k}': 0.5 for k in (1, 2, 3)},
}
TRUTH = np.array([*TABLE_1.values()])


def motion(scenario='excitation', **overrides):
    """A simulated run as a recording, with the nominal robot of its configuration."""
    changes = {'duration': 15.0, 'time_mode': 'lockstep'} | overrides
    values = resolve(scenario, changes)
    made = simulated(values)
    run, robot = made.run, robot_of(values)
    friction = FrictionParameters(
        *(tuple(np.broadcast_to(values[f'friction.{key}'], run.position.shape[1]).tolist())
          for key in ('viscous', 'coulomb', 'stribeck')),
        0.01, 0.0, *((0.0,) * run.position.shape[1],) * 2,
    )  # fmt: skip
    return SimpleNamespace(
        values=values,
        run=run,
        nominal=identified.Nominal(robot, friction, run.pose[0]),
        recording=MeasuredMotion(
            np.arange(len(run.position)) * values['period'],
            run.position,
            run.effort,
            np.ones(len(run.position), bool),
        ),
    )


@pytest.fixture(scope='module')
def excited():
    return motion()


def run_of(recorded):
    """The motion of a recording, of motors without limits."""
    joints = [f'joint{k + 1}' for k in range(recorded.position.shape[1])]
    stamps = np.rint(1e9 * recorded.time).astype(np.int64)
    log = SimpleNamespace(joints=joints, units=HINGES, stamps=stamps, **vars(recorded))
    return motion_of(log, (), np.full(len(joints), np.inf))


def held(case, joints):
    """A recording in which a load rests on joints that stand."""
    assert not np.ptp(case.recording.position[:, joints], axis=0).any()
    effort = case.recording.effort.copy()
    effort[:, joints] = 1.0  # N m
    return replaced(case, effort=effort)


def identify(case, recorded=None, cutoff=CUTOFF):
    recorded = recorded or case.recording
    recorded = run_of(recorded) if isinstance(recorded, MeasuredMotion) else recorded
    return identified.identify(case.nominal, recorded, cutoff)


def noisy(case, rng, position=1e-5, torque=0.5):
    """The recording with white noise of these standard deviations [rad, N m]."""
    kept = case.recording
    shape = kept.position.shape
    return MeasuredMotion(
        kept.time,
        kept.position + position * rng.normal(size=shape),
        kept.effort + torque * rng.normal(size=shape),
        kept.usable,
    )


def begun(case, count):
    """The first samples of the recording."""
    return MeasuredMotion(*(part[:count] for part in vars(case.recording).values()))


def replaced(case, **parts):
    return MeasuredMotion(**{**vars(case.recording), **parts})


def motion_of(log, statuses, torque_limit):
    """What can be used of a whole run."""
    steps = np.diff(log.time)
    period = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    return measured_motion.RunMotion([log], period, statuses, torque_limit)


def test_table_1_from_a_noiseless_motion(excited):
    found = identify(excited)
    assert found.base.names == tuple(TABLE_1)
    assert np.abs(found.fit.values / TRUTH - 1.0).max() < 0.01
    assert not found.poor and not found.robot.active
    assert np.allclose(found.robot.values, found.fit.values, rtol=1e-5)


def test_what_noise_leaves_and_what_no_inertias_explain(excited):
    """A leg of 401 mm in place of 400; efforts of other joints."""
    assert not identify(excited).left.doubt
    for recorded in (
        noisy(excited, np.random.default_rng(4)),
        noisy(excited, np.random.default_rng(5), 1e-4, 0.0),
    ):
        assert not identify(excited, recorded).left.doubt
    longer = motion(**{'true_robot.l1': 0.401})
    longer.nominal = excited.nominal
    found = identify(longer)
    assert np.abs(found.fit.values[: len(TRUTH)] / TRUTH - 1.0).max() < 0.2
    assert '0.29 % of a torque is left, and that is no noise' in found.left.doubt
    other = replaced(excited, effort=excited.recording.effort[:, [1, 2, 0]])
    assert 'no set of inertias explains the motion' in identify(excited, other).left.doubt


def test_few_rows_have_the_squares_of_many_and_some_are_kept_evenly(excited, monkeypatch):
    robot, guess = excited.nominal.robot, excited.nominal.guess
    base = regression_rows.base_of(run_of(excited.recording), robot, guess)
    monkeypatch.setattr(measured_motion, 'LONGEST', 3000)
    monkeypatch.setattr(regression_rows, 'SOME', 100)
    some = regression_rows.SomeRows()
    rows = regression_rows.rows(run_of(excited.recording), robot, base, guess, 0.0, CUTOFF)
    parts = [*some.seen(rows)]
    assert len(parts) == 5
    squares, rows = least_squares.squares_of(parts), measured_motion.joined(parts)
    assert len(squares.Y) == 33 < len(rows.Y) == squares.count  # 3 joints by 10 parameters, and 3
    left = rows.torque - rows.Y @ (0.9 * TRUTH)
    direct = np.sqrt((left**2).sum(axis=0) / rows.known.sum(axis=0))
    np.testing.assert_allclose(squares.rms(0.9 * TRUTH), direct, rtol=1e-12)
    root = np.linalg.cholesky(least_squares.estimate(squares, TRUTH, TRUTH).weight).T
    flat = (root @ rows.Y).reshape(-1, len(TRUTH))
    values = np.linalg.lstsq(flat, (rows.torque @ root.T).ravel(), rcond=None)[0]
    estimated = least_squares.estimate(squares, TRUTH, TRUTH).values
    np.testing.assert_allclose(estimated, values, rtol=1e-9)
    every = -(-len(rows.time) // 100)
    every = 1 << (every - 1).bit_length()
    assert np.array_equal(some.whole().time, rows.time[::every])


def test_the_nominal_values_do_not_matter(excited):
    robot = excited.nominal.robot
    wrong = robot.parameters._replace(m1=3.0, m2=9.0, mp=6.0, I1=0.2, I2=0.1, Ip=0.2)
    nominal = identified.Nominal(
        robot._replace(parameters=wrong), excited.nominal.friction, excited.nominal.guess
    )
    found = identified.identify(nominal, run_of(excited.recording), CUTOFF)
    assert np.abs(found.fit.values / TRUTH - 1.0).max() < 0.01
    chosen = found.robot.robot
    assert min(chosen.values()) > 0.0
    assert chosen['lc1'] < wrong.l1 and chosen['lc2'] < wrong.l2
    a = chosen['I1'] + chosen['m1'] * chosen['lc1'] ** 2 + chosen['m2'] * 0.4**2
    assert abs((a + chosen['mp'] / 3.0 * 0.4**2) / TRUTH[0] - 1.0) < 0.01


def test_95_percent_intervals_cover_table_1_in_90_to_99_of_100_noisy_motions(excited):
    rng = np.random.default_rng(1)
    begin = (part[:8000] for part in vars(excited.recording).values())
    begun = SimpleNamespace(recording=MeasuredMotion(*begin))
    robot, guess = excited.nominal.robot, excited.nominal.guess
    base = regression_rows.base_of(run_of(excited.recording), robot, guess)
    inertia = excited.nominal.inertia
    scale = base.scale(inertia, excited.nominal.friction)
    covered = np.zeros(len(TRUTH), int)
    for _ in range(100):
        recorded = noisy(begun, rng, 5e-5, 0.5)
        rows = [*regression_rows.rows(run_of(recorded), robot, base, guess, 0.0, CUTOFF)]
        squares = least_squares.squares_of(rows)
        found = least_squares.estimate(squares, 0.9 * TRUTH, scale)
        fit = least_squares.with_uncertainty(found, squares, scale, rows)
        half = fit.interval * fit.standard_errors
        covered += np.abs(fit.values - TRUTH) <= half
    assert covered.min() >= 90 and covered.max() <= 99, covered
    assert half.max() < 0.1  # and they say something


def late(recording, samples):
    """The recording of a robot whose positions are told some samples late."""
    count = len(recording.time) - samples
    return MeasuredMotion(
        recording.time[samples:],
        recording.position[:count],
        recording.effort[samples:],
        recording.usable[samples:],
    )


# Joints 1 to 3: a constant torque; dry friction by load; less dry friction at rest.
MORE = {
    'friction.offset': [0.6, 0.0, 0.0], 'friction.load': [0.0, 0.15, 0.0],
    'friction.stribeck': [0.0, 0.0, -0.4], 'friction.stribeck_velocity': 0.2,
}  # fmt: skip


def test_friction_that_pays_is_found_and_no_other(excited):
    rng = np.random.default_rng(6)
    assert identify(excited, noisy(excited, rng)).choice.saved == {}
    case = motion(**MORE)
    case.nominal = excited.nominal
    found = identify(case, noisy(case, rng))
    assert found.base.names[len(TRUTH) :] == ('offset1', 'load2', 'stribeck3')
    wanted = np.append(TRUTH, [0.6, 0.15, -0.4])
    half = found.fit.interval * found.fit.standard_errors
    assert (np.abs(found.fit.values - wanted) <= 1.5 * half).all()
    assert (half[len(TRUTH) :] < [0.05, 0.01, 0.1]).all()
    assert found.robot.friction.stribeck_velocity == pytest.approx(0.2, rel=0.2)
    assert all(saved - width > 0.002 for saved, width in found.choice.saved.values())
    written = config.flat(readable.parameter_groups(found, {}))
    assert written['friction.offset'] == pytest.approx([0.6, 0.0, 0.0], abs=0.05)
    assert written['friction.load'][0] == 0.0 and written['friction.stribeck'][:2] == [0.0, 0.0]


@pytest.mark.parametrize('seed', range(3))
def test_intervals_allow_for_friction_that_does_not_pay(seed):
    """Gravity of the first joint looks like the constant torque that is left out."""
    words = {'trajectory.shape': 'excitation'}
    case = motion('serial_2r_circle', **words, **{'friction.offset': [0.1, 0.0]})
    offset = case.nominal.friction._replace(offset=(0.0, 0.0))
    case.nominal = replace(case.nominal, friction=offset)
    found = identify(case, noisy(case, np.random.default_rng(seed), 5e-5, 0.5))
    assert 'offset1' not in found.base.names
    w = [*found.base.names].index('w')
    error, alone = abs(found.fit.values[w] - 1.5), found.fit.standard_errors[w]
    assert 5.0 * alone < error < found.fit.interval[w] * alone < 0.03


def test_friction_of_the_configuration_stays_and_no_gear_drives(excited):
    """A small offset that is known; a load that would be negative; too short a motion."""
    friction = excited.nominal.friction._replace(offset=(0.01, 0.0, 0.0))
    case = SimpleNamespace(nominal=replace(excited.nominal, friction=friction))
    rng, sign = np.random.default_rng(7), np.sign(excited.run.velocity[:, 1])
    driven = excited.recording.effort.copy()
    driven[:, 1] -= 0.1 * np.abs(driven[:, 1]) * sign
    found = identify(case, noisy(SimpleNamespace(recording=replaced(excited, effort=driven)), rng))
    assert 'offset1' in found.base.names and 'load2' not in found.base.names
    short = identify(case, begun(excited, 4000))
    assert short.base.names == (*TABLE_1, 'offset1') and not short.choice.saved
    assert short.before[-1] == 0.01


def test_joints_that_stand_still_have_no_part_in_the_choice():
    """Three of five: their rates are exactly zero, and so is their torque's share."""
    sine = np.array([0.3, 0.2, 0.1, 0.05, 0.05] * 5)
    sine[5:20] = 0.0
    shape = {'trajectory.shape': 'excitation', 'excitation.cosine': [0.0] * 25}
    shape |= {'law': 'computed_torque', 'plant.initial_pose': [0.0] * 5}
    case = motion('axes_step', **shape, **{'excitation.sine': sine.tolist()})
    recorded = run_of(held(case, [1, 2, 3]))
    found = identified.identify(case.nominal, recorded, CUTOFF, hold_out=1.0 / 3.0)
    assert np.isnan(found.held_out.share[[1, 2, 3]]).all()
    assert (found.held_out.share[[0, 4]] < 0.01).all()
    json = readable.as_data(found, identified.compare(found), list('abcde'))
    assert json['held_out']['share'][1:4] == [None] * 3


def test_the_robot_of_the_file_has_the_friction_that_was_found(excited):
    """Torques of its plant along another motion are those of the true robot."""
    true = motion('paper_circle', **{'circle.rate': 4.0, **MORE})
    case = motion(**MORE)
    case.nominal = excited.nominal
    found = identify(case)
    written = config.flat(readable.parameter_groups(found, {}))
    robot = {key: value for key, value in written.items() if key.startswith('robot.')}
    robot |= {key.replace('robot.', 'true_robot.'): value for key, value in robot.items()}
    again = motion('paper_circle', **{'circle.rate': 4.0, **written, **robot})
    left = np.sqrt(np.mean((again.run.effort - true.run.effort)[500:] ** 2, axis=0))
    assert (left < 0.02 * np.sqrt(np.mean(true.run.effort**2, axis=0))).all()


@pytest.mark.parametrize('samples', [0, 1, 5])
def test_a_delay_of_the_positions_is_found(samples, excited):
    found = identify(excited, late(excited.recording, samples))
    assert found.delay.counts == (samples > 0)
    assert found.delay.value == pytest.approx(1e-3 * samples, abs=5e-5)
    assert np.abs(found.fit.values / TRUTH - 1.0).max() < 0.01


def test_intervals_hold_the_truth_though_positions_are_late_and_noisy(excited):
    rng = np.random.default_rng(2)
    covered = 0
    for samples in (0, 1, 2, 3, 5) * 2:
        found = identify(excited, late(noisy(excited, rng, 5e-5, 0.5), samples))
        half = found.fit.interval * found.fit.standard_errors
        covered += (np.abs(found.fit.values - TRUTH) <= half).sum()
        assert abs(found.delay.value - 1e-3 * samples) < 2.0 * found.delay.half_width
    assert covered >= 90


def test_a_slow_motion_does_not_tell_a_delay():
    case = motion('paper_circle', duration=6.0)
    found = identify(case, late(noisy(case, np.random.default_rng(3), 5e-5, 0.5), 3))
    assert not found.delay.counts and found.delay.half_width > 1e-3
    assert 'does not tell whether positions are late' in tables.text(readable.parts(found))
    late_by = replace(found.delay, value=3e-3, half_width=1e-4, counts=True)
    shown = tables.text(readable.parts(replace(found, delay=late_by)))
    assert 'positions are late: 3 +- 0.1 ms after torques of the same stamp' in shown


@pytest.mark.parametrize(
    ('scenario', 'changes', 'truth'),
    [
        (
            'axes_step',
            {'plant.initial_pose': [0.0] * 5},
            {f'inertia{k}': v for k, v in enumerate([0.12, 0.2, 0.28, 0.38, 0.5], start=1)},
        ),
        (
            'serial_2r_circle',
            {'plant.initial_pose': [0.3, 0.2]},
            {
                'a': 0.0225 + 3.0 * 0.15**2 + 3.5 * 0.3**2,
                'b': 0.01875 + 2.5 * 0.15**2 + 0.3**2,
                'h': 0.3 * (2.5 * 0.15 + 0.3),
                'w': 3.0 * 0.15 + 3.5 * 0.3,
            },
        ),
    ],
)
def test_other_robots(scenario, changes, truth):
    case = motion(scenario, **{'trajectory.shape': 'excitation', **changes})
    found = identify(case)
    values = dict(zip(found.base.names, found.fit.values, strict=True))
    for name, value in truth.items():
        assert abs(values[name] / value - 1.0) < 0.01, name
    friction = [case.values['friction.viscous'], case.values['friction.coulomb']]
    assert np.allclose(found.fit.values[len(truth) :], np.ravel(friction), rtol=0.02)


def test_what_a_motion_does_not_show_is_named_and_stays():
    """Axis 3 is held: nothing of it is known, all of the others."""
    center = [0.0] * 5
    sine = [0.3, 0.2, 0.1, 0.05, 0.05] * 5
    sine[10:15] = [0.0] * 5
    case = motion(
        'axes_step',
        **{
            'law': 'computed_torque',  # which does not couple the axes
            'trajectory.shape': 'excitation',
            'excitation.sine': sine,
            'excitation.cosine': [0.0] * 25,
            'plant.initial_pose': center,
        },
    )
    found = identify(case, held(case, [2]))
    unknown = {'inertia3', 'viscous3', 'coulomb3'}
    assert {name for name, _ in found.poor} == unknown
    for name, value, before in zip(found.base.names, found.fit.values, found.before, strict=True):
        assert (value == before) if name in unknown else abs(value / before - 1.0) < 0.02


def test_a_slow_circle_tells_little_of_the_inertia():
    case = motion('paper_circle', duration=6.0)
    rng = np.random.default_rng(2)
    found = identify(case, noisy(case, rng, 1e-5, 0.5))
    assert any('Ip' in name for name, _ in found.poor)
    assert not any(name.startswith('viscous1') for name, _ in found.poor)


def test_a_robot_that_cannot_be_built_is_replaced_by_the_nearest(excited):
    """A torque along the velocity, as if friction drove the robot: there is no such friction."""
    driven = excited.recording.effort - 3.0 * excited.run.velocity
    found = identify(excited, replaced(excited, effort=driven))
    assert found.robot.active and found.robot.misfit > 1.0
    assert found.fit.values[4:7].max() < 0.0  # the estimates are reported as they are
    assert all(0.0 <= each < 1e-6 for each in found.robot.friction.viscous)
    module, parameters = excited.nominal.robot.module, excited.nominal.robot.parameters
    module.validate(parameters._replace(**found.robot.robot))


def test_torques_of_another_motion_are_predicted(excited):
    robot = excited.nominal.robot
    wrong = robot.parameters._replace(m1=4.0, m2=8.5)
    friction = excited.nominal.friction
    nominal = identified.Nominal(robot._replace(parameters=wrong), friction, excited.run.pose[0])
    found = identified.identify(nominal, run_of(excited.recording), CUTOFF)
    circle = motion('paper_circle', **{'circle.rate': 4.0, 'circle.radius': 0.06})
    result = identified.predict(found, run_of(circle.recording), circle.run.pose[0], CUTOFF)
    assert (result.error < 0.02 * result.size).all()
    assert (result.nominal_error > 3.0 * result.error).all()


def test_jitter_and_lost_states_do_not_matter(excited):
    rng = np.random.default_rng(4)
    kept = rng.random(len(excited.recording.time)) > 0.02
    time = excited.recording.time + rng.uniform(-2e-4, 2e-4, len(kept))
    dense = excited.recording.time
    position = np.column_stack([np.interp(time, dense, row) for row in excited.run.position.T])
    found = identify(
        excited,
        MeasuredMotion(
            time[kept], position[kept], excited.run.effort[kept], np.ones(kept.sum(), bool)
        ),
    )
    assert np.abs(found.fit.values / TRUTH - 1.0).max() < 0.02


def test_the_effort_acted_before_its_state(excited):
    """A shift of the efforts is found to a twentieth of a period: the alignment is right."""
    late = replaced(excited, effort=np.roll(excited.run.effort, 1, axis=0))
    assert identify(excited).delay.value == pytest.approx(0.0, abs=5e-5)
    assert identify(excited, late).delay.value == pytest.approx(-1e-3, abs=5e-5)


def log_of(case, **parts):
    """What the recording is made of."""
    stamps = 10**9 + np.arange(len(case.run.position)) * 10**6
    arrays = {'stamps': stamps, 'position': case.run.position, 'effort': case.run.effort} | parts
    time = (arrays['stamps'] - 10**9) / 1e9
    joints = ('joint1', 'joint2', 'joint3')
    return SimpleNamespace(joints=joints, units=HINGES, time=time, **arrays)


LIMIT = np.full(3, 200.0)


def test_of_a_run_in_windows_no_window_stays(excited, monkeypatch):
    """Whoever looks at the windows keeps little of them, and copies, not views of all."""
    for module in (measured_motion, motor_lag, motor_lag):
        monkeypatch.setattr(module, 'LONGEST', 1500)
    monkeypatch.setattr(limits, 'HELD', 1000)
    whole, made, most = log_of(excited), [], []

    def windows():
        for begin in range(0, len(whole.time), 500):
            columns = {
                name: getattr(whole, name)[begin : begin + 500].copy()
                for name in ('stamps', 'time', 'position', 'effort')
            }
            made.extend(weakref.ref(column) for column in columns.values())
            shared = {'answer': columns['effort'], 'velocity': columns['position']}
            shared |= {'reference_velocity': columns['position'], 'has_efforts': True}
            yield SimpleNamespace(joints=whole.joints, units=whole.units, **columns, **shared)
            del columns, shared
            most.append(sum(column() is not None for column in made))

    still, stretch = motor_lag.Resting(1e-3), motor_lag.LongestStretch(1e-3)
    for log in windows():
        still.add(log)
        stretch.add(log)
    assert stretch.lag() and max(most) <= 16
    found = measured_motion.RunMotion(windows(), 1e-3, (), LIMIT)
    result = identified.identify(excited.nominal, found, CUTOFF)
    assert np.abs(result.fit.values / TRUTH - 1.0).max() < 0.01
    assert len(most) == 2 * 31 and max(most) <= 16  # each is read once


def test_a_motion_for_which_the_disk_has_no_room_costs_one_line(excited, monkeypatch):
    with Path('/dev/full').open('wb+', buffering=0) as full:
        monkeypatch.setattr(limits.tempfile, 'SpooledTemporaryFile', lambda _: full)
        with pytest.raises(InputError, match=r'cannot keep the motion .* TMPDIR'):
            motion_of(log_of(excited), (), LIMIT)


def test_motion_after_a_fault_or_with_saturated_motors_is_left_out(excited):
    statuses = [
        ControllerStatus(10**9, 's_fotsmc', 'none', '', ()),
        ControllerStatus(6 * 10**9, 's_fotsmc', 'emergency_stop', 'emergency stop', ()),
        ControllerStatus(7 * 10**9, 's_fotsmc', 'none', '', ()),
    ]
    effort = excited.run.effort.copy()
    effort[8000:8500, 1] = 200.0
    effort[5000:6000] = 77.0  # as after an emergency stop
    found = motion_of(log_of(excited, effort=effort), statuses, LIMIT)
    assert found.left_out == ('1 s: after a fault', '0.5 s: motors saturated')
    result = identify(excited, found)
    assert np.abs(result.fit.values / TRUTH - 1.0).max() < 0.01
    assert result.squares.duration < 13.0


def test_a_gap_separates_two_stretches(excited):
    kept = np.ones(len(excited.run.position), bool)
    kept[7000:7600] = False
    parts = {
        name: value[kept] for name, value in vars(log_of(excited)).items() if name not in
        ('joints', 'units', 'time')
    }  # fmt: skip
    found = motion_of(log_of(excited, **parts), (), LIMIT)
    assert found.left_out == ('0.601 s: a gap between states',)
    pieces = [part.time for part in measured_motion.stretches(found, 100)]
    assert [len(time) for time in pieces] == [7000, 7401]
    assert [time[0] for time in pieces] == [0.0, 7.6]
    assert np.abs(identify(excited, found).fit.values / TRUTH - 1.0).max() < 0.01


@pytest.mark.parametrize(
    ('parts', 'message'),
    [
        ({'effort': np.zeros((15001, 3))}, 'effort of joint1, joint2, joint3 is zero'),
        ({'position': np.ones((15001, 3))}, 'the robot stood still'),
    ],
)
def test_a_recording_without_torques_or_motion_is_refused(excited, parts, message):
    with pytest.raises(BagError, match=message):
        motion_of(log_of(excited, **parts), (), LIMIT)


def test_too_short_a_motion_is_refused_with_the_reason(excited):
    statuses = [ControllerStatus(15 * 10**8, 's_fotsmc', 'speed', 'too fast', ())]
    found = motion_of(log_of(excited), statuses, LIMIT)
    with pytest.raises(BagError, match=r'too little motion .* of 15 s; 14\.5 s: after a fault'):
        identify(excited, found)


@pytest.mark.parametrize('cutoff', [0.0, -1.0, 101.0])
def test_a_cutoff_that_does_not_fit_is_refused(excited, cutoff):
    with pytest.raises(InputError, match='--cutoff must be positive and at most 100 Hz'):
        identify(excited, cutoff=cutoff)


def test_states_at_100_hz_take_the_default_bandwidth(excited):
    """Their stamps are a nanosecond off, so that a tenth of the rate is a little below 10 Hz."""
    kept = excited.recording
    slow = MeasuredMotion(
        kept.time[::10] * (1.0 + 1e-7),
        *(rows[::10] for rows in (kept.position, kept.effort, kept.usable)),
    )
    assert regression_rows.highest_cutoff(run_of(slow)) < CUTOFF
    assert identify(excited, slow).squares.duration > 13.0


def test_a_robot_without_a_linear_model_is_refused(excited):
    robot = excited.nominal.robot._replace(name='mine', module=SimpleNamespace(linear_model=None))
    nominal = identified.Nominal(robot, excited.nominal.friction, excited.nominal.guess)
    with pytest.raises(InputError, match='the robot mine cannot be identified'):
        identified.identify(nominal, run_of(excited.recording), CUTOFF)
