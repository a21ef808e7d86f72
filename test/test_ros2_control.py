"""Law and simulated robot as packages of ros2_control: compiled, and driven by a manager of ours.

What it touches of ROS is a stand-in, ros2_control/stand_in.hpp; the torques are those of simulate.
"""

import hashlib
import json
import re
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import yaml
from fmu_units import PERIOD
from rig import Rig

import parallel_robot as pr
from parallel_robot.cli.command_line import main
from parallel_robot_control.safety import faults
from parallel_robot_model.configuration import config

FOLDER = Path(__file__).parent / 'ros2_control'
JOINTS = ('joint1', 'joint2', 'joint3')
NANO = 1_000_000_000
STEP = round(PERIOD * NANO)

pytestmark = pytest.mark.skipif(shutil.which('g++') is None, reason='g++ is not installed')


class Host:
    """A process with the controller; it answers each line with a line."""

    def __init__(self, *program):
        pipe = subprocess.PIPE
        self.process = subprocess.Popen(program, stdin=pipe, stdout=pipe, stderr=pipe, text=True)

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

    def cycle(self, now, position, velocity, effort=None, since=STEP):
        """One cycle, some time after the one before [ns]; its torques, shape (n,)."""
        states = {'position': position, 'velocity': velocity}
        for kind, row in (states if effort is None else states | {'effort': effort}).items():
            for joint, value in zip(JOINTS, row, strict=True):
                self('set', f'{joint}/{kind}', float(value))
        return self.update(now, since)

    def update(self, now, since=STEP):
        """An update of the law; its torques, shape (n,)."""
        said, torques = self('update', now, since).split(maxsplit=1)
        assert said == 'ok'
        return numbers(torques)

    def ended(self):
        """What it said on its way, after its end."""
        self.process.stdin.close()
        return self.process.stderr.read()


def numbers(text):
    return np.array([float.fromhex(word) for word in text.split()])


@pytest.fixture(scope='module')
def package(tmp_path_factory):
    place = tmp_path_factory.mktemp('ros2') / 'paper_law'
    assert main(['fmu', 'law', 's_fotsmc', '--ros2-control', str(place)]) == 0
    return place


@pytest.fixture(scope='module')
def robot_package(tmp_path_factory):
    place = tmp_path_factory.mktemp('ros2') / 'paper_plant'
    assert main(['fmu', 'plant', 'paper_circle', '--ros2-control', str(place)]) == 0
    return place


STRICT = ('-O1', '-Wall', '-Wextra', '-Werror', f'-I{FOLDER}')


@pytest.fixture(scope='module')
def host_program(tmp_path_factory):
    program = tmp_path_factory.mktemp('host') / 'host'
    words = ['g++', '-std=c++17', *STRICT, FOLDER / 'host.cpp', '-ldl', '-o', program]
    subprocess.run(words, check=True)
    return program


def library(package, folder):
    """What CMake makes of a package, without a warning."""
    sources = package / 'src'
    (source,) = sources.glob('*.cpp')
    for name in re.findall('#include "(.*)"', source.read_text()):
        if not name.startswith('native/'):
            header = folder / 'include' / name
            header.parent.mkdir(parents=True, exist_ok=True)
            header.write_text('#include "stand_in.hpp"\n')
    native, flags = sources / 'native', ('-fPIC', *STRICT)
    c = ['gcc', '-std=c11', *flags, '-c', native / 'instance.c', native / 'variables.c']
    subprocess.run(c, cwd=folder, check=True)
    made = folder / f'lib{package.name}.so'
    words = ['g++', '-std=c++17', '-shared', *flags, f'-I{folder}/include', f'-I{sources}']
    words += [source, native / 'kernels.o', folder / 'instance.o', folder / 'variables.o']
    subprocess.run([*words, '-lm', '-Wl,-Bsymbolic', '-o', made], check=True)
    return made


@pytest.fixture(scope='module')
def program(host_program, package, tmp_path_factory):
    """The host with the law."""
    return host_program, library(package, tmp_path_factory.mktemp('law'))


@pytest.fixture(scope='module')
def both(program, robot_package, tmp_path_factory):
    """The host with law and robot."""
    return *program, library(robot_package, tmp_path_factory.mktemp('robot'))


@pytest.fixture
def host(program):
    with Host(*program) as host:
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
        with Host(*program) as host:
            host.begin(joins=joins)
            host.refer(0, rows(run, 0))
            assert host('activate', 0) == 'success'
            torques.append(np.abs(host.cycle(0, away, np.zeros(3))).max())
    assert torques[0] > 1.0 and torques[1] < 0.1 * torques[0], torques


def test_it_begins_with_a_reference_alone_and_at_its_rate(program, run):
    with Host(*program) as host:
        assert host.begin() == 'success'
        assert host('activate', 0) == 'failure'
        host.refer(0, rows(run, 0))
        assert host('activate', NANO) == 'failure'  # half a second is the time-out
        assert host('activate', 0) == 'success'
        assert host.ended().count('start the trajectory first') == 2
    with Host(*program) as host:
        assert host.begin(rate=500) == 'error'
        assert 'update_rate must be 1000 Hz, for which the law was made, not 500' in host.ended()
    with Host(*program) as host:
        assert host.begin(joints=JOINTS[:2]) == 'error'
        assert 'joints must be 3 names' in host.ended()
    with Host(*program) as host:
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


def test_a_pause_too_long_for_states_and_references_is_told_by_the_states(host, run):
    host.begin()
    host.refer(0, rows(run, 0))
    assert host('activate', 0) == 'success'
    host.cycle(0, run.position[0], run.velocity[0])
    host.cycle(600 * STEP, run.position[0], run.velocity[0], since=600 * STEP)
    assert host('fault') == str(faults.STATES_STALE)


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


def answers(rig, host, shown, age=0):
    """Torques of the suite's own cycle and of the controller, for the states that both get.

    Args:
        rig: The loop in Python; its torque moves the robot, and is held while no state is shown.
        host: The controller.
        shown: Numbers of those states.
        age: Age of the reference that comes with a state after a pause, in periods.
    """
    torques, before, last = [], -1, np.zeros(3)
    for k in range(shown[-1] + 1):
        if k in shown:
            late = age if k - before > 1 else 0
            state, row, stamp = rig.measured(), rig.reference(k - late), rig.stamp - late * STEP
            rig.controller.add_reference(stamp, row)
            host.refer(stamp, row)
            assert rig.controller.add_state(rig.stamp, state)
            last = rig.controller.torque
            torques.append((last, host.cycle(rig.stamp, *state, (k - before) * STEP)))
            before = k
        rig.simulator.advance(last)
        rig.k += 1
    return np.array(torques)


def begun(host, mode):
    """A loop in Python at its start, and the controller active there; both know efforts."""
    rig = Rig(mode, law='s_fotsmc')
    assert host('flag', 'effort_known', 1) == 'taken'
    assert host.begin() == 'success'
    host.refer(rig.stamp, rig.reference())
    assert host('activate', rig.stamp) == 'success'
    return rig


@pytest.mark.parametrize('pause', [2, 3, 4, 20, 50, 100, 200, 500, 501])
def test_a_pause_is_answered_as_the_node_answers_states_that_are_missing(host, pause):
    rig = begun(host, 'lockstep')
    shown = [*range(600), *range(599 + pause, 799 + pause)]
    torques = answers(rig, host, shown)
    assert np.array_equal(torques[:, 0], torques[:, 1])
    stale = pause > 500  # ms, safety.state_timeout
    assert rig.controller.fault == (faults.STATES_STALE if stale else faults.NONE)
    assert host('fault') == str(rig.controller.fault)


def test_many_pauses_in_a_row_are_answered_so_too(host):
    """A fifth of the states missing, one to four in a row."""
    rig, draw = begun(host, 'lockstep'), np.random.default_rng(3)
    shown = np.cumsum(np.where(draw.random(600) < 0.1, draw.integers(2, 6, 600), 1)).tolist()
    torques = answers(rig, host, [0, *shown])
    assert np.array_equal(torques[:, 0], torques[:, 1]) and host('fault') == '0'


def test_a_reference_that_stood_still_with_the_manager_is_joined_as_by_the_node(host):
    rig = begun(host, 'wall')
    torques = answers(rig, host, [*range(600), *range(799, 1000)], age=150)
    assert np.array_equal(torques[:, 0], torques[:, 1]) and host('fault') == '0'


def test_jitter_and_periods_that_are_none_are_no_pauses(host, run):
    """30 % of jitter; the first update, a clock that is set back, a manager at twice the rate."""
    draw = np.random.default_rng(1)
    since = (STEP * draw.uniform(0.7, 1.3, len(run.time))).round().astype(int).tolist()
    since[0], since[50], since[51], since[100] = 10 * NANO, 0, -STEP, STEP // 2
    assert host.begin() == 'success'
    host.refer(0, rows(run, 0))
    assert host('activate', 0) == 'success'
    for k in range(len(run.time)):
        host.refer(k * STEP, rows(run, k))
        torque = host.cycle(k * STEP, run.position[k], run.velocity[k], since=since[k])
        assert np.array_equal(torque, run.command[k]), k


def test_each_cycle_publishes_its_torque_which_starts_the_trajectory(host, run):
    assert host.begin() == 'success'
    host.refer(0, rows(run, 0))
    assert host('activate', 0) == 'success'
    assert host('commands') == '0'
    for k in range(3):
        host.refer(k * STEP, rows(run, k))
        torque = host.cycle(k * STEP, run.position[k], run.velocity[k])
        count, told = host('commands').split(maxsplit=1)
        assert int(count) == k + 1 and np.array_equal(numbers(told), torque)


def test_a_fault_is_told_in_words_once(host, run):
    assert host.begin() == 'success'
    host.refer(0, rows(run, 0))
    assert host('activate', 0) == 'success'
    assert host('fault_text') == '1 none'
    host.cycle(0, run.position[0], run.velocity[0])
    host.cycle(STEP, run.position[0] + 0.1, run.velocity[0])
    text = faults.FAULTS[faults.POSITION_JUMP].text
    assert host('fault_text') == host('fault_text') == f'2 {text}'
    host('clear')
    host.cycle(2 * STEP, run.position[0], run.velocity[0])
    assert host('fault_text') == '3 none'
    assert host.ended().count(f'fault {faults.POSITION_JUMP}: {text}; ~/clear_fault ends it') == 1


FACES = ('effort', 'position', 'velocity', 'effort')  # of a joint, first the command


def with_robot(host, joints=JOINTS):
    """The simulated robot, active; its description has the joints in some order."""
    assert host('joints', *joints) == 'taken'
    assert host('robot', 'init', *FACES) == 'success'
    assert host('robot', 'configure') == 'success'
    assert host('robot', 'activate') == 'success'


def told(host):
    """Position, velocity and effort of the robot, shape (3, n)."""
    names = [f'{joint}/{kind}' for kind in FACES[1:] for joint in JOINTS]
    return numbers(host('get', *names)).reshape(3, len(JOINTS))


def command(host, torque):
    """Torques as commands of the hardware, in place of a law."""
    for joint, value in zip(JOINTS, torque, strict=True):
        host('command', f'{joint}/effort', float(value))


@pytest.mark.parametrize('efforts', [0, 1])
def test_law_and_robot_as_packages_are_the_loop_of_simulate(both, run, efforts):
    with Host(*both) as host:
        host('flag', 'effort_known', efforts)
        with_robot(host, ('joint2', 'joint3', 'joint1'))
        for _ in range(5):  # before there is a law, the robot stands still
            assert host('read', STEP) == host('write', STEP) == 'ok'
        assert host.begin() == 'success'
        host.refer(0, rows(run, 0))
        assert host('activate', 0) == 'success'
        for k in range(len(run.time)):
            host.refer(k * STEP, rows(run, k))
            assert host('read', STEP) == 'ok'
            assert np.array_equal(told(host)[:2], [run.position[k], run.velocity[k]]), k
            assert np.array_equal(host.update(k * STEP), run.command[k]), k
            assert host('write', STEP) == 'ok'
        assert host('fault') == '0'


@pytest.mark.parametrize('pause', [20, 50, 200])
def test_a_pause_of_the_manager_in_which_the_robot_moves_on_is_no_fault(both, pause):
    """Between two cycles, as a process that is stopped; reference and robot go on."""
    run = pr.simulate('paper_circle', law='s_fotsmc', duration=2.5)
    with Host(*both) as host:
        with_robot(host)
        assert host.begin() == 'success'
        host.refer(0, rows(run, 0))
        assert host('activate', 0) == 'success'
        before, after, largest = -1, [], 0.0
        for k in (*range(1000), *range(999 + pause, len(run.time))):
            host.refer(k * STEP, rows(run, k))
            since = (k - before) * STEP
            assert host('read', since) == 'ok'
            after.append(np.abs(told(host)[0] - run.reference[k]).max())
            torque = host.update(k * STEP, since)
            largest = max(largest, np.abs(torque).max() if k > 1000 else 0.0)
            assert host('write', since) == 'ok'
            before = k
        assert host('fault') == '0'
        assert largest < 10.0 and max(after[-200:]) < 1e-4, (largest, max(after[-200:]))


def test_the_robot_moves_under_finite_torques_alone(both):
    with Host(*both) as host:
        with_robot(host)
        first = told(host)
        for torque in ([np.nan] * 3, [1.0, np.nan, 0.0]):  # brakes
            command(host, torque)
            assert host('write', STEP) == host('read', 50 * STEP) == 'ok'
            assert np.array_equal(told(host), first)
        command(host, [0.1, 0.0, 0.0])
        assert host('write', STEP) == host('read', STEP) == 'ok'
        second = told(host)
        assert np.array_equal(second[2], [0.1, 0.0, 0.0])
        command(host, [0.0, np.inf, 0.0])  # left out: the one of before holds
        assert host('write', STEP) == host('read', STEP) == 'ok'
        assert np.array_equal(told(host)[2], second[2])
        assert host('robot', 'deactivate') == 'success'
        position = told(host)[0]
        assert host('read', STEP) == 'ok'
        assert np.array_equal(told(host), [position, np.zeros(3), np.zeros(3)])
        assert host('robot', 'activate') == 'success'
        assert np.array_equal(told(host), first) and host('read', STEP) == 'ok'
        assert np.array_equal(told(host), first)


def test_a_robot_that_leaves_its_workspace_is_an_error_with_a_way_back(both):
    with Host(*both) as host:
        with_robot(host)
        first = told(host)
        command(host, [20.0, 20.0, 20.0])
        said = [host('write', STEP) and host('read', 20 * STEP) for _ in range(200)]
        assert said[0] == 'ok' and said[-1] == 'error'
        assert np.isfinite(told(host)).all()
        for step in ('error', 'configure', 'activate'):
            assert host('robot', step) == 'success'
        assert np.array_equal(told(host), first)
        assert 'the robot has left its workspace' in host.ended()


def test_a_pause_moves_the_robot_by_the_time_that_passed(both):
    """At most a second; a read that is early or late, or whose time is none, by one period."""
    ways = []
    for reads in (
        [20 * STEP], [STEP] * 20, [0, -STEP, round(1.4 * STEP), STEP // 2], [STEP] * 4,
        [9 * NANO], [NANO],
    ):  # fmt: skip
        with Host(*both) as host:
            with_robot(host)
            command(host, [1e-3, 0.0, 0.0])
            assert host('write', STEP) == 'ok'
            assert [host('read', since) for since in reads] == ['ok'] * len(reads)
            ways.append(told(host))
    assert np.array_equal(ways[0], ways[1])
    assert np.array_equal(ways[2], ways[3])
    assert np.array_equal(ways[4], ways[5])


@pytest.mark.parametrize(
    ('joints', 'faces', 'said'),
    [
        (('joint1', 'joint2', 'gripper'), FACES, 'joint gripper is none of this robot, which has'),
        (JOINTS[:2], FACES, 'joint joint3 must be there once'),
        ((*JOINTS, 'joint1'), FACES, 'joint joint1 must be there once'),
        (JOINTS, ('position', 'position'), 'must have effort as its only command interface'),
        (JOINTS, ('effort', 'torque'), 'joint joint1 has no state interface torque'),
    ],
)
def test_a_description_of_another_robot_is_refused(both, joints, faces, said):
    with Host(*both) as host:
        host('joints', *joints)
        assert host('robot', 'init', *faces) == 'error'
        assert said in host.ended()


@pytest.mark.parametrize(
    ('name', 'text', 'said'),
    [
        ('friction.viscous[1]', '0.2', ''),
        ('friction.viscous[1]', 'much', 'friction.viscous[1] must be a number, not much'),
        ('friction.viscous[1]', '-1', 'friction.viscous[1] must be from 0 to inf, not -1'),
        ('friction.wrong', '1', 'parameter friction.wrong is unknown: config/robot.urdf'),
    ],
)
def test_parameters_of_the_description_are_those_of_the_robot(both, name, text, said):
    with Host(*both) as host:
        host('joints', *JOINTS)
        host('robot', 'parameter', name, text)
        assert host('robot', 'init', *FACES) == ('error' if said else 'success')
        assert said in host.ended()


def test_the_description_of_the_robot_is_one_and_a_parameter_of_ros(robot_package):
    text = (robot_package / 'config' / 'robot.urdf').read_text()
    for each in (text, (config.directory() / 'hardware' / 'topic_based.urdf').read_text()):
        assert yaml.safe_load(each).split() == each.split()  # else -p robot_description:= fails
    robot = ElementTree.fromstring(text)
    safety = pr.show('paper_circle').value
    for k, name in enumerate(JOINTS):
        limit = robot.find(f'joint[@name="{name}"]/limit')
        for key, of in {'effort': 'torque_limit', 'velocity': 'speed_limit'}.items():
            assert float(limit.get(key)) == np.broadcast_to(safety[f'safety.{of}'], 3)[k]
        joint = robot.find(f'ros2_control/joint[@name="{name}"]')
        assert [face.get('name') for face in joint] == list(FACES)
    assert robot.findtext('ros2_control/hardware/plugin') == 'paper_plant/RobotSystem'
    plugin = ElementTree.parse(robot_package / 'plugin.xml').find('class')
    assert plugin.get('name') == 'paper_plant/RobotSystem'
    assert plugin.get('base_class_type') == 'hardware_interface::SystemInterface'
    manager = yaml.safe_load((robot_package / 'config' / 'controllers.yaml').read_text())
    assert manager['controller_manager']['ros__parameters']['update_rate'] == 1000


def test_the_page_of_the_package_names_what_it_is(package):
    whole = {path.name: path.read_text() for path in package.rglob('*.*') if path.suffix != '.o'}
    assert not [name for name, text in whole.items() if re.search('@[a-z]+@', text)]
    assert 'type: paper_law/LawController' in whole['controllers.yaml']
    assert 'control cycle of s_fotsmc for planar_3rrr' in whole['plugin.xml']


def body(text):
    """A file without the comment at its head, and that comment."""
    lines = text.splitlines(keepends=True)
    (first,) = [k for k, line in enumerate(lines) if not line.startswith(('#', '//'))][:1]
    return ''.join(lines[first:]), ''.join(lines[:first])


def test_the_page_says_which_files_were_run_as_they_are(package, robot_package):
    page = (Path(__file__).parents[1] / 'docs' / 'fmu.md').read_text()
    rows = re.findall(r'^\| (\S+) \| (run|changed) \| `([0-9a-f]{64})` \|$', page, re.MULTILINE)
    written = {str(path.relative_to(package)) for path in package.rglob('*') if path.is_file()}
    own = {f'src/native/{name}' for name in ('kernels.o', 'variables.c', 'layout.h')}
    assert {name for name, _, _ in rows} == written - own
    for name, state, digest in rows:
        text, head = body((package / name).read_text())
        same = hashlib.sha256(text.encode()).hexdigest() == digest
        assert same == (state == 'run'), name
        assert same == ('not yet run' not in head), name
    for path in robot_package.rglob('*'):
        if path.suffix in ('.cpp', '.txt', '.urdf', '.yaml'):
            assert 'ot yet run' in path.read_text()[:200], path


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
        (
            ('loop', 'paper_circle', '--ros2-control', '{tmp}/it'),
            'for a law or a plant, not for a loop',
        ),
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
