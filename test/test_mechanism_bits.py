"""Mechanisms as plain Python give the same bits: nothing depends on how a processor computes."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mjcf_machines import MACHINES, made, samples

from parallel_robot_model.compiler import INTERPRETED, Boxed, kernel
from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.closures import update_frames
from parallel_robot_model.mechanisms.dynamics import free_acceleration, model
from parallel_robot_model.mechanisms.margins import margins
from parallel_robot_model.mechanisms.mechanism import FOUND, NO_COORDINATE, layout
from parallel_robot_model.mechanisms.pose_solving import pose_motion, solve_pose
from parallel_robot_model.mechanisms.tool import tool_motion

WORDS = 'import sys; from test_mechanism_bits import save; save(sys.argv[1])'


def numbers(name):
    """What the kernels find at a few states, shape (K,)."""
    machine = made(name)
    m, w = machine.boxed()
    n, found = machine.n, []
    for q in samples(machine, 2):
        v, torque = np.linspace(-1.0, 1.0, n), np.linspace(3.0, -5.0, n)
        M, Q, gravity, a, pose, rate = *np.zeros((2, n, n)), *np.zeros((4, n))
        assert close(m, w, q) == FOUND
        model(m, w, v, M, Q, gravity)
        free_acceleration(m, w, v, torque, a)
        tool_motion(m, w, v, pose, rate)
        found += [M, Q, gravity, a, pose, rate, w.all.copy(), margins(m, w)]
        assert solve_pose(m, w, pose + 1e-3) == FOUND
        joints = np.zeros((3, n))
        assert pose_motion(m, w, rate, rate, *joints) == FOUND
        found.append(joints)
    return np.concatenate([np.ravel(x) for x in found])


def save(path):
    """Write the numbers of kernels as Python."""
    assert INTERPRETED
    np.savez(path, numbers('welded_hexapod'), numbers('five_bar'))


def test_as_python_they_are_the_same(tmp_path):
    path = tmp_path / 'numbers.npz'
    folder = Path(__file__).parent
    environment = {'NUMBA_DISABLE_JIT': '1', 'PYTHONPATH': f'{folder.parent}{os.pathsep}{folder}'}
    words = [sys.executable, '-c', WORDS, str(path)]
    subprocess.run(words, env={**os.environ, **environment}, check=True)
    with np.load(path) as found:
        hexapod, five_bar = found.values()
    assert np.array_equal(hexapod, numbers('welded_hexapod'))
    assert np.array_equal(five_bar, numbers('five_bar'))


@kernel
def placed(m, w):
    """All frames at the positions in `trial`."""
    update_frames(m, w)


@pytest.mark.parametrize('name', MACHINES)
def test_frames_have_the_bits_of_all_their_products(name):
    """Those with ones and zeros are left out."""
    machine = made(name)
    m, w = machine.boxed()
    count, own_layout = len(w.value.trial), w.value.layout
    none = np.zeros(count, np.int64)
    whole = own_layout._replace(along=none + NO_COORDINATE, parallel=none, concentric=none)
    own = {key: getattr(w.value, key).copy() for key in ('rotation', 'origin', 'S', 'trial')}
    other = Boxed(w.value._replace(layout=whole, **own))
    assert (own_layout.along != NO_COORDINATE).any() or own_layout.parallel.any()
    rng = np.random.default_rng(1)
    for _ in range(100):
        w.value.trial[:] = other.value.trial[:] = rng.uniform(-4.0, 4.0, count)
        placed(m, w)
        placed(m, other)
        for key in ('rotation', 'origin', 'S'):
            np.testing.assert_array_equal(getattr(w.value, key), getattr(other.value, key))


def test_an_axis_that_is_nearly_one_of_the_coordinates_is_none_of_them():
    machine = made('five_bar').mechanism
    axis = machine.axis.copy()
    axis[:3] = [1.0, 1e-20, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]
    along = layout(machine._replace(axis=axis)).along
    assert along[:3].tolist() == [NO_COORDINATE, NO_COORDINATE, 1]
