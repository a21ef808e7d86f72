"""Joints that stick: closed forms of bristles, and another integrator."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_compliance import FREE, H, axes, course
from vectors import on_vectors

from parallel_robot.cli.command_line import main
from parallel_robot_model.robots import joint_load
from parallel_robot_model.robots.joint_load import FrictionParameters
from parallel_robot_model.robots.registry import resolve

INERTIA = np.array([0.03, 0.05])
STIFFNESS, DAMPING, COULOMB, STRIBECK, FALL = 2e3, 5.0, 0.5, 0.3, 0.05
RIGID = {'compliance.stiffness': 0.0, 'compliance.rotor_inertia': 0.0}
STICKS = {
    'friction.coulomb': COULOMB, 'friction.stribeck': STRIBECK, 'friction.stribeck_velocity': FALL,
    'stiction.stiffness': STIFFNESS, 'stiction.damping': DAMPING,
}  # fmt: skip


def moved(torques, **more):
    """Positions and velocities of the axes, shape (N, 2) each."""
    joints, rates, *_ = course(axes(**RIGID, **(STICKS | more)), np.asarray(torques, float))
    return joints, rates


def ramp(end, seconds, hold):
    """A torque that rises to its end and stays there, the same for both axes."""
    rise = np.linspace(0.0, end, round(seconds / H))
    return np.repeat(np.concatenate((rise, np.full(round(hold / H), end)))[:, np.newaxis], 2, 1)


@pytest.mark.parametrize('torque', [0.1, -0.25, 0.45])
def test_a_joint_gives_way_before_it_slides_by_its_closed_form(torque):
    """dz/dq = 1 - stiffness z / g, so that q = -g / stiffness ln(1 - torque / g).

    It does not oscillate, which would carry it on a little at each reversal.
    """
    damped = {'friction.stribeck': 0.0, 'stiction.damping': 60.0}
    joints, rates = moved(ramp(torque, 1.0, 1.0), **damped)
    expected = -COULOMB / STIFFNESS * np.log(1.0 - abs(torque) / COULOMB) * np.sign(torque)
    assert np.abs(rates[-1]).max() < 1e-8
    assert joints[-1] == pytest.approx(expected, rel=1e-3)


def test_the_motors_of_a_described_machine_stick_by_the_same_closed_form():
    """The base of the five-bar lies flat, so that its weight loads no motor."""
    dry, stiff, torque = 0.05, 50.0, np.array([0.02, -0.03])
    sticks = {
        'friction.coulomb': dry, 'friction.stribeck': 0.0, 'stiction.stiffness': stiff,
        'stiction.damping': 1.0,
    }  # fmt: skip
    rise = np.minimum(np.arange(3000) / 2000, 1.0)[:, np.newaxis]
    joints, rates, *_ = course(resolve('five_bar_circle', FREE | sticks), rise * torque)
    expected = -dry / stiff * np.log(1.0 - np.abs(torque) / dry) * np.sign(torque)
    assert np.abs(rates[-1]).max() < 1e-8
    assert joints[-1] - joints[0] == pytest.approx(expected, rel=1e-3)


def test_a_joint_that_sticks_holds_its_load():
    """Without bristles the velocity of such a joint changes its sign for ever."""
    joints, rates = moved(ramp(0.4, 0.1, 2.0))
    assert np.ptp(joints[-1000:], axis=0).max() < 1e-9 and np.abs(rates[-1000:]).max() < 1e-7


def test_a_joint_breaks_away_at_the_static_friction():
    torques = ramp(1.0, 20.0, 0.0)
    _, rates = moved(torques)
    static = COULOMB + STRIBECK
    assert np.abs(rates[torques < 0.95 * static]).max() < 1e-3 < 0.3 * FALL
    assert (np.abs(rates[torques[:, 0] > 1.03 * static]) > FALL).all()


@pytest.mark.parametrize('torque', [1.0, -2.0])
def test_in_steady_motion_it_is_the_curve_of_stribeck(torque):
    viscous = 0.2
    _, rates = moved(ramp(torque, 0.1, 6.0), **{'friction.viscous': viscous})
    curve = FrictionParameters(
        (viscous,) * 2, (COULOMB,) * 2, (STRIBECK,) * 2, FALL, 0.0, *((0.0,) * 2,) * 2
    )
    slides = on_vectors(joint_load.friction_torque)(curve, rates[-1])
    assert slides == pytest.approx(np.full(2, torque), rel=1e-6)


def reference(torques):
    """The same differential equations, solved period by period by an implicit method."""

    def slopes(t, state, torque, inertia):
        _, v, z = state
        g = COULOMB + STRIBECK * np.exp(-((v / FALL) ** 2))
        yields = v - STIFFNESS * abs(v) / g * z
        return v, (torque - STIFFNESS * z - DAMPING * yields) / inertia, yields

    found = np.zeros((len(torques), 2))
    for joint in range(2):
        state = np.zeros(3)
        for k in range(len(torques) - 1):
            given = torques[k, joint], INERTIA[joint]
            solved = solve_ivp(slopes, (0.0, H), state, 'Radau', args=given, rtol=1e-9, atol=1e-12)
            state = solved.y[:, -1]
            found[k + 1, joint] = state[0]
    return found


def test_it_is_what_another_integrator_finds_and_the_nearer_the_finer():
    """Of order 2: sixteen times the steps leave a 256th of the difference, about."""
    t = np.arange(150)[:, np.newaxis] * H
    torques = 1.5 * np.sin(2.0 * np.pi * 10.0 * t) * [1.0, 1.2]
    expected = reference(torques)
    coarse, fine = (
        np.abs(moved(torques, **{'plant.substeps': steps})[0] - expected).max()
        for steps in (10, 160)
    )
    assert coarse < 2e-5 * np.abs(expected).max()
    assert 128.0 < coarse / fine < 512.0


def test_a_joint_without_dry_friction_does_not_stick():
    torques = np.tile([0.1, 0.1], (200, 1))
    joints, _ = moved(torques, **{'friction.coulomb': [0.0, 0.5], 'friction.stribeck': 0.0})
    free = 0.1 / INERTIA[0] * 0.5 * (np.arange(200) * H) ** 2
    np.testing.assert_allclose(joints[:, 0], free, rtol=1e-9, atol=1e-15)
    assert np.abs(joints[:, 1]).max() < 1e-3


def test_one_joint_alone_sticks():
    torques = np.tile([0.1, 0.1], (200, 1))
    one = {'stiction.stiffness': [0.0, STIFFNESS], 'friction.coulomb': [0.05, COULOMB]}
    joints, _ = moved(torques, **one, **{'friction.stribeck': 0.0})
    slides = (0.1 - 0.05) / INERTIA[0] * 0.5 * (np.arange(200) * H) ** 2
    np.testing.assert_allclose(joints[:, 0], slides, rtol=1e-3, atol=1e-7)
    assert np.abs(joints[:, 1]).max() < 1e-3


def test_joints_stick_behind_soft_gears():
    """The rotor winds its spring up to the load that the bristles hold."""
    gear = {'compliance.stiffness': 100.0, 'compliance.rotor_inertia': 0.01}
    more = {'compliance.damping': 2.0, **STICKS, 'friction.stribeck': 0.0}
    joints, _, angle, *_ = course(axes(**(gear | more)), ramp(0.3, 2.0, 1.0))
    bent = -COULOMB / STIFFNESS * np.log(1.0 - 0.3 / COULOMB)
    assert (angle - joints)[-1] == pytest.approx(0.3 / 100.0, rel=1e-6)
    assert joints[-1] == pytest.approx(bent, rel=1e-2)


@pytest.mark.parametrize(
    ('settings', 'reason'),
    [
        (['stiction.stiffness=1e4', 'friction.smoothing=0.01'], 'friction.smoothing must be 0'),
        (['stiction.stiffness=1e14'], 'compliance or stiction is too stiff'),
        (['stiction.stiffness=-1'], 'stiction.stiffness must be at least 0 N m/rad'),
    ],
)
def test_wrong_stiction_costs_one_line(settings, reason, tmp_path, capsys):
    words = [word for each in settings for word in ('--set', each)]
    out = tmp_path / 'bag'
    assert main(['simulate', 'paper_circle', *words, '--duration', '1', '--out', str(out)]) == 2
    err = capsys.readouterr().err
    assert reason in err and err.count('\n') == 1 and not out.exists()
