"""The cache of machine code: never stale, quick, in nobody's way, and not for ever."""

import logging
import math
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path

import pytest

from parallel_robot_model.compiler import FunctionValue, kernel, kernels
from parallel_robot_model.processes import cache_directory

ROOT = Path(__file__).parents[1]
KEPT = cache_directory.MAX_VERSIONS


@pytest.fixture
def tree(tmp_path, monkeypatch):
    """Return a source tree of two packages whose cache lies in `tmp_path`."""
    for package in (
        'parallel_robot_model/common',
        'parallel_robot_model/robots',
        'trajectory_gen',
    ):
        (tmp_path / package).mkdir(parents=True)
    (tmp_path / 'trajectory_gen' / 'circle.py').write_text('@kernel\ndef f(): return 1\n')
    groups = 'class Robot(NamedTuple):\n    m1: float\n    m2: float\n'
    (tmp_path / 'parallel_robot_model' / 'robots' / 'parameters.py').write_text(groups)
    file = tmp_path / 'parallel_robot_model' / 'processes' / 'cache_directory.py'
    monkeypatch.setattr(cache_directory, '__file__', str(file))
    monkeypatch.delenv('NUMBA_CACHE_DIR', raising=False)
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    return tmp_path


def test_the_cache_lies_where_the_user_keeps_caches(tree):
    assert Path(cache_directory.directory()).parents[1] == tree / 'cache'


@pytest.mark.parametrize(
    ('name', 'content'),
    [
        ('trajectory_gen/circle.py', '@kernel\ndef f(): return 2\n'),
        ('trajectory_gen/spiral.py', '@inlined\ndef g(): return 2\n'),
        # What a vector is in machine code.
        ('parallel_robot_model/lengths.py', '@lower_builtin(len)\ndef length(): return 3\n'),
        # Compiled code addresses a NamedTuple by position, so its order is a source, too.
        (
            'parallel_robot_model/robots/parameters.py',
            'class Robot(NamedTuple):\n    m2: float\n    m1: float\n',
        ),
    ],
)
def test_changed_sources_have_another_cache(tree, name, content):
    before = cache_directory.directory()
    assert cache_directory.directory() == before
    (tree / name).write_text(content)
    assert cache_directory.directory() != before


def test_a_constant_that_kernels_import_is_a_part_of_them(tree):
    base = tree / 'parallel_robot_model' / 'common'
    for name in ('units', 'factors', 'text'):
        (base / f'{name}.py').write_text('A = 1\n')
    (base / 'units.py').write_text('from parallel_robot_model.common.factors import A\n')
    code = (
        'from parallel_robot_model.common.units import (\n    A,\n)\n@kernel\ndef f(): return A\n'
    )
    (tree / 'trajectory_gen' / 'circle.py').write_text(code)
    before = cache_directory.directory(), cache_directory.suite_hash.__wrapped__()
    (base / 'text.py').write_text('A = 2\n')
    assert cache_directory.directory() == before[0]
    assert cache_directory.suite_hash.__wrapped__() != before[1]
    (base / 'factors.py').write_text('A = 2\n')
    assert cache_directory.directory() != before[0]


@pytest.mark.parametrize('name', cache_directory.NUMBA_SETTINGS)
def test_another_setting_of_numba_is_other_machine_code(name, tree, monkeypatch):
    before = cache_directory.directory()
    monkeypatch.setenv(name, '1')
    assert cache_directory.directory() != before


@pytest.mark.endurance
def test_where_machine_code_lies_does_not_say_which_code_this_is():
    code = 'from parallel_robot.studies.sweep.run_chunk import version; print(version())'
    found = {
        print_in_python(code, ROOT, NUMBA_CACHE_DIR=str(place)) for place in ('', '/dev/null')
    }
    assert len(found) == 1 and cache_directory.suite_hash() in found.pop()


@pytest.mark.skipif(os.geteuid() == 0, reason='root may write everywhere')
def test_a_home_that_cannot_be_written_is_no_obstacle(tree):
    (tree / 'cache').mkdir(mode=stat.S_IRUSR | stat.S_IXUSR)
    assert tree not in Path(cache_directory.directory()).parents


def test_a_cache_home_that_is_a_file_is_no_obstacle(tree):
    (tree / 'cache').write_text('')
    directory = Path(cache_directory.directory())
    assert tree not in directory.parents[:3] and os.access(directory, os.W_OK)
    directory.rmdir()


def versions(tree, count):
    """Directories of as many versions of the sources, each used a minute after the one before."""
    found = []
    for number in range(count):
        (tree / 'trajectory_gen' / 'circle.py').write_text(f'@kernel\ndef f(): return {number}\n')
        found.append(Path(cache_directory.directory()))
        (found[-1] / 'code').write_text('')
        used = time.time() - 60.0 * (count - number)
        os.utime(found[-1], (used, used))
    return found


def test_older_versions_are_removed(tree):
    lock = tree / 'cache' / 'parallel_robot' / 'domain_42.lock'  # no version, so it does not count
    versions(tree, 1)
    lock.write_text('')
    found = versions(tree, KEPT + 3)
    assert [path.exists() for path in found] == [False] * 3 + [True] * KEPT
    assert lock.exists()


def test_a_version_that_was_used_since_is_kept(tree):
    found = versions(tree, KEPT)
    (tree / 'trajectory_gen' / 'circle.py').write_text('@kernel\ndef f(): return 0\n')
    assert Path(cache_directory.directory()) == found[0]
    (tree / 'trajectory_gen' / 'circle.py').write_text('@kernel\ndef f(): return -1\n')
    cache_directory.directory()
    assert [path.exists() for path in found] == [True, False] + [True] * (KEPT - 2)


def test_custom_files_have_more_room_and_not_without_end(tmp_path, monkeypatch):
    monkeypatch.setattr(cache_directory, 'OWN', str(tmp_path))
    for number in range(cache_directory.MAX_CUSTOM_VERSIONS + 2):
        found = cache_directory.custom(f'law_{number}')
        os.utime(found, (time.time() - 9999.0 + number,) * 2)
    kept = [(tmp_path / 'custom' / f'law_{number}').exists() for number in range(5)]
    assert cache_directory.MAX_CUSTOM_VERSIONS > 2 * KEPT and kept == [
        False,
        False,
        True,
        True,
        True,
    ]


def test_copies_of_the_same_sources_share_a_cache(tree, tmp_path_factory, monkeypatch):
    first = cache_directory.directory()
    other = tmp_path_factory.mktemp('other') / 'clone'
    shutil.copytree(tree, other, ignore=shutil.ignore_patterns('cache'))
    file = other / 'parallel_robot_model' / 'processes' / 'cache_directory.py'
    monkeypatch.setattr(cache_directory, '__file__', str(file))
    assert cache_directory.directory() == first
    (other / 'trajectory_gen' / 'circle.py').rename(other / 'trajectory_gen' / 'ring.py')
    assert cache_directory.directory() != first  # machine code names the modules of its types


def test_what_others_have_not_used_for_long_is_removed(tree):
    root = tree / 'cache' / 'parallel_robot'
    for name, days in (('71a51057db9c68d7', 22), ('12345678_0', 22), ('12345678_1', 20)):
        (root / name / 'code').mkdir(parents=True)
        used = time.time() - days * 86400.0
        os.utime(root / name, (used, used))
    cache_directory.directory()
    assert not (root / '71a51057db9c68d7').exists() and not (root / '12345678_0').exists()
    assert (root / '12345678_1').exists()


@pytest.fixture
def told(caplog, monkeypatch):
    """What is told of compiling, in a process that has not told it."""
    kernels._announce.cache_clear()
    monkeypatch.setattr(kernels, '_due', math.inf)
    caplog.set_level(logging.INFO, 'parallel_robot')
    return lambda: caplog.messages


def test_a_process_that_loses_its_cache_compiles_and_tells_so_once(told, tmp_path, monkeypatch):
    monkeypatch.setattr(cache_directory, 'OWN', str(tmp_path / 'cache'))

    def twice(x):
        return 2 * x

    first, again, lost = kernel(twice), kernel(twice), kernel(twice)
    assert not told()
    assert first(2.0) == 4.0
    assert told() == [cache_directory.NOTICE]
    assert again(2.0) == 4.0 and sum(again.stats.cache_hits.values()) == 1
    shutil.rmtree(tmp_path / 'cache')
    assert lost(2.0) == 4.0 and sum(lost.stats.cache_hits.values()) == 0
    assert told() == [cache_directory.NOTICE]
    assert any((tmp_path / 'cache').rglob('*.nbc'))  # for the next


def test_how_far_it_is_is_told_now_and_then(told, tmp_path, monkeypatch):
    monkeypatch.setattr(cache_directory, 'OWN', str(tmp_path / 'cache'))
    monkeypatch.setattr(kernels, '_due', 0.0)
    for factor in (4.0, 5.0, 6.0):
        assert kernel(lambda x, factor=factor: factor * x)(1.0) == factor
    text = f'1 of about {cache_directory.ALL} kernels are compiled'
    assert told() == [cache_directory.NOTICE, text]  # and then not for some seconds
    assert cache_directory.compiled() == text.replace('1', '3', 1)
    monkeypatch.setattr(kernels, '_due', 0.0)
    monkeypatch.setattr(cache_directory, 'OWN', '')
    assert kernel(lambda x: 7.0 * x)(1.0) == 7.0 and len(told()) == 2  # where nobody knows


@pytest.mark.parametrize('used', [False, True])
def test_a_cache_that_cannot_be_written_stops_nobody(used, told, tmp_path, monkeypatch):
    monkeypatch.setattr(cache_directory, 'OWN', str(tmp_path / 'cache'))
    thrice = kernel(lambda x: 3 * x)
    if used:
        assert thrice(2) == 6
        shutil.rmtree(tmp_path / 'cache')
    (tmp_path / 'cache').write_text('')  # even root can make no directory there
    assert thrice(2.0) == 6.0


def test_an_index_that_cannot_be_read_is_no_obstacle(tmp_path, monkeypatch):
    """It may name a class that is gone, or be cut."""
    monkeypatch.setattr(cache_directory, 'OWN', str(tmp_path / 'cache'))

    def fourfold(x):
        return 4 * x

    assert kernel(fourfold)(2.0) == 8.0
    (index,) = (tmp_path / 'cache').rglob('*.nbi')
    for broken in (b'', index.read_bytes()[:-5], index.read_bytes().replace(b'numba', b'mumba')):
        index.write_bytes(broken)
        assert kernel(fourfold)(2.0) == 8.0
        again = kernel(fourfold)
        assert again(2.0) == 8.0 and sum(again.stats.cache_hits.values()) == 1


WHERE = 'from trajectory_gen.circle import motion; print(motion.stats.cache_path)'


def print_in_python(code, folder, **environment):
    done = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, 'PYTHONPATH': str(ROOT), **environment},
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_the_users_own_cache_directory_is_respected(tmp_path):
    found = Path(print_in_python(WHERE, ROOT, NUMBA_CACHE_DIR=str(tmp_path)))
    assert found.is_relative_to(tmp_path) and found.parent.name.startswith('kernels_')


def test_a_directory_that_the_user_has_chosen_holds_no_other_version(tree, monkeypatch):
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tree / 'chosen'))
    (tree / 'chosen' / 'of_others').mkdir(parents=True)
    old = time.time() - 2.0 * cache_directory.UNUSED
    os.utime(tree / 'chosen' / 'of_others', (old, old))
    found = versions(tree, 2)
    assert found[0] != found[1]
    assert all(path.is_relative_to(tree / 'chosen') for path in found)
    assert (tree / 'chosen' / 'of_others').exists()


def test_a_directory_that_cannot_be_used_is_named(tree, monkeypatch, caplog):
    (tree / 'file').write_text('')
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tree / 'file'))
    assert not Path(cache_directory.directory()).is_relative_to(tree / 'file')
    assert f'NUMBA_CACHE_DIR: {tree / "file"} is not used' in caplog.text


@pytest.mark.parametrize('how', ['numba', 'own'])
def test_a_cache_that_others_may_write_is_not_used(how, tmp_path):
    place = tmp_path / how
    place.mkdir()
    place.chmod(0o777)
    variables = (
        {'NUMBA_CACHE_DIR': str(place)} if how == 'numba' else {'XDG_CACHE_HOME': str(place)}
    )
    found = print_in_python(WHERE, ROOT, TMPDIR=str(tmp_path), **variables)
    assert not Path(found).is_relative_to(place)


MOVE = """
from trajectory_gen.circle import Parameters, motion, prepare
motion(prepare(Parameters((0.0, 0.0), 1.0, 1.0, 0.0, (0.0, 0.0, 1.0))), 0.5)
print(sum(motion.stats.cache_hits.values()), motion.stats.cache_path)
"""


@pytest.mark.endurance
def test_a_copy_of_the_sources_finds_what_another_has_compiled(tmp_path):
    results = []
    for name in ('one', 'two'):
        for package in (*ROOT.glob('parallel_robot*'), ROOT / 'trajectory_gen'):
            shutil.copytree(package, tmp_path / name / package.name)
        place = {'PYTHONPATH': str(tmp_path / name), 'XDG_CACHE_HOME': str(tmp_path / 'cache')}
        hits, path = print_in_python(MOVE, tmp_path, **place).split()
        results.append(hits)
        assert Path(path).is_relative_to(tmp_path / 'cache')
    assert results == ['0', '1']


SUMS = """
import sys, time
from numba.core.caching import IndexDataCacheFile
from parallel_robot_model.compiler import kernel

save = IndexDataCacheFile._save_index
IndexDataCacheFile._save_index = lambda *words: (time.sleep(0.01), save(*words))  # so they meet

@kernel
def total(values):
    sum = 0.0
    for value in values:
        sum += value
    return sum

counts = [int(word) for word in sys.argv[1:]]
print('ready', flush=True)
sys.stdin.readline()
for count in counts:
    assert total((1.0,) * count) == count
print(sum(total.stats.cache_hits.values()), total.stats.cache_path)
"""


@pytest.fixture
def summing(tmp_path):
    """Run processes at once with a kernel for tuples of some lengths; returns its cache, hits."""
    file = tmp_path / 'sums.py'
    file.write_text(SUMS)

    def sums(*lengths):
        environment = {'PYTHONPATH': str(ROOT), 'XDG_CACHE_HOME': str(tmp_path / 'cache')}
        processes = [
            subprocess.Popen(
                [sys.executable, str(file), *map(str, counts)],
                env={**os.environ, **environment},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            for counts in lengths
        ]
        for process in processes:
            process.stdout.readline()
        for process in processes:
            process.stdin.write('\n')
            process.stdin.flush()
        told = [process.communicate()[0].split() for process in processes]
        assert not any(process.returncode for process in processes)
        return Path(told[0][1]), sum(int(hits) for hits, _ in told)

    return sums


@pytest.mark.endurance
def test_of_what_processes_compile_at_once_nothing_is_lost(summing):
    lengths = [range(1, 10, 3), range(2, 10, 3), range(3, 10, 3)]
    assert summing(*lengths)[1] == 0
    assert summing(range(1, 10))[1] == 9


@pytest.mark.endurance
def test_code_for_other_types_is_found_out_and_compiled_anew(summing):
    cache, _ = summing([1, 2])
    first, second = sorted(cache.glob('*.nbc'))
    shutil.copy(first, second)
    assert [summing([1, 2])[1] for _ in range(2)] == [1, 2]


NAMES = """
from parallel_robot_control.laws import LAWS
kinds = [kind for law in LAWS.values() for kind in (law.Gains, type(law.initial_memory(3)))]
print(*sorted({kind.__name__.rpartition('.')[0] for kind in kinds}))
"""


def test_code_for_a_law_is_found_whatever_was_compiled_before_it():
    """A law that makes a tuple of another one, in a kernel, gives its class a name for good."""
    names = print_in_python(NAMES, ROOT).split()
    assert len(names) > 10 and all(name.startswith('parallel_robot_control.') for name in names)


def test_the_private_parts_of_numba_that_are_used_are_there():
    """A newer Numba that fails here needs kernels.py and boxed.py looked at."""
    implementation = kernels.KernelCache(kernel(lambda x: x).py_func)._impl
    assert isinstance(implementation, kernels._Files)
    assert isinstance(implementation.locator, kernels._Place)
    assert implementation.filename_base.startswith('test_kernel_cache.')
    value = FunctionValue(kernel(lambda x: 2.0 * x), 1.0)
    assert value._numba_type_.key == value.signature()


def test_a_warm_start_does_not_prepare_to_compile(tmp_path):
    code = """
import sys
import numpy as np
from trajectory_gen.configuration import trajectory_of
from parallel_robot_control.configuration import configure
from parallel_robot_control.controller import Controller
from parallel_robot_model.configuration import config
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator
values = config.resolve('paper_circle')
trajectory_of(values).sample(0.0)
Controller(configure(values))
Simulator(configure_plant(values)).advance(np.zeros(3))
print('numba.np.linalg' in sys.modules or 'scipy.linalg' in sys.modules)
"""
    print_in_python(code, tmp_path)  # compiles what no test has compiled before
    assert print_in_python(code, tmp_path) == 'False'


OF_ROBOTS = """
from parallel_robot_model.robots.registry import ROBOTS
for robot in ROBOTS.values():
    for kind in (robot.Constants, robot.SafetyMargins):
        print(kind.__name__ == f'{kind.__module__}.{kind.__qualname__}')
"""


def test_tuples_of_robots_have_the_names_by_which_code_is_found_before_a_kernel_takes_one():
    """Else the first command in a process decides whether all others compile again."""
    assert {*print_in_python(OF_ROBOTS, ROOT).split()} == {'True'}
