"""Mechanisms as plain Python give the same bits: nothing depends on how a processor computes."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from mjcf_machines import made, samples

from parallel_robot_model.compiler import INTERPRETED
from parallel_robot_model.mechanisms.closing import close
from parallel_robot_model.mechanisms.dynamics import model
from parallel_robot_model.mechanisms.faults import FOUND
from parallel_robot_model.mechanisms.free_motion import acceleration
from parallel_robot_model.mechanisms.margins import margins
from parallel_robot_model.mechanisms.pose_motion import pose_motion
from parallel_robot_model.mechanisms.pose_solving import solve_pose
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
        acceleration(m, w, v, torque, a)
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
