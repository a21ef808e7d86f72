"""Kernels as plain Python, for a debugger: the numbers of the compiled ones within rounding."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from custom_law import LAW

from parallel_robot_control.configuration import resolve
from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.cycle import cycle_of
from parallel_robot_control.laws import s_fotsmc
from parallel_robot_control.safety.limiting import When
from parallel_robot_model.compiler import (
    INTERPRETED,
    Vector,
    clip,
    multiply,
    select,
    solve,
    vector,
)
from parallel_robot_model.robots.contract import Model
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.configuration import assemble, configure

STEPS = 20
WORDS = 'import sys; from test_interpreted import save; save(sys.argv[1])'


def vectors():
    """What Python computes otherwise with arrays: rows, indices, selection, names bound anew."""
    x, M = vector((1.0, -2.0, 0.5)), vector([[4.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 2.0]])
    before = x
    x += 1.0
    chosen = select(x > 0.0, M, 2.0 * M)
    found = (x, before, x * M, M @ x, x[7] + M[4, -1], chosen, clip(x, -0.5, 0.5), x / 0.0)
    return [*found, multiply(M, x), solve(M, x)]


def numbers():
    """Numbers of one law, one cycle and one loop, by name."""
    made = assemble(
        configure(resolve('paper_circle', {'law': 's_fotsmc', 'duration': STEPS * 1e-3}))
    )
    setup = made.control.setup
    q, rate = vector((0.1, 0.2, -0.3)), vector((0.5, -0.4, 0.2))
    desired = JointReference(q + 0.01, rate, 0.0 * q)
    model = Model(vector(np.eye(3)), 0.1 * vector(np.eye(3)), 0.0 * q)
    gains, memory = made.control.law.gains, made.control.law.memory.first
    law = s_fotsmc.update(gains, model, desired, Feedback(q, rate, q, 0.0 * q), memory, 1e-3)
    reference = made.trajectory.sample(np.arange(STEPS + 1) * 1e-3)
    start = JointReference(*(vector(row[0]) for row in reference[:3]))
    run_cycle = cycle_of(setup)
    cycle = run_cycle(setup, start, start.position, rate, 0.0 * rate, When(0, 0.0, 1e-3))
    pose = setup.memory.state.pose
    loop = run(made.control, made.plant, reference, 1e-3)
    values = [law.torque, law.sliding_variable, cycle.torque, pose, loop.pose]
    return [*values, loop.command, loop.telemetry_rows, loop.fault]


def save(path):
    """Write the numbers of kernels as Python."""
    assert INTERPRETED and type(vectors()[0]) is Vector
    np.savez(path, *vectors(), *numbers())


def test_as_python_they_are_the_same(tmp_path):
    path = tmp_path / 'numbers.npz'
    folder = Path(__file__).parent
    environment = {'NUMBA_DISABLE_JIT': '1', 'PYTHONPATH': f'{folder.parent}{os.pathsep}{folder}'}
    words = [sys.executable, '-W', 'error::RuntimeWarning', '-c', WORDS, str(path)]
    subprocess.run(words, env={**os.environ, **environment}, check=True)
    with np.load(path) as found:
        python = list(found.values())
    compiled = numbers()
    own, rest = python[: -len(compiled)], python[-len(compiled) :]
    for one, other in zip(rest, compiled, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    assert np.array_equal(own[0], [2.0, -1.0, 1.5]) and np.array_equal(own[1], [1.0, -2.0, 0.5])
    assert np.array_equal(own[2][1], [-1.0, -3.0, -0.5])  # an element counts for a row
    assert own[4] == -1.0 + 0.5 and np.array_equal(own[5][1], [2.0, 6.0, 1.0])
    assert np.array_equal(own[6], [0.5, -0.5, 0.5]) and np.array_equal(
        own[7], [np.inf, -np.inf, np.inf]
    )
    assert np.array_equal(own[3], own[8])
    matrix = [[4.0, 1.0, 0.0], [1.0, 3.0, 0.5], [0.0, 0.5, 2.0]]
    np.testing.assert_allclose(np.array(matrix) @ own[9], own[0], rtol=1e-12)


def test_a_law_that_was_never_compiled_stops_in_its_update(tmp_path):
    own = tmp_path / 'fresh.py'
    text = LAW.replace('    e = ref', f'    breakpoint()  # {tmp_path}\n    e = ref')
    own.write_text(text)
    environment = {'NUMBA_DISABLE_JIT': '1', 'PYTHONPATH': str(Path(__file__).parents[1])}
    words = ['simulate', 'paper_circle', '--law', str(own), '--duration', '0.001', '--out', 'bag']
    done = subprocess.run(
        [sys.executable, '-m', 'parallel_robot', *words],
        input='p gains\nn\np e.shape\n' + 'c\n' * 20,
        env={**os.environ, **environment},
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert 'Kp=' in done.stdout and '(Pdb) (3,)' in done.stdout
    assert (tmp_path / 'bag').is_dir()
