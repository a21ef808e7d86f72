"""Accelerations, inertia and bias against Pinocchio, which closes loops by contacts."""

import numpy as np
import pytest
from mjcf_machines import MACHINES, made, samples

from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.closures import joint_rates
from parallel_robot_model.mechanisms.dynamics import free_acceleration, model
from parallel_robot_model.mechanisms.mechanism import FOUND

pin = pytest.importorskip('pinocchio', reason='pip install pin')
from pinocchio_tree import contacts, tree  # noqa: E402 needs it

LOOPS = [name for name in MACHINES if name not in ('arm', 'coupled', 'wrist', 'universal')]


def states(machine, count):
    rng = np.random.default_rng(11)
    for q in samples(machine, count):
        yield q, *rng.normal(size=(2, machine.n))


def test_arm_has_the_inertia_and_bias_of_pinocchio():
    machine = made('arm')
    m, w = machine.boxed()
    known, M, Q, gravity = tree(m), np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
    data = known.createData()
    for q, v, _ in states(machine, 10):
        assert close(m, w, q) == FOUND
        model(m, w, v, M, Q, gravity)
        pin.crba(known, data, q)
        full = np.triu(data.M) + np.triu(data.M, 1).T
        np.testing.assert_allclose(M, full, atol=1e-13)
        bias = pin.nonLinearEffects(known, data, q, v)
        np.testing.assert_allclose(Q @ v + gravity, bias, atol=1e-12)


@pytest.mark.parametrize('name', LOOPS)
def test_accelerations_are_those_of_pinocchio(name):
    machine = made(name)
    m, w = machine.boxed()
    known = tree(m)
    data, loops = known.createData(), contacts(m, known)
    loop_data = pin.StdVec_RigidConstraintData()
    loop_data.extend(loop.createData() for loop in loops)
    settings = pin.ProximalSettings(1e-13, 1e-10, 100)
    pin.initConstraintDynamics(known, data, loops, loop_data)
    out = np.zeros(machine.n)
    for q, v, torque in states(machine, 8):
        assert close(m, w, q) == FOUND
        joint_rates(m, w, v)
        force = np.zeros(len(m.parent))
        force[m.actuated] = torque
        expected = pin.constraintDynamics(
            known, data, w.all, np.array(w.rate), force, loops, loop_data, settings
        )
        free_acceleration(m, w, v, torque, out)
        size = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(out, expected[m.actuated], rtol=0.0, atol=1e-7 * size)
