"""Integrals while the torque is limited: they rest, and the way back is short."""

from operator import attrgetter

import numpy as np
import pytest
from assembly import simulated
from rig import Rig
from vectors import on_vectors

from parallel_robot_control import terms
from parallel_robot_control.laws import LAWS
from parallel_robot_model.compiler import Boxed, vector
from parallel_robot_model.configuration import config

unless_saturated = on_vectors(terms.unless_saturated)
unless_any_saturated = on_vectors(terms.unless_any_saturated)
WITH_INTEGRAL = [
    'pid', 'super_twisting', 's_smc',
    's_fotsmc', 'fotsmc', 'adaptive_s_fotsmc', 's_fotsmc_ft',
    'adrc', 'tdc', 'syn_tde_nftsmc', 'continuous_twisting',
    'implicit_s_fotsmc', 'implicit_super_twisting',
]  # fmt: skip
INTEGRALS = {
    'pid': 'integral.value', 'super_twisting': 'integral.value', 's_smc': 'coupling.value',
    'adrc': 'observer.disturbance', 'tdc': 'torque', 'syn_tde_nftsmc': 'torque',
    'continuous_twisting': 'integral.value', 'implicit_super_twisting': 'integral',
}  # fmt: skip
STRONG = ('lqg_tracking', 'calm_tracking')  # else 200 N m at the start
WEAK = 600  # samples for which the motors are too weak


def test_an_integral_that_adds_to_the_excess_rests_and_another_does_not():
    increment, excess = np.array([1.0, -2.0, 3.0]), np.array([5.0, 5.0, 0.0])
    assert unless_saturated(increment, excess).tolist() == [0.0, -2.0, 3.0]
    assert unless_saturated(increment, -excess).tolist() == [1.0, 0.0, 3.0]


def test_integrals_over_differences_rest_together_so_that_their_sum_stays():
    increment = np.array([2.0, -1.0, -1.0])
    assert unless_any_saturated(increment, np.zeros(3)).tolist() == increment.tolist()
    assert not unless_any_saturated(increment, np.array([0.0, -1e-9, 0.0])).any()


def forget_excess(rig):
    rig.controller._state.excess = np.zeros(3)


def limit_torque(rig, limit):
    """Give the kernels another torque limit from now on."""
    core = rig.controller._core
    safety = Boxed(rig.controller.limits._replace(torque_limit=limit))
    setup = Boxed(core.compiled.setup.value._replace(safety=safety))
    rig.controller._core = core._replace(compiled=Boxed(core.compiled.value._replace(setup=setup)))


def weak_at_first(law, deaf):
    """Error from the end of saturation on [rad s], and the largest integral at that end.

    The robot starts 8.6 mm off the circle with motors that are too weak to bring it back. Without
    conditional integration (`deaf`) the law does not learn what was cut off.
    """
    rig = Rig('lockstep', law=law)
    strong = rig.controller.limits.torque_limit
    limit_torque(rig, vector([1.5] * 3))
    errors = []
    for k in range(1400):
        if k == WEAK:
            limit_torque(rig, strong)
            wound_up = attrgetter(INTEGRALS.get(law, 'switching.value'))
            integral = np.abs(wound_up(rig.controller.law.memory.current)).max()
            assert (np.abs(rig.torques) == 1.5).any(axis=1).mean() > 0.5
        if deaf:
            forget_excess(rig)
        sample = rig.step()
        if sample.status.fault:
            return np.inf, integral
        errors.append(np.abs(sample.telemetry.error[0]).max())
    return 1e-3 * sum(errors[WEAK:]), integral


@pytest.mark.parametrize('law', WITH_INTEGRAL)
def test_after_saturation_the_way_back_is_short(law):
    """Less than half of what it would be with an integral that had wound up three times as far."""
    error, integral = weak_at_first(law, deaf=False)
    wound_error, wound_integral = weak_at_first(law, deaf=True)
    assert 3.0 * integral < wound_integral
    assert error < 0.5 * wound_error


@pytest.mark.parametrize('law', WITH_INTEGRAL)
def test_without_saturation_nothing_changes(law):
    """The bits of a law that is never told of an excess."""
    heard, deaf = Rig('lockstep', law=law), Rig('lockstep', law=law)
    for _ in range(200):
        forget_excess(deaf)
        heard.step(), deaf.step()
    assert np.array_equal(heard.torques, deaf.torques)


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('scenario', ['paper_circle', 'paper_line', 'circle_pi12'])
def test_in_the_paper_s_scenarios_no_limit_acts(scenario, law):
    fast = {'approach.duration': 0.4} if law in STRONG else {}
    made = simulated(config.resolve(scenario, {'law': law, 'duration': 12.0, **fast}))
    assert not made.run.active_limits.any() and not made.run.fault.any()
