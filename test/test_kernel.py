"""Kernels: plain IEEE arithmetic, functions as values, and a cache that cannot be stale."""

import os
import stat
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from parallel_robot_model import kernel as module
from parallel_robot_model.kernel import FirstClass, kernel


@kernel
def twice(x):
    """2 x."""
    return 2.0 * x


@kernel
def square(x):
    """x^2."""
    return x * x


@kernel
def third(x):
    """Inexact, so that another order of evaluation would show."""
    return (x + 1e16) - 1e16 + x / 3.0


@kernel
def apply(function, x):
    """f(f(x))."""
    return function(function(x))


@kernel
def quotient(a, b):
    """a / b."""
    return a / b


def test_a_kernel_is_a_value_that_another_one_calls():
    doubled, squared = FirstClass(twice, 1.0), FirstClass(square, 1.0)
    assert apply(doubled, 3.0) == 12.0
    compiled = len(apply.signatures)
    assert apply(squared, 3.0) == 81.0
    assert len(apply.signatures) == compiled


def test_a_call_by_value_runs_the_same_code():
    by_value = FirstClass(third, 1.0)
    for x in np.random.default_rng(5).standard_normal(100):
        assert apply(by_value, x) == third(third(x)) == plain(plain(x))


def plain(x):
    return (x + 1e16) - 1e16 + x / 3.0


def test_first_class_needs_no_compiling_anew():
    FirstClass(twice, 1.0)
    before = len(twice.signatures)
    FirstClass(twice, 7.0)
    assert len(twice.signatures) == before


def test_division_by_zero_is_that_of_ieee_754():
    assert quotient(1.0, 0.0) == np.inf
    assert np.isnan(quotient(0.0, 0.0))


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """Return a source tree of two packages whose cache lies in `tmp_path`."""
    for package in ('parallel_robot_model', 'trajectory_gen'):
        (tmp_path / package).mkdir()
    (tmp_path / 'parallel_robot_model' / 'kernel.py').write_text('@kernel\n')
    (tmp_path / 'trajectory_gen' / 'circle.py').write_text('@kernel\ndef f(): return 1\n')
    groups = 'class Robot(NamedTuple):\n    m1: float\n    m2: float\n'
    (tmp_path / 'parallel_robot_model' / 'parameters.py').write_text(groups)
    monkeypatch.setattr(module, '__file__', str(tmp_path / 'parallel_robot_model' / 'kernel.py'))
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    return tmp_path


def test_the_cache_lies_where_the_user_keeps_caches(tree):
    assert Path(module._cache_directory()).parents[1] == tree / 'cache'


@pytest.mark.parametrize(
    ('name', 'content'),
    [
        ('trajectory_gen/circle.py', '@kernel\ndef f(): return 2\n'),
        ('trajectory_gen/spiral.py', '@inlined\ndef g(): return 2\n'),
        # Compiled code addresses a NamedTuple by position, so its order is a source, too.
        (
            'parallel_robot_model/parameters.py',
            'class Robot(NamedTuple):\n    m2: float\n    m1: float\n',
        ),
    ],
)
def test_changed_sources_have_another_cache(tree, name, content):
    before = module._cache_directory()
    assert module._cache_directory() == before
    (tree / name).write_text(content)
    assert module._cache_directory() != before


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write everywhere')
def test_a_home_that_cannot_be_written_is_no_obstacle(tree):
    (tree / 'cache').mkdir(mode=stat.S_IRUSR | stat.S_IXUSR)
    assert tree not in Path(module._cache_directory()).parents


def test_a_cache_home_that_is_a_file_is_no_obstacle(tree):
    (tree / 'cache').write_text('')
    directory = Path(module._cache_directory())
    assert tree not in directory.parents[:3] and os.access(directory, os.W_OK)
    directory.rmdir()


def test_the_users_own_cache_directory_is_respected(tmp_path):
    code = 'import numba, parallel_robot_model.kernel; print(numba.config.CACHE_DIR)'
    found = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)},
        cwd=Path(__file__).parents[1],
        capture_output=True,
        text=True,
        check=True,
    )
    assert found.stdout.strip() == str(tmp_path)
