"""A law as a controller of ros2_control: compiled, and driven by a controller manager of ours.

What it touches of ROS is a stand-in, ros2_control/stand_in.hpp; the torques are those of simulate.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml
from fmu_units import PERIOD

import parallel_robot as pr
from parallel_robot.cli.command_line import main
from parallel_robot_control.safety import faults

FOLDER = Path(__file__).parent / 'ros2_control'
JOINTS = ('joint1', 'joint2', 'joint3')
NANO = 1_000_000_000
STEP = round(PERIOD * NANO)

pytestmark = pytest.mark.skipif(shutil.which('g++') is None, reason='g++ is not installed')


class Host:
    """A process with the controller; it answers each line with a line."""

    def __init__(self, program):
        pipe = subprocess.PIPE
        self.process = subprocess.Popen([program], stdin=pipe, stdout=pipe, stderr=pipe, text=True)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.wait(20)
        self.process.stdout.close()
        self.process.stderr.close()

    def __call__(self, *words):
        print(*(word.hex() if isinstance(word, float) else word for word in words),
              file=self.process.stdin, flush=True)  # fmt: skip
        return self.process.stdout.readline().strip()

    def begin(self, joints=JOINTS, rate=1000, joins=0):
        """Until it is configured and has its interfaces."""
        assert self('joints', *joints) == 'taken'
        assert joins is None or self('flag', 'joins', joins) == 'taken'
        assert self('init', rate) == 'success'
        said = self('configure')
        self('claim')
        return said

    def refer(self, stamp, rows, joints=JOINTS):
        """Tell a reference, rows of shape (3, n)."""
        return self('reference', stamp, len(joints), *joints, *map(float, np.ravel(rows)))

    def cycle(self, now, position, velocity):
        """One cycle; its torques, shape (n,)."""
        for kind, row in {'position': position, 'velocity': velocity}.items():
            for joint, value in zip(JOINTS, row, strict=True):
                self('set', f'{joint}/{kind}', float(value))
        said, *torques = self('update', now).split()
        assert said == 'ok'
        return np.array([float.fromhex(word) for word in torques])

    def ended(self):
        """What it said on its way, after its end."""
        self.process.stdin.close()
        return self.process.stderr.read()


@pytest.fixture(scope='module')
def package(tmp_path_factory):
    place = tmp_path_factory.mktemp('ros2') / 'paper_law'
    assert main(['fmu', 'law', 's_fotsmc', '--ros2-control', str(place)]) == 0
    return place


@pytest.fixture(scope='module')
def program(package, tmp_path_factory):
    """The controller, without a warning, with the host."""
    folder = tmp_path_factory.mktemp('program')
    source = package / 'src' / 'controller.cpp'
    for name in re.findall('#include "(.*)"', source.read_text()):
        if not name.startswith('native/'):
            header = folder / 'include' / name
            header.parent.mkdir(parents=True, exist_ok=True)
            header.write_text('#include "stand_in.hpp"\n')
    native = package / 'src' / 'native'
    strict = ('-O1', '-Wall', '-Wextra', '-Werror')
    c = ['gcc', '-std=c11', *strict, '-c', native / 'instance.c', native / 'variables.c']
    subprocess.run(c, cwd=folder, check=True)
    program = folder / 'host'
    words = ['g++', '-std=c++17', *strict, f'-I{folder}/include', f'-I{FOLDER}']
    words += [f'-I{package}/src', source, FOLDER / 'host.cpp', native / 'kernels.o']
    words += [folder / 'instance.o', folder / 'variables.o', '-lm', '-o', program]
    subprocess.run(words, check=True)
    return program


@pytest.fixture
def host(program):
    with Host(program) as host:
        yield host


@pytest.fixture(scope='module')
def run():
    return pr.simulate('paper_circle', law='s_fotsmc', duration=0.3)


def rows(run, k):
    """The reference at a sample, shape (3, n)."""
    return run.reference[k], run.reference_velocity[k], run.reference_acceleration[k]


def test_the_torques_are_those_of_simulate(host, run):
    assert host.begin() == 'success'
    host.refer(0, rows(run, 0))
    assert host('activate', 0) == 'success'
    for k in range(len(run.time)):
        host.refer(k * STEP, rows(run, k))
        torque = host.cycle(k * STEP, run.position[k], run.velocity[k])
        assert np.array_equal(torque, run.command[k]), k
    assert host('fault') == '0'
    assert host('deactivate') == 'success 0 0 0'


def test_a_reference_of_before_is_carried_to_the_state(host, run):
    """Late by two periods of a motion with constant acceleration: the same torque."""
    n, torques = len(JOINTS), []
    for late in (0, 2):
        host.begin() if late == 0 else host('deactivate')
        ahead = late * PERIOD
        a = np.full(n, 0.5)
        q, v = run.reference[0] + 0.5 * ahead**2 * a, -ahead * a
        now = 10 * STEP
        host.refer(now - late * STEP, (q, v, a))
        assert host('activate', now) == 'success'
        torques.append(host.cycle(now, run.position[0], run.velocity[0]))
    assert np.allclose(*torques, rtol=0, atol=1e-9)
    assert np.any(torques[0] != 0.0)


def test_where_the_robot_is_elsewhere_it_begins_there(program, run):
    away = run.position[0] + 0.02
    torques = []
    for joins in (0, None):
        with Host(program) as host:
            host.begin(joins=joins)
            host.refer(0, rows(run, 0))
            assert host('activate', 0) == 'success'
            torques.append(np.abs(host.cycle(0, away, np.zeros(3))).max())
    assert torques[0] > 1.0 and torques[1] < 0.1 * torques[0], torques


def test_it_begins_with_a_reference_alone_and_at_its_rate(program, run):
    with Host(program) as host:
        assert host.begin() == 'success'
        assert host('activate', 0) == 'failure'
        host.refer(0, rows(run, 0))
        assert host('activate', NANO) == 'failure'  # half a second is the time-out
        assert host('activate', 0) == 'success'
        assert host.ended().count('start the trajectory first') == 2
    with Host(program) as host:
        assert host.begin(rate=500) == 'error'
        assert 'update_rate must be 1000 Hz, for which the law was made, not 500' in host.ended()
    with Host(program) as host:
        assert host.begin(joints=JOINTS[:2]) == 'error'
        assert 'joints must be 3 names' in host.ended()
    with Host(program) as host:
        host('number', 's_fotsmc.G', -1.0)
        assert host.begin() == 'error'
        assert 's_fotsmc.G must be from' in host.ended()


def test_joints_of_messages_and_of_the_hardware_are_found_by_name(host, run):
    assert host.begin() == 'success'
    order = [2, 0, 1]
    shuffled = [row[order] for row in rows(run, 0)]
    host.refer(0, shuffled, [JOINTS[j] for j in order])
    assert host('activate', 0) == 'success'
    assert np.array_equal(host.cycle(0, run.position[0], run.velocity[0]), run.command[0])


def test_messages_that_are_no_reference_are_left_out(host, run):
    assert host.begin() == 'success'
    nothing = np.full((3, 3), np.nan)
    host.refer(0, nothing)
    host.refer(0, rows(run, 0), ('a', 'b', 'c'))
    host.refer(0, rows(run, 0)[:2])
    assert host('activate', 0) == 'failure'
    assert host.ended().count('a reference has not one point') == 3


def test_a_reference_that_stops_is_a_fault_until_it_is_cleared(host, run):
    host.begin()
    host.refer(0, rows(run, 0))
    assert host('activate', 0) == 'success'
    velocity = np.array([0.3, -0.2, 0.1])
    late = 501 * STEP
    torque = host.cycle(late, run.position[0], velocity)
    assert host('fault') == str(faults.REFERENCE_STALE)
    assert np.all(torque * velocity < 0.0)  # it damps
    host.refer(late, rows(run, 0))
    host.cycle(late + STEP, run.position[0], velocity)
    assert host('fault') == str(faults.REFERENCE_STALE)
    assert 'begins anew' in host('clear')
    host.refer(late + 2 * STEP, rows(run, 0))
    torque = host.cycle(late + 2 * STEP, run.position[0], run.velocity[0])
    assert host('fault') == '0'
    assert np.array_equal(torque, run.command[0])


def test_states_without_numbers_are_a_fault_and_busy_ones_are_not(host, run):
    host.begin()
    host.refer(0, rows(run, 0))
    assert host('activate', 0) == 'success'
    first = host.cycle(0, run.position[0], run.velocity[0])
    host('busy', 'joint2/position', 1)
    host.cycle(STEP, run.position[0] + 1e-6, run.velocity[0])
    assert host('fault') == '0'
    host('busy', 'joint2/position', 0)
    broken = run.position[0].copy()
    broken[1] = np.nan
    assert np.any(first != 0.0)
    assert not np.any(host.cycle(2 * STEP, broken, run.velocity[0]))
    assert host('fault') == str(faults.STATES_INVALID)
    assert not np.any(host.cycle(3 * STEP, run.position[0], run.velocity[0]))


def test_the_page_of_the_package_names_what_it_is(package):
    whole = {path.name: path.read_text() for path in package.rglob('*.*') if path.suffix != '.o'}
    assert not [name for name, text in whole.items() if re.search('@[a-z]+@', text)]
    assert 'type: paper_law/LawController' in whole['controllers.yaml']
    assert whole['controller.cpp'].startswith('// Not built by colcon and not run in a controller')
    assert whole['CMakeLists.txt'].startswith('# This file was never run')
    assert 'control cycle of s_fotsmc for planar_3rrr' in whole['plugin.xml']


def test_names_of_joints_are_texts_of_c_and_of_yaml(tmp_path):
    names = ['a "b"', 'c: [d]', r'e\f']
    place = tmp_path / 'own_joints'
    words = (
        'fmu',
        'law',
        'pid',
        '--ros2-control',
        str(place),
        '--set',
        f'joints={json.dumps(names)}',
    )
    assert main(list(words)) == 0
    parameters = yaml.safe_load((place / 'config' / 'controllers.yaml').read_text())
    assert parameters['own_joints']['ros__parameters']['joints'] == names
    text = '#include "layout.h"\n#include <iostream>\nint main() { for (const auto & name : '
    text += 'layout::joint_names()) std::cout << name << std::endl; }'
    (tmp_path / 'names.cpp').write_text(text)
    compiled = ['g++', f'-I{place}/src/native', 'names.cpp', '-o', 'names']
    subprocess.run(compiled, cwd=tmp_path, check=True)
    told = subprocess.run([tmp_path / 'names'], capture_output=True, text=True, check=True)
    assert told.stdout.splitlines() == names


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (('plant', 'paper_circle', '--ros2-control', '{tmp}/it'), 'for a law, not for a plant'),
        (('law', 'pid', '--ros2-control', '{tmp}/Law-1'), "not 'Law-1'"),
        (('law', 'pid', '--ros2-control', '{tmp}'), 'exists; nothing is overwritten'),
        (('law', 'pid', '--ros2-control', '{tmp}/it', '--set', 'period=0.0011'), '1 / n s'),
        (('law', 'pid'), 'one of the arguments --out --ros2-control is required'),
    ],
)
def test_what_is_no_package_is_refused(words, said, tmp_path, capsys):
    assert main(['fmu', *(word.format(tmp=tmp_path) for word in words)]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
