"""Laws in C: the torques of the same law in Python; what they do wrong costs a run and a line."""

import hashlib
import os
import re
import select
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from foreign_laws import compiled, made
from rclpy.clock import ClockType
from rclpy.time import Time
from std_srvs.srv import Trigger
from sweeping import TEXT, runs

from parallel_robot.bags import bag_reader
from parallel_robot.cli.command_line import main
from parallel_robot_control import controller_node
from parallel_robot_control.configuration import resolve
from parallel_robot_control.foreign import law
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.messages import topics
from parallel_robot_sim.configuration import configure, configure_plant
from parallel_robot_sim.plant_run import Simulator
from parallel_robot_sim.scenario_run import simulate
from parallel_robot_sim.simulation import parts
from trajectory_gen.configuration import trajectory_of
from trajectory_gen.messages import reference_messages

pytest_plugins = ['ros_fixtures']

DOCS = Path(__file__).parents[1] / 'docs'
SHORT = 0.1  # s
END = 'in a fault for'


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('libraries')


@pytest.fixture(scope='module')
def good(folder):
    return made(folder / 'good.so')


def run_of(file, **values):
    return simulate('paper_circle', law=file, duration=SHORT, **values)


@pytest.mark.parametrize(
    ('scenario', 'values'),
    [
        ('paper_circle', {}),
        (
            'paper_circle',
            {'hazards': ['states_lost at 0.02 for 0.003', 'states_lost at 0.04 for 0.05']},
        ),
        ('five_bar_circle', {}),
    ],
    ids=['circle', 'gaps', 'five_bar'],
)
def test_the_example_has_the_bits_of_the_one_in_python(tmp_path, scenario, values):
    library = compiled(tmp_path / 'example_law.so', (DOCS / 'example_law.c').read_text())
    runs = [
        simulate(scenario, law=file, duration=SHORT, **values)
        for file in (library, DOCS / 'example_law.py')
    ]
    np.testing.assert_array_equal(runs[0].command, runs[1].command)
    np.testing.assert_array_equal(runs[0].sliding_variable, runs[1].sliding_variable)
    assert np.nanmax(np.abs(runs[0].command)) > 0.1


@pytest.mark.parametrize(('language', 'standard'), [('c', 'c99'), ('c++', 'c++11')])
def test_the_header_is_plain_c_and_cpp(tmp_path, language, standard):
    if language == 'c++' and shutil.which('g++') is None:
        pytest.skip('no g++')
    source = (DOCS / 'example_law.c').read_text()
    flags = [f'-std={standard}', '-Wall', '-Wextra', '-pedantic', '-Werror', '-fvisibility=hidden']
    file = compiled(tmp_path / 'plain.so', source, *flags, language=language)
    taken = law.ForeignLaw(str(file), hashlib.sha256(file.read_bytes()).hexdigest())
    assert taken.initial_memory(3).number == 0


def test_a_run_begins_anew(folder):
    counts = made(folder / 'counts.so', 'out->torque[0] += calls;')
    one, other = run_of(counts), run_of(counts)
    np.testing.assert_array_equal(one.command, other.command)


@pytest.mark.parametrize(
    ('late', 'told'),
    [
        ('*(volatile int *)0 = 1;', 'the law ends the process with SIGSEGV'),
        ('abort();', 'the law ends the process with SIGABRT'),
        ('exit(3);', 'the law ends the process with code 3'),
        ('for (;;);', 'the law gives no answer within 0.5 s'),
        ('out->torque[1] = NAN;', 'the law gave a torque that is not finite'),
        ('return 7;', 'the law is in a fault of its own, 7'),
    ],
    ids=['crash', 'abort', 'exit', 'loop', 'nan', 'fault'],
)
def test_what_it_does_wrong_is_a_fault_in_one_line(folder, tmp_path, capsys, late, told):
    bad = made(tmp_path / 'bad.so', late)
    words = ['--law', str(bad), '--set', 'bad.limit=0.5', '--duration', str(SHORT)]
    assert main(['simulate', 'paper_circle', *words, '--out', str(tmp_path / 'bag')]) == 1
    (line,) = [each for each in capsys.readouterr().err.splitlines() if END in each]
    assert line.endswith(f'first at t = 0.020 s: {told}')


def test_a_crash_ends_no_other_run(good, tmp_path, capsys):
    crash = made(tmp_path / 'crash.so', 'abort();')
    laws = [str(crash), str(good), 'pid']
    assert main(['compare', 'paper_circle', '--duration', str(SHORT), '--laws', *laws]) == 0
    rows = {line.split()[0]: line for line in capsys.readouterr().out.splitlines() if line}
    assert 'no figures' in rows['crash'] and 'SIGABRT' in rows['crash']
    assert 'no figures' not in rows['good'] + rows['pid']
    for _ in range(2):  # each in a process of its own
        assert run_of(crash).fault == (0.02, 'the law ends the process with SIGABRT')


@pytest.mark.parametrize(
    ('make', 'told'),
    [
        (lambda file: file.write_text('no library'), 'cannot be loaded: .*file too short'),
        (lambda file: compiled(file, 'int x;'), 'has no law_version: a law includes'),
        (lambda file: compiled(file, 'const int law_version = 1;'), 'has no law_update'),
        (
            lambda file: compiled(file, 'const int law_version = 9; int law_update() {return 0;}'),
            'is made with version 9 of parallel_robot_law.h, not 1',
        ),
        (lambda file: made(file, after='const int32_t law_joints = 5;'), 'for 5 joints, not 3'),
        (
            lambda file: made(file, after='const double law_period = 0.002;'),
            'steps by 0.002 s, which must be the period, 0.001 s',
        ),
        (
            lambda file: made(
                file, after='__attribute__((constructor)) static void f(void) { abort(); }'
            ),
            'the law ends the process with SIGABRT when it is loaded',
        ),
        (lambda file: file.mkdir(), 'is not a file whose name is an identifier'),
        (lambda file: None, 'does not exist'),
    ],
    ids=[
        'text',
        'none',
        'no_update',
        'version',
        'joints',
        'period',
        'constructor',
        'folder',
        'gone',
    ],
)
def test_it_is_refused_before_the_run(tmp_path, capsys, make, told):
    file = tmp_path / 'wrong.so'
    make(file)
    out = tmp_path / 'bag'
    words = ['--law', str(file), '--duration', str(SHORT), '--out', str(out)]
    assert main(['simulate', 'paper_circle', *words]) == 2
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and re.search(told, err) and not out.exists()


def test_a_law_for_the_joints_and_the_period_is_taken(folder):
    fits = 'const int32_t law_joints = 3; const double law_period = 0.001;'
    assert run_of(made(folder / 'fits.so', after=fits)).fault is None


def test_two_runs_at_once_are_told(good):
    values = {'law': 'good', 'custom_laws': [str(good)], 'duration': SHORT}
    configuration = configure(resolve('paper_circle', values))
    one, other = parts(configuration, 50), parts(configuration, 50)
    assert next(one).fault is None
    assert next(other).fault is None
    assert next(one).fault[1].text.startswith('two runs ask the same process of a law')


def test_an_fmu_of_it_is_refused(good, tmp_path, capsys):
    out = tmp_path / 'x.fmu'
    assert main(['fmu', 'law', str(good), '--out', str(out)]) == 2
    assert 'good is a foreign law: an FMU is made of kernels' in capsys.readouterr().err
    assert not out.exists()


@pytest.fixture(scope='module')
def recorded(folder):
    """A bag of a law, and the law."""
    file, bag = made(folder / 'mine.so'), folder / 'bag'
    words = ['--law', str(file), '--duration', str(SHORT), '--out', str(bag)]
    assert main(['simulate', 'paper_circle', *words]) == 0
    return bag, file


@pytest.mark.parametrize('command', ['replay', 'rerun'])
def test_a_bag_runs_it_when_its_user_says_so(recorded, tmp_path, capsys, command):
    bag, _ = recorded
    out = ['--out', str(tmp_path / 'again')] if command == 'rerun' else []
    assert main([command, str(bag), *out]) == 2
    err = capsys.readouterr().err
    assert err.count('\n') == 1 and 'holds the code of the law mine' in err and '--trust' in err
    assert main([command, str(bag), *out, '--trust']) == 0
    assert 'identical' in capsys.readouterr().out


@pytest.mark.parametrize('command', ['replay', 'rerun'])
def test_a_bag_runs_no_other_file_in_its_place(recorded, capsys, monkeypatch, command):
    monkeypatch.setattr(law, '_channels', {})  # as in another process
    bag, file = recorded
    content = file.read_bytes()
    try:
        file.write_bytes(content + b'x')
        assert main([command, str(bag), '--trust']) == 2
        assert f'{file} is not the file that is meant' in capsys.readouterr().err
        file.unlink()
        assert main([command, str(bag), '--trust']) == 2
        assert f'{file} cannot be read' in capsys.readouterr().err
    finally:
        file.write_bytes(content)
    assert not bag.with_name('bag_rerun').exists()


def test_a_terminal_shows_its_path_and_digest(recorded):
    bag, file = recorded
    source = bag_reader.read(bag, (), lambda *_: None).sources['custom_laws']['mine'].decode()
    assert repr(str(file)) in source
    assert hashlib.sha256(file.read_bytes()).hexdigest() in source
    assert not any(line in source for line in ('law_update', 'torque'))


def test_a_sweep_has_the_runs_of_the_same_law_in_python(tmp_path):
    library = compiled(tmp_path / 'example_law.so', (DOCS / 'example_law.c').read_text())
    (tmp_path / 'study.yaml').write_text(TEXT)
    tables = []
    for file in (library, DOCS / 'example_law.py'):
        out = tmp_path / file.suffix[1:]
        words = ['--laws', str(file), '--runs', '3', '--workers', '1', '--out', str(out)]
        assert main(['sweep', str(tmp_path / 'study.yaml'), *words]) == 0
        tables.append(runs(out).to_pydict())
    assert tables[0] == tables[1] and len(tables[0]['row']) == 3


WAITS = """
import sys
from parallel_robot_control.foreign.channel import Channel
from parallel_robot_control.foreign.process import WORD, question_length
channel = Channel(sys.argv[1], {}, 3)
channel._socket.send(bytes(WORD * question_length(3)))
print(channel._process.pid, flush=True)
sys.stdin.read()
"""


@pytest.mark.parametrize('body', ['for (;;);', 'return 0;'], ids=['busy', 'idle'])
def test_its_process_ends_with_the_one_that_asks_and_leaves_nothing(tmp_path, monkeypatch, body):
    (tmp_path / 'temporary').mkdir()
    monkeypatch.setenv('TMPDIR', str(tmp_path / 'temporary'))
    head = 'int32_t law_update(const law_input *in, law_output *out)'
    source = f'#include "parallel_robot_law.h"\n{head} {{ {body} }}'
    words = [sys.executable, '-c', WAITS, str(compiled(tmp_path / 'law.so', source))]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as asking:
        ends = select.poll()
        number = asking.stdout.readline().decode()
        ends.register(os.pidfd_open(int(number)), select.POLLIN)
        asking.kill()
    assert ends.poll(60_000) and not [*(tmp_path / 'temporary').glob('*law*')]


@pytest.fixture
def crashing(node, folder, monkeypatch):
    """A node whose law has ended its process, its law, and what gives it some states."""
    file = made(folder / 'crashing.so', 'abort();')
    more = {'law': 'crashing', 'custom_laws': [str(file)]}
    monkeypatch.setattr(
        controller_node, 'resolve', lambda scenario, changed: resolve(scenario, changed | more)
    )
    one, commands = node(controller_node.ControllerNode, topics.COMMANDS)
    values = resolve('paper_circle')
    message, motion = Simulator(configure_plant(values)).message, trajectory_of(values)
    stamps = iter(range(10**9, 2 * 10**9, 10**6))  # ns

    def give(count):
        for stamp, _ in zip(stamps, range(count), strict=False):
            now = Time(nanoseconds=stamp, clock_type=ClockType.ROS_TIME)
            one.get_clock().set_ros_time_override(now)
            reference = motion.sample(np.zeros(1))
            one._on_reference(
                reference_messages(one.loop.joints, np.array([stamp]), reference)[0].tobytes()
            )
            one._on_state(message(stamp))
        return one._controller.fault

    assert give(20) == faults.NONE and give(1) == faults.TORQUE_NOT_FINITE
    yield one, file, give
    assert len(commands) > 21


def cleared(one):
    return one._answer_clear_fault(Trigger.Request(), Trigger.Response())


@pytest.mark.parametrize('node', ['wall'], indirect=True)
def test_a_node_starts_its_process_again_when_its_fault_is_cleared(crashing, monkeypatch):
    one, _, give = crashing
    works = []
    monkeypatch.setattr(one.background, 'do', works.append)
    told = 'the process of the law crashing has ended and starts again: clear once more'
    for _ in range(2):
        assert cleared(one).message == told
    assert give(5) == faults.TORQUE_NOT_FINITE
    for work in works:
        work()
    assert give(5) == faults.TORQUE_NOT_FINITE  # until a person says so
    assert cleared(one).success and give(20) == faults.NONE
    assert give(1) == faults.TORQUE_NOT_FINITE


@pytest.mark.parametrize('node', ['wall'], indirect=True)
def test_a_node_runs_no_other_file_when_a_fault_is_cleared(crashing):
    one, file, give = crashing
    content = file.read_bytes()
    file.write_bytes(content + b'x')
    for _ in range(2):
        assert not cleared(one).success and give(1) == faults.TORQUE_NOT_FINITE
    with pytest.raises(InputError, match='is not the file that is meant'):
        one.prepare_change({'law': 'crashing'})
    file.write_bytes(content)
    assert one.prepare_change({'law': 'crashing'})[0] == {'law': 'crashing'}
    assert cleared(one).success and give(20) == faults.NONE
