"""The approach against the boundary conditions that define it."""

import numpy as np
import pytest
from assembly import simulate

from parallel_robot_control.approach import (
    BACK,
    CONTINUES,
    START,
    ApproachMemory,
    ApproachParameters,
    approached,
)
from parallel_robot_control.contract import JointReference
from parallel_robot_model.compiler import Struct, kernel, vector, zeros_of

DT = 1e-3
REFERENCE = JointReference(*map(vector, ([0.4, -0.2], [0.3, 0.1], [-1.0, 2.0])))
OFFSET, RATE = np.array([0.02, -0.05]), np.array([0.3, -0.4])


@kernel
def _approached(parameters, memory, begins, reference, position, velocity, dt):
    return approached(parameters, memory, begins, reference, position, velocity, dt)


def courses(duration, count, begin=START, way_back=1.0, acceleration=1.0):
    """What is added to a reference that stands still, its rate and acceleration."""
    parameters, rows = ApproachParameters(duration, way_back, acceleration), []
    memory = Struct(zeros_of(ApproachMemory, vector(OFFSET)))
    position = vector(np.asarray(REFERENCE.position) + OFFSET)
    velocity = vector(np.asarray(REFERENCE.velocity) + RATE)
    for _ in range(count):
        joined = _approached(parameters, memory, begin, REFERENCE, position, velocity, DT)
        position = velocity = vector([np.nan, np.nan])  # only the first state counts
        begin = CONTINUES
        rows.append(
            [np.asarray(a) - np.asarray(b) for a, b in zip(joined, REFERENCE, strict=True)]
        )
    return np.array(rows)


def quintic(duration, offset, rate, bent):
    """Coefficients of the polynomials with such a begin and nothing at the end, by joints."""
    powers = np.arange(6)

    def rows(t):
        yield t**powers
        yield powers * t ** np.maximum(powers - 1, 0)
        yield powers * (powers - 1) * t ** np.maximum(powers - 2, 0)

    ends = np.array([*rows(0.0), *rows(duration)])
    return np.linalg.solve(ends, [offset, rate, bent, 0 * rate, 0 * rate, 0 * rate])


def faded(duration, offset, rate, count=130, at_once=0.0):
    """An offset and a rate faded over a duration, at each sample; braked at once or gently."""
    t = np.minimum(DT * np.arange(count), duration)[:, np.newaxis]
    bent = -at_once * rate / duration
    return sum(c * t**k for k, c in enumerate(quintic(duration, offset, rate, bent)))


def test_the_offset_is_faded_by_the_quintic():
    found = courses(0.1, 130)
    assert np.allclose(found[:, 0], faded(0.1, OFFSET, RATE), atol=1e-12)
    assert np.allclose(np.gradient(found[:, 0], DT, axis=0)[1:98], found[1:98, 1], atol=2e-2)
    assert np.allclose(np.gradient(found[:, 1], DT, axis=0)[2:97], found[2:97, 2], atol=1.0)
    assert not found[100:].any()


def test_on_a_way_back_the_rate_is_braked_with_the_acceleration_that_is_given():
    found = courses(0.0, 230, BACK, 0.2, 40.0)
    braking = 3.527 * 0.4 / 40.0
    turned = faded(braking, 0 * OFFSET, RATE, 230, at_once=3.0)
    gentle = 2.0 * np.sqrt(5.774 * 0.05 / 40.0)  # s, for a small offset
    assert np.allclose(found[:, 0], faded(gentle, OFFSET, 0 * RATE, 230) + turned, atol=1e-12)
    assert np.allclose(np.gradient(found[:, 0], DT, axis=0)[1:-1], found[1:-1, 1], atol=2e-2)
    assert np.allclose(np.gradient(found[:, 1], DT, axis=0)[1:30], found[1:30, 2], atol=1.0)
    assert np.abs(np.diff(turned, 2, axis=0)).max() / DT**2 == pytest.approx(40.0, rel=0.01)
    far = courses(0.0, 130, BACK, 0.01, 40.0)[:, 0]
    assert not far[round(np.sqrt(5.774 * 0.05 / 40.0) / DT) + 1 :].any() and far[80].any()


def test_without_a_duration_the_reference_stays_as_it_is():
    assert not courses(0.0, 3).any()


@pytest.mark.parametrize('law', ['s_fotsmc', 'pid', 'lqg_tracking'])
def test_the_start_beside_the_circle_needs_no_torque_beyond_that_of_the_motion(law):
    run = simulate(duration=2.0, overrides={'law': law, 'approach.duration': 0.4})
    jump = simulate(duration=2.0, overrides={'law': law})
    assert np.abs(run.out.effort).max() < 6.0 < np.abs(jump.out.effort).max()
    assert np.abs(run.out.effort[1]).max() < 1.0
