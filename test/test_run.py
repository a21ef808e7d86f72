"""The command `run`: real nodes, real bags, and nothing left behind."""

import json
import os
import pty
import re
import resource
import signal
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from bags import content
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from ros_fixtures import PATIENCE, ROOT, SLOW_LOOP, Child, until
from rosbags.rosbag2 import Reader
from warm_process import children

from parallel_robot.analysis.replay import replayed
from parallel_robot.analysis.report.charts import charts
from parallel_robot.analysis.report.page import plot
from parallel_robot.analysis.report.runs import read_runs
from parallel_robot.bags import history
from parallel_robot.bags.files.bag_files import CHANGES
from parallel_robot.bags.run import recording
from parallel_robot.bags.writing.recovery import recover
from parallel_robot.cli.command_line import main
from parallel_robot.live.bag_source import open_bag
from parallel_robot_control.configuration import configure
from parallel_robot_model.messages import topics
from parallel_robot_model.processes.child_process import command
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

COMMAND_LINE = 'parallel_robot.cli.command_line'
ENDS = {'SIGINT': 130, 'SIGTERM': 143, 'SIGHUP': 129}  # signals, and exit codes then


@pytest.fixture
def start(launch, domain):
    """Start `run` for some seconds of motion."""

    def start(out, seconds, *words, **options):
        return launch(COMMAND_LINE, 'run', 'paper_circle', '--duration', seconds,
                      '--out', out, *words, **options)  # fmt: skip

    return start


@pytest.fixture
def begin(start):
    """Start a `run` that a slow machine keeps up with; mostly it is ended by the test."""
    words = [word for key in SLOW_LOOP for word in ('--set', key.replace(':=', '='))]
    words += ['--set', 'plant.command_timeout=5']
    return lambda out, seconds=600.0, **options: start(out, seconds, *words, **options)


def test_a_run_in_real_time_is_complete(begin, tmp_path):
    process = begin('bag', 1.5, fresh=True)
    assert process.wait() == 0, process.stderr
    slow = (
        'warning: fault',
        'warning: limits acted',
        'warning: real time',
        'warning: controller: joint states are',
    )  # the machine stood still
    assert [line for line in process.stderr.splitlines() if not line.startswith(slow)] == []
    log = recording.read(tmp_path / 'bag').log
    assert log.start_stamp > 10**18 and log.start_stamp % 10**6 == 0
    assert np.array_equal(log.stamps, log.start_stamp + np.arange(301) * 5 * 10**6)
    assert not log.effort[0].any() and log.effort[-1].any()
    assert {*map(tuple, log.effort[1:])} <= {(0.0, 0.0, 0.0), *map(tuple, log.command)}
    assert not any(topic.missing for topic in log.messages.values())
    counts = {f'/{name}': topic.count for name, topic in log.messages.items()}
    assert counts.pop('/controller/status') >= 1  # one more for each fault and limit
    answered = int((~np.isnan(log.answer).any(axis=1)).sum())
    of_controller = [
        counts.pop(f'/{topic.name}') for topic in (*topics.TELEMETRY, topics.ANSWERED)
    ]
    assert min(of_controller) > 0 and max(of_controller) <= 32  # fewer where states were skipped
    assert 0 < answered <= counts.pop('/effort_controller/commands')
    assert counts == {
        '/joint_states': 301, '/reference': 301, '/pose': 31, '/pose_reference': 31,
        '/controller/active_law': 1,
    }  # fmt: skip
    for stream in content(tmp_path / 'bag' / 'bag_0.mcap').values():
        times = [time for time, _ in stream]
        assert times == sorted(times) and times[0] >= log.start_stamp
    assert main(['replay', str(tmp_path / 'bag')]) == 0


def test_a_change_during_the_run_is_in_the_bag_told_and_replayed(start, peer, tmp_path, capsys):
    process = start('bag', 8.0, '--time-mode', 'lockstep', '--format', 'json')
    for size, key, value in ((60_000, 's_fotsmc.G', 20.0), (600_000, 'law', 'pid')):
        nodes = under_way(process, tmp_path / 'bag', size)
        changed = [Parameter(key, value=value).to_parameter_msg()]
        with nodes[MODULES['plant']].paused():  # else the run may end before
            answer = peer.call(
                SetParameters, 'controller/set_parameters',
                SetParameters.Request(parameters=changed), process,
            )  # fmt: skip
        assert answer.results[0].successful
        process.until(lambda key=key: noted(tmp_path / 'bag', key))
    assert process.wait() == 0, process.stderr
    told = json.loads(process.stdout)
    assert told['law'] == 's_fotsmc, then pid' and told['steady']['xy_rms_m'] > 0.0
    past = recording.read(tmp_path / 'bag').history
    assert set(past.parameters) == {'/controller', '/plant', '/trajectory'}
    assert past.parameters['/controller']['s_fotsmc.G'] == 10.0
    in_lockstep = dict.fromkeys(past.parameters, 'normal')
    assert history.granted_priorities(past) == in_lockstep
    gain, law = past.changes
    assert gain.node == law.node == '/controller'
    assert gain.values['s_fotsmc.G'] == 20.0 and law.values['law'] == 'pid'
    assert 'limits acted: ramp after a take-over' in process.stderr
    assert main(['replay', str(tmp_path / 'bag')]) == 0
    log = recording.read(tmp_path / 'bag').log
    unaware = replayed.again(log, past._replace(changes=()), configure(log.config))
    assert unaware.differing.any()
    check_stretches(tmp_path / 'bag', capsys)


def check_stretches(bag, capsys):
    """Both changes are told with their times, and shown; each stretch has figures of its own."""
    capsys.readouterr()
    assert main(['analyze', str(bag)]) == 0
    out = capsys.readouterr().out
    assert 's_fotsmc, then pid, 8 s' in out
    (line,) = (line for line in out.splitlines() if 'changed while it ran' in line)
    told = re.search(r't = (.*) s: s_fotsmc.G 20.0; t = (.*) s: law pid$', line)
    assert told, line
    first, second = map(float, told.groups())
    assert 0.0 < first < second < 8.0
    assert re.search(rf'^  {second:g} to 8 s, pid: end-effector error, rms', out, re.MULTILINE)
    ((run,),) = read_runs([bag]).values()
    assert run.marks == pytest.approx([first, second])
    _, *over_time = (plot(chart, 'auto')['layout'] for chart in charts([run]))
    for layout in over_time:
        assert {shape['x0'] for shape in layout['shapes']} == {*run.marks}
    with ExitStack() as stack:
        texts = open_bag(stack, bag, False).texts()
    assert texts['bag']['changes'] == [
        [run.marks[0], 's_fotsmc.G 20.0'],
        [run.marks[1], 'law pid'],
    ]
    assert not texts['setup']['seen']


def under_way(process, bag, size=60_000):
    """Wait until there is motion in the bag, of some bytes; return the nodes."""
    process.until(lambda: any(file.stat().st_size > size for file in bag.glob('*.mcap')))
    nodes = process.children()
    assert set(nodes) == set(MODULES.values())
    return nodes


def noted(bag, key):
    """Whether a change of a key is in the bag."""
    (file,) = bag.glob('*.mcap')
    notes = file.read_bytes().split(CHANGES.encode())[1:]
    return any(key.encode() in note[:1000] for note in notes)


def check_end(bag, nodes):
    """No node is left, and everything up to the end is in the bag."""
    assert all(node.ended(PATIENCE) for node in nodes.values())
    log = recording.read(bag).log
    assert len(log.time) > 100 and log.messages['joint_states'].missing == 0
    assert (bag / 'metadata.yaml').is_file()


@pytest.mark.endurance
def test_a_node_that_dies_ends_the_run(begin, tmp_path):
    process = begin('bag')
    nodes = under_way(process, tmp_path / 'bag')
    nodes[MODULES['plant']].kill()
    assert process.wait() == 1
    assert process.stderr == 'parallel_robot run: plant ended with signal SIGKILL\n'
    check_end(tmp_path / 'bag', nodes)


HASTY = """
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import run

run.STANDSTILL = 2.0
"""


@pytest.mark.endurance
def test_a_controller_that_is_stopped_is_named(launch, domain, tmp_path):
    (tmp_path / 'hasty.py').write_text(HASTY)
    process = launch(
        'hasty', 'run', 'paper_circle', '--duration', 600, '--time-mode', 'lockstep',
        '--out', 'bag', PYTHONPATH=f'{ROOT}:{tmp_path}',
    )  # fmt: skip
    nodes = under_way(process, tmp_path / 'bag')
    signal.pidfd_send_signal(nodes[MODULES['controller']].descriptor, signal.SIGSTOP)
    assert process.wait() == 1
    assert re.fullmatch(
        r'parallel_robot run: the motion stands still at state \d+ of 600000: '
        r'no answer of controller\n',
        process.stderr,
    )
    check_end(tmp_path / 'bag', nodes)


@pytest.mark.endurance
def test_a_recorder_that_is_killed_leaves_its_chunks(begin, tmp_path):
    process = begin('bag')
    nodes = under_way(process, tmp_path / 'bag')
    nodes[MODULES['recorder']].kill()
    assert process.wait() == 1
    assert process.stderr.startswith('parallel_robot run: recorder ended with signal SIGKILL')
    log = recording.read(tmp_path / 'bag').log
    assert 'was not closed' in log.warnings[0] and log.messages['joint_states'].missing == 0
    assert len(log.time) > 100
    report = recover(tmp_path / 'bag', tmp_path / 'whole')
    again = recording.read(tmp_path / 'whole').log
    assert report.kept['/joint_states'] == len(log.time) == len(again.time)
    assert again.config == log.config and not again.warnings
    with Reader(tmp_path / 'whole') as reader:
        assert reader.message_count == report.kept.total()


def test_a_full_disk_ends_the_run_in_one_line(begin, tmp_path):
    process = begin('bag')
    nodes = under_way(process, tmp_path / 'bag')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    limit = file.stat().st_size + 100_000
    resource.prlimit(nodes[MODULES['recorder']].pid, resource.RLIMIT_FSIZE, (limit, limit))
    assert process.wait() == 1
    assert process.stderr == (
        'parallel_robot run: recorder ended with exit code 1: cannot write bag: File too large\n'
    )
    assert all(node.ended(PATIENCE) for node in nodes.values())
    assert limit - 100_000 < file.stat().st_size <= limit
    log = recording.read(tmp_path / 'bag').log
    assert len(log.warnings) == 1 and log.messages['joint_states'].missing == 0
    assert not (tmp_path / 'bag' / 'metadata.yaml').exists()


@pytest.mark.parametrize('name', ENDS)
def test_a_signal_while_a_simulation_is_written(name, launch, tmp_path):
    process = launch(COMMAND_LINE, 'simulate', 'paper_circle', '--duration', 60, '--out', 'bag')
    file = tmp_path / 'bag' / 'bag_0.mcap'
    process.until(lambda: file.exists() and file.stat().st_size > 60_000)
    assert process.end(getattr(signal, name)) == ENDS[name]
    assert process.stderr == ''
    log = recording.read(tmp_path / 'bag').log
    assert not log.warnings and 10 < len(log.time) < 60_000
    assert (tmp_path / 'bag' / 'metadata.yaml').is_file()


@pytest.fixture(scope='module')
def simulated(tmp_path_factory):
    """A bag of the whole circle."""
    bag = tmp_path_factory.mktemp('simulated') / 'bag'
    assert main(['simulate', 'paper_circle', '--out', str(bag)]) == 0
    return bag


@pytest.mark.parametrize('name', ENDS)
def test_a_signal_while_a_report_is_drawn_leaves_nothing_of_it(name, simulated, launch, tmp_path):
    process = launch('parallel_robot.__main__', 'report', str(simulated), '--out', 'report')
    process.until(lambda: [*tmp_path.glob('.report.*/report')])
    assert process.end(getattr(signal, name)) == ENDS[name]
    assert process.stderr == ''
    assert not [*tmp_path.glob('*report*')]


def test_a_recorder_that_is_stopped_early_is_no_success(begin, tmp_path):
    process = begin('bag')
    nodes = under_way(process, tmp_path / 'bag')
    signal.pidfd_send_signal(nodes[MODULES['recorder']].descriptor, signal.SIGTERM)
    assert process.wait() == 1
    assert 'recorder ended with exit code 1: stopped before the end' in process.stderr
    check_end(tmp_path / 'bag', nodes)


@pytest.mark.parametrize('name', ENDS)
def test_a_signal_ends_the_run_in_order(name, begin, tmp_path):
    """The plant first, so the robot is never without its controller, and nothing is missing."""
    process = begin('bag')
    nodes = under_way(process, tmp_path / 'bag')
    assert process.end(getattr(signal, name)) == ENDS[name]
    assert 'lost' not in process.stderr
    check_end(tmp_path / 'bag', nodes)
    log = recording.read(tmp_path / 'bag').log
    assert process.stdout.startswith(f'stopped by {name} after {log.time[-1]:.1f} s\n')
    assert 'end-effector error, rms' in process.stdout and '\nbag ' in process.stdout
    assert not log.command[-1].any() and log.command[:-1].any(axis=1).all()
    assert log.effort[-20:].any()  # 0.1 s; it went on for 0.7 s without torque once


@pytest.mark.endurance
def test_the_end_of_its_terminal_ends_the_run_in_order(domain, compiled, tmp_path):
    words = ['run', 'paper_circle', '--duration', '600', '--out', 'bag']
    words += [word for key in SLOW_LOOP for word in ('--set', key.replace(':=', '='))]
    pid, terminal = pty.fork()
    if not pid:
        os.chdir(tmp_path)
        os.environ['PYTHONPATH'] = str(ROOT)
        os.execv(sys.executable, command('parallel_robot', *words))
    files = tmp_path / 'bag'
    until(lambda: any(file.stat().st_size > 60_000 for file in files.glob('*.mcap')))
    nodes = {module: Child(one, os.pidfd_open(one)) for module, one in children(pid).items()}
    assert set(nodes) == set(MODULES.values())
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == ENDS['SIGHUP']
    check_end(files, nodes)
    assert not recording.read(files).log.command[-1].any()


def test_a_signal_before_the_motion_begins_leaves_nothing(begin, tmp_path):
    process = begin('bag')
    process.until(process.children)
    assert process.end(signal.SIGINT) == 130
    assert process.stderr == 'parallel_robot run: stopped by SIGINT\n'
    assert not (tmp_path / 'bag').exists()


@pytest.mark.endurance
@pytest.mark.skipif(not Path('/proc/self/stat').exists(), reason='needs Linux')
def test_no_node_outlives_its_supervisor(begin, tmp_path):
    process = begin('bag')
    nodes = under_way(process, tmp_path / 'bag')
    assert process.end(signal.SIGKILL) == -signal.SIGKILL
    check_end(tmp_path / 'bag', nodes)


def test_a_second_run_on_the_same_domain_leaves_the_first_alone(begin, start, tmp_path):
    first = begin('first')
    nodes = under_way(first, tmp_path / 'first')
    second = start('second', 1.0)
    assert second.wait() == 1 and 'ROS_DOMAIN_ID' in second.stderr
    assert first.end(signal.SIGINT) == 130
    check_end(tmp_path / 'first', nodes)


def test_hazards_leave_the_bag_that_the_simulation_has(start, tmp_path):
    said = [
        'states_lost at 0.2 for 0.6', 'clear_fault at 0.9', 'commands_lost at 1.0 for 0.1',
        'states_late delay 0.02 at 1.2 for 0.1', 'velocity_nan joint joint1 at 1.4 for 0.05',
    ]  # fmt: skip
    words = ['--set', f'hazards={said}']
    process = start('bag', 1.6, '--time-mode', 'lockstep', *words)
    assert process.wait() == 0, process.stderr
    simulated = ['simulate', 'paper_circle', '--duration', '1.6', *words]
    assert main([*simulated, '--out', str(tmp_path / 'simulated')]) == 0
    of_nodes, without = (
        {
            topic: [data for _, data in messages]
            for topic, messages in content(tmp_path / name / f'{name}_0.mcap').items()
        }
        for name in ('bag', 'simulated')
    )
    assert of_nodes == without
    assert len(of_nodes['joint_states']) == 1601 - 600 - 20
    assert main(['replay', str(tmp_path / 'bag')]) == 0
