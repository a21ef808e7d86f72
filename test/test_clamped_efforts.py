"""What is told of efforts that stay below the commands."""

import re

import numpy as np
import pytest
from rig import Rig

from parallel_robot_control.safety.clamped_efforts import ClampedEfforts
from parallel_robot_model.common.units import HINGES, JointUnits

TOLERANCE = 0.1  # N m
RISE = 0.004 * np.arange(-100, 200)  # N m, from one look to the next; then it is held
TORQUE = np.concatenate([RISE, np.full(20, RISE[-1])])
LIMIT = 0.5  # N m


def told(effort, torque=TORQUE, units=HINGES):
    """Of two joints, of which the first does as it should."""
    looked = ClampedEfforts(('first', 'second'), [TOLERANCE, TOLERANCE], units)
    for acts, asked in zip(effort, torque, strict=True):
        looked.note(np.array([asked, acts]), np.array([asked, asked]), np.zeros(2))
    return looked.warning()


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize(('units', 'unit'), [(HINGES, 'N m'), (JointUnits((True, True)), 'N')])
def test_a_limit_below_the_commands_is_named(sign, units, unit):
    text = told(np.clip(sign * TORQUE, -LIMIT, LIMIT), sign * TORQUE, units)
    assert text.startswith(
        f'efforts of second stay at {sign * LIMIT:g} {unit} where {sign * RISE[-1]:.3g} is '
        'commanded: a limit below safety.torque_limit? (enforce_command_limits, <limit effort>'
    )


@pytest.mark.parametrize(
    'effort',
    [
        TORQUE,
        0.0 * TORQUE,  # off
        0.5 * TORQUE,  # another unit, or a weak motor
        np.nan * TORQUE,  # not reported
        np.where(TORQUE < LIMIT, TORQUE, LIMIT + 0.2 * np.sin(100.0 * TORQUE)),
        np.where(TORQUE < 0.7, TORQUE, LIMIT),  # it has been higher
    ],
    ids=['obeys', 'off', 'share', 'none', 'swings', 'was_higher'],
)
def test_other_motors_that_do_not_apply_it_are_not_called_limited(effort):
    assert told(effort) == ''


def test_of_a_single_state_nothing_is_told():
    assert told([LIMIT], [1.0]) == ''


def explained(apply, law, begin=0):
    """What is told of the fault when torques act as `apply` has them, from a sample on."""
    rig, random = Rig(law=law), np.random.default_rng(0)
    applied = np.zeros(3)
    while not rig.controller.fault:
        seen, noise = rig.measured(), 2e-3 * random.normal(size=3)
        asked = rig.ask(seen._replace(velocity=seen.velocity + noise, effort=applied)).torque
        applied = apply(asked, seen.velocity) if rig.k >= begin else asked
        rig.simulator.advance(applied)
        rig.k += 1
    return rig.controller.explain(rig.controller.status.fault).text


@pytest.mark.parametrize('law', ['s_fotsmc', 'pid'])
def test_a_limit_of_speed_below_that_of_the_motion_is_named(law):
    def cut(torque, rate):
        """As the manager of ros2_control does it."""
        return np.where((np.abs(rate) > 0.05) & (rate * torque > 0.0), 0.0, torque)

    text = explained(cut, law)
    assert re.search(
        r': efforts of joint\d come and go at 0\.0[456]\d* rad/s: a limit of speed', text
    )
    assert text.endswith('<limit> of the URDF)')


@pytest.mark.parametrize('joint', [0, 1, 2, slice(None)])
def test_motors_that_are_off_while_the_robot_moves_are_under_no_limit_of_speed(joint):
    def off(torque, _):
        torque = torque.copy()
        torque[joint] = 0.0
        return torque

    assert explained(off, 's_fotsmc', 200).endswith('the commanded torque')
