"""The command `top`: what is known of robots, what is shown of them, and what the keys do."""

import asyncio
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from rich.console import Console
from sensor_msgs.msg import JointState

from parallel_robot.cli import top as view
from parallel_robot.cli.command_line import main
from parallel_robot.cli.commands import top
from parallel_robot.cli.top import Top
from parallel_robot.watch import robots as joint_angles
from parallel_robot.watch.robots import ERROR, GONE, OK, SILENT, JointAngle, Robots

pytest_plugins = ['ros_fixtures']

ROOT = Path(__file__).parents[1]
FIGURES = {
    'plant': {'state': '12034', 'round trip p50/p99/max [ms]': '0.31/0.604/7.4'},
    'controller': {'law': 's_fotsmc', 'laws': 'smc, s_fotsmc, pid', 'limits that acted': 'none'},
}


def report(robots, node, *, now=0.0, level=OK, text='ok', **figures):
    """Let a node say something, by its full name."""
    name = node.rpartition('/')[2]
    values = {**FIGURES.get(name, {}), **{key: str(value) for key, value in figures.items()}}
    robots.report(now, f'{name}: loop', node, level, text, values)


@pytest.fixture
def robots():
    """Two robots, of which the left one has a recorder."""
    robots = Robots()
    for name in ('recorder', 'plant', 'controller', 'trajectory'):
        report(robots, f'/left/{name}')
    report(robots, '/plant')
    return robots


def drawn(robots, shown, now=0.0, width=80):
    """Lines of the screen, as in a pipe."""
    console = Console(width=width, color_system=None, force_terminal=False)
    with console.capture() as capture:
        console.print(view.screen(robots, shown, '7', now, width))
    return capture.get().splitlines()


def row(lines, word):
    """Words of the line that begins with a word."""
    (found,) = (line for line in lines if line.strip('│ ').startswith(word))
    return found.strip('│ ').split()


STEP = 10**7  # ns, between two poses
STAMP = 1_790_000_000_000_000_000  # ns


def path(stamp):
    """Where the platform should be at a stamp."""
    return np.array([31e-3, -12e-3]) * (stamp - STAMP) * 1e-9


@pytest.mark.parametrize('phase', [0, 3 * 10**6])
@pytest.mark.parametrize('ahead', [0, 20])
def test_poses_are_compared_with_the_reference_at_their_stamp(phase, ahead, robots):
    """On whatever grid, and however far ahead the references come."""
    robot, errors = robots[''], np.random.default_rng(1).normal(size=(50, 2))
    for k in range(50 + ahead):
        stamp = STAMP + phase + k * STEP
        robot.pose_reference(stamp, *path(stamp))
        if k >= ahead:
            stamp = STAMP + (k - ahead) * STEP
            robot.pose(stamp, *(path(stamp) + errors[k - ahead]))
    robots.look(0.0)
    known = np.linalg.norm(errors[1 if phase else 0 :], axis=1)  # from the first reference on
    assert robot.error.rms == pytest.approx(np.sqrt((known**2).mean()), abs=1e-8)
    assert robot.error.largest == pytest.approx(known.max(), abs=1e-8)
    robots.look(0.5)
    assert robot.error is None and math.isnan(robot.history[-1])


def test_a_pose_waits_for_its_reference_but_not_across_a_gap(robots):
    robot = robots['']
    robot.pose_reference(STAMP, 0.0, 0.0)
    robot.pose(STAMP + STEP, 3.0, 4.0)
    robots.look(0.0)
    assert robot.error is None
    robot.pose_reference(STAMP + 2 * STEP, 0.0, 0.0)
    robots.look(0.5)
    assert robot.error == (5.0, 5.0)
    robot.pose(STAMP + 3 * STEP, 3.0, 4.0)
    robot.pose_reference(STAMP + 200 * STEP, 0.0, 0.0)
    robots.look(1.0)
    assert robot.error is None


def test_a_new_run_begins_anew(robots):
    robot = robots['']
    for stamp, x in ((2 * STAMP, 9.0), (STAMP, 1.0)):
        robot.pose(stamp, x, 0.0)
        robot.pose_reference(stamp, 0.0, 0.0)
    robot.pose(STAMP + 1, math.nan, 0.0)
    robot.pose_reference(STAMP + 2, 0.0, 0.0)
    robots.look(0.0)
    assert robot.error == (1.0, 1.0)


def test_robots_are_told_apart(robots):
    assert robots.names() == ['', '/left']
    report(robots, '/left/controller', law='smc')
    assert robots['/left'].law == 'smc' and robots[''].law == ''
    robots.report(0.0, 'motor 1', '/left/motor', ERROR, 'hot', {})  # of another suite
    robots.report(0.0, 'motor: loop', 'motor', ERROR, 'hot', {})
    assert set(robots['/left'].nodes) == {'recorder', 'plant', 'controller', 'trajectory'}


def test_a_fault_is_known_from_either_message(robots):
    robot = robots['/left']
    assert (robot.law, robot.fault, robot.limits) == ('s_fotsmc', 'none', 'none')
    robot.status({'law': 'pid', 'fault': 'emergency stop', 'limits that acted': 'torque limit'})
    assert (robot.law, robot.fault, robot.limits) == ('pid', 'emergency stop', 'torque limit')
    report(robots, '/left/controller', level=ERROR, text='fault: no reference came for too long')
    assert robot.fault == 'no reference came for too long'
    report(robots, '/left/controller', text='joint states that are too old', level=1)
    assert robot.fault == 'none'


def test_a_node_that_says_nothing_is_silent_then_gone(robots):
    report(robots, '/left/plant', now=5.0)
    robots.look(5.0)
    lines = drawn(robots, '/left', SILENT + 1.0)
    assert row(lines, 'controller')[-4:] == ['silent', 'for', '4', 's']
    assert row(lines, 'plant')[-1] == 'ok'
    robots.look(GONE + 1.0)
    assert set(robots['/left'].nodes) == {'plant'} and robots['/left'].law == ''
    robots.look(GONE + 6.0)
    assert robots.names() == []
    assert any('waiting for the nodes' in line for line in drawn(robots, '/left'))


def test_the_screen_shows_what_is_known(robots):
    figures = {'rate [Hz]': 998.04, 'processor [%]': 24.06, 'answered': 998, 'skipped': 2}
    times = {'lag p50/p99/max [ms]': '1.0/2.0/31.25', 'real-time priority': 'FIFO 40'}
    report(robots, '/left/controller', **figures, **times)
    robots['/left'].pose(1, 3e-6, 4e-6)
    robots['/left'].pose_reference(1, 0.0, 0.0)
    robots.look(0.0)
    lines = drawn(robots, '/left')
    assert {len(line) for line in lines} == {80} and len(lines) <= 22
    assert row(lines, 'parallel_robot') == [
        'parallel_robot', 'top', '/left', '(2', 'of', '2)',
        'state', '12034,', 'ROS', 'domain', '7',
    ]  # fmt: skip
    names = [line.split()[1] for line in lines[2:7]]
    assert names == ['node', 'trajectory', 'plant', 'controller', 'recorder']
    assert ' '.join(row(lines, 'controller')) == 'controller 998 Hz 24.1 % FIFO 40 - ok'
    assert row(lines, 'recorder') == ['recorder', '-', '-', '-', '-', 'ok']
    text = ' '.join(' '.join(lines).split())
    for shown in (
        'law s_fotsmc', 'fault none', 'limits none', 'lag 1.00 2.00 31.2',
        'round trip 0.310 0.604 7.40', 'delay - - -',
        'answered 998, skipped 2', '5.00 µm rms, 5.00 µm max',
    ):  # fmt: skip
        assert shown in text, text


@pytest.mark.parametrize(
    ('granted', 'shown'),
    [
        ('SCHED_FIFO 20, memory locked', 'FIFO 20 locked'),
        ('normal, slice 0.1 ms, memory locked', 'slice 0.1 ms locked'),
        ('normal, slice 0.1 ms', 'slice 0.1 ms -'),
        ('nice -10', 'nice -10 -'),
        ('normal, memory locked', 'normal locked'),
    ],
)
def test_nothing_is_cut_at_80_columns(granted, shown, robots):
    says = 'joint states of two publishers, states that are too old, 2 publishers on reference'
    figures = {'rate [Hz]': 1000.3, 'processor [%]': 100.04, 'real-time priority': granted}
    report(robots, '/left/plant', text=says, **figures)
    report(robots, '/left/controller', answered=36_000_000, skipped=12_345)
    lines = drawn(robots, '/left')
    assert {len(line) for line in lines} == {80}
    assert ' '.join(row(lines, 'plant')).startswith(f'plant 1000 Hz 100.0 % {shown} joint states')
    text = ' '.join(word for line in lines for word in line.split() if word not in '│')
    assert says in text and 'answered 36000000, skipped 12345' in text
    assert '…' not in text


def test_a_robot_without_poses_has_no_panel_for_them(robots):
    def titled():
        return any('end-effector error' in line for line in drawn(robots, '/left'))

    assert not titled()
    robots['/left'].pose(1, 3e-6, 4e-6)
    robots.look(0.0)
    assert titled()
    robots.look(0.5)  # also when no more poses come
    assert titled()


def state(names, position, velocity=()):
    """A serialised joint state."""
    return serialize_message(JointState(name=names, position=position, velocity=velocity))


def test_the_joints_are_shown_as_they_turn(robots):
    """Those of the controller, in its order; without one, all that a message has."""
    names = ['wrist', 'joint2', 'gripper', 'joint1']
    joints = joint_angles.read_joints(
        state(names, [0.5, -1.25, 2.0, 3.14159], [0.0, 0.1, 0.0, -0.02])
    )
    robots[''].take_joints(5.0, joints)
    frame = drawn(robots, '', 5.5)
    start = next(k for k, line in enumerate(frame) if 'joints (rad, rad/s)' in line)
    assert frame[start + 1].strip('│ ').split() == [
        'wrist', '0.5000', '0.000', 'joint2', '-1.2500', '0.100',
    ]  # fmt: skip
    report(robots, '/controller', joints='joint1, joint2, joint9')
    lines = drawn(robots, '', 5.5)
    assert row(lines, 'joint1') == ['joint1', '3.1416', '-0.020', 'joint2', '-1.2500', '0.100']
    assert not any('gripper' in line for line in lines) and {len(line) for line in lines} == {80}
    assert 'joints' not in ' '.join(drawn(robots, '', 5.0 + SILENT))  # nothing is heard any more


def test_joints_that_are_not_told_are_no_numbers():
    (joint,) = joint_angles.read_joints(state(['a'], [1.0], [2.0, 3.0]))
    assert joint[:2] == ('a', 1.0) and math.isnan(joint.rate)
    data = state(['a', 'b'], [1.0, 2.0])
    assert len(joint_angles.read_joints(data)) == 2
    assert not any(joint_angles.read_joints(data[:k]) for k in range(len(data) - 12))
    assert joint_angles.read_joints(state(['a'] * 9000, [])) == ()


def test_nothing_hostile_reaches_the_terminal(robots):
    nasty = '\x1b[2J[bold]\r\n' + 'x' * 5000
    report(robots, '/left/plant', text=nasty, **{'rate [Hz]': nasty, 'state': nasty})
    robots['/left'].status({'law': nasty, 'fault': nasty, 'limits that acted': nasty})
    huge = [JointAngle(nasty, 1e300, math.inf), JointAngle('a' * 500, math.nan, -1e300)]
    robots['/left'].take_joints(0.0, tuple(huge * 500))
    for name in (nasty, f'{nasty}/{nasty}', '/left/' + nasty):
        robots.report(0.0, f'{name.rpartition("/")[2]}: loop', name, 7, nasty, {nasty: nasty})
    for namespace in robots.names():
        lines = drawn(robots, namespace)
        assert {len(line) for line in lines} == {80}
        assert all(character.isprintable() for line in lines for character in line)
    assert any('[bold]' in line for line in drawn(robots, '/left'))


def test_bars_grow_with_the_error():
    lengths = np.geomspace(1e-8, 1.0, 400)
    heights = [sum(view.BARS.index(view.bar(metres, k)) for k in range(3)) for metres in lengths]
    assert heights == sorted(heights) and set(heights) == set(range(1, 25))
    assert heights[0] == 1 and {h for h, m in zip(heights, lengths, strict=True) if m >= 0.01} == {
        24
    }
    assert [view.bar(math.nan, k) for k in range(3)] == [' '] * 3


@pytest.mark.parametrize(
    ('metres', 'text'),
    [(0.0, '0.00 µm'), (3.1e-6, '3.10 µm'), (9.994e-4, '999 µm'), (0.38, '380 mm')],
)
def test_lengths_are_said_in_a_unit_that_fits(metres, text):
    assert view.length(metres) == text


class FakeGraph:
    """Records what it is asked, and refuses what it is told to."""

    def __init__(self, refusal=''):
        self.asked = []
        self.refusal = refusal

    def look(self):
        pass

    def answers(self):
        pass

    def watch(self, namespace):
        self.asked.append(('watch', namespace))

    def switch_law(self, law, tell):
        self.asked.append(('law', law))
        tell(not self.refusal, self.refusal)

    def emergency_stop(self, tell):
        self.asked.append(('emergency stop',))
        tell(True, 'fault: emergency stop')

    def clear_fault(self, tell):
        self.asked.append(('clear fault',))
        tell(False, 'refused: the robot is too close to a singularity')


def pressed(robots, graph, *keys, namespace=None):
    """Lines of the screen after some keys."""

    async def press():
        app = Top(robots, graph, '7', namespace)
        async with app.run_test(size=(80, 24)) as pilot:
            for key in keys:
                await pilot.press(key)
                await pilot.pause()
            return [
                ''.join(segment.text for segment in strip)
                for strip in app.screen._compositor.render_strips()
            ]

    return asyncio.run(press())


def test_keys_switch_the_law(robots):
    graph = FakeGraph()
    lines = pressed(robots, graph, 'l', namespace='/left')
    assert [word for line in lines for word in line.split() if word in ('smc', 'pid')]
    lines = pressed(robots, graph, 'l', 'down', 'enter', namespace='/left')
    assert graph.asked[-1] == ('law', 'pid')  # that after the active one
    assert 'law pid: done' in '\n'.join(lines)
    pressed(robots, graph, 'l', 'up', 'escape', namespace='/left')
    assert graph.asked.count(('law', 'smc')) == 0


def test_a_late_tick_or_answer_finds_no_screen_and_does_no_harm(robots):
    app = Top(robots, FakeGraph(), '7', '/left')

    async def run():
        async with app.run_test(size=(80, 24)) as pilot:
            await pilot.pause()
            await app.query('Static').remove()
            app.look()
            app.action_clear_fault()

    asyncio.run(run())


def test_a_refusal_is_shown_with_its_reason(robots):
    graph = FakeGraph('refused: smc: [c] must be positive')
    lines = pressed(robots, graph, 'l', 'up', 'enter', namespace='/left')
    assert 'law smc: refused: smc: [c] must be positive' in '\n'.join(lines)


def test_keys_stop_and_clear(robots):
    graph = FakeGraph()
    lines = pressed(robots, graph, 'e')
    assert graph.asked[-1] == ('emergency stop',) and 'fault: emergency stop' in '\n'.join(lines)
    lines = pressed(robots, graph, 'c')
    assert graph.asked[-1] == ('clear fault',) and 'too close to a singularity' in '\n'.join(lines)


def test_the_first_robot_is_shown_then_the_next(robots):
    graph = FakeGraph()
    shown = [row(pressed(robots, graph, *'n' * k), 'parallel_robot')[2] for k in range(3)]
    assert shown == ['/', '/left', '/']
    assert [asked[1] for asked in graph.asked] == ['', '', '/left', '', '/left', '']


def test_without_a_controller_there_is_no_law_to_choose():
    lines = pressed(Robots(), FakeGraph(), 'l', 'q')
    assert 'no controller' in '\n'.join(lines)


def test_a_robot_that_appears_later_is_found(robots):
    late, graph = Robots(), FakeGraph()
    graph.look = lambda: report(late, '/right/plant')
    assert row(pressed(late, graph), 'parallel_robot')[2] == '/right'
    assert row(pressed(late, graph, namespace='/left'), 'parallel_robot')[2] == '/left'


def test_without_its_libraries_the_command_says_how_to_get_them():
    code = (
        'import sys; sys.modules.update(textual=None, rich=None)\n'
        "from parallel_robot.cli.command_line import main; sys.exit(main(['top']))"
    )
    done = subprocess.run([sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 2 and done.stderr.count('\n') == 1
    assert "pip install 'parallel_robot[top]'" in done.stderr


def test_where_nothing_runs_a_pipe_gets_one_line(domain, monkeypatch, capsys):
    monkeypatch.setattr(top, 'PATIENCE', 0.0)
    for words, place in (
        (['top'], 'in ROS'),
        (['top', '--namespace', 'a'], 'namespace /a of ROS'),
    ):
        assert main(words) == 1
        out, err = capsys.readouterr()
        assert out == '' and err.count('\n') == 1 and f'{place} domain {domain}' in err
