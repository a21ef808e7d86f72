"""What the live page shows of a bag and of a graph, without a server."""

import asyncio
from contextlib import ExitStack

import numpy as np
import pytest

from parallel_robot.analysis import evaluated_bag
from parallel_robot.analysis.frames import Frames
from parallel_robot.bags.bag_reader import BagView
from parallel_robot.bags.run import recording
from parallel_robot.cli.command_line import main
from parallel_robot.live import bag_source
from parallel_robot.live.bag_source import BagSource, open_bag
from parallel_robot.live.frames import HEADER
from parallel_robot.live.graph_source import GraphSource, known_values, meant
from parallel_robot.live.source import Description, RefusedError, laws_and_shapes
from parallel_robot.watch.robots import OK, Robots
from parallel_robot_model.common.errors import UnknownNameError
from parallel_robot_model.robots.registry import robot_of


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    found = tmp_path_factory.mktemp('bag') / 'bag'
    assert main(['simulate', 'paper_circle', '--duration', '0.5', '--out', str(found)]) == 0
    return found


@pytest.fixture
def clock():
    return [100.0]


@pytest.fixture
def source(bag, clock):
    with ExitStack() as stack:
        made = open_bag(stack, bag, False)
        parts = (made._log, made._past, made._configuration)
        yield BagSource(*parts, lambda: clock[0])


def heads(frames):
    """Number of the layout, time and seconds of each frame."""
    return [HEADER.unpack_from(frame)[1:4] for frame in frames]


def near(seconds):
    """But for a state: the clock is not that of the states."""
    return pytest.approx(seconds, abs=1.1e-3)


def act(source, *words):
    return asyncio.run(source.act(*words))


def test_a_bag_plays_at_its_speed_and_ends(source, clock):
    assert [time for _, time, _ in heads(source.look())] == [0.0]
    clock[0] += 0.1
    first = heads(source.look())
    assert first[-1][1] == near(0.1) and sum(s for *_, s in first) == near(0.1)
    act(source, 'speed', 0.5)
    clock[0] += 0.1
    assert heads(source.look())[-1][1] == near(0.15)
    act(source, 'play', False)
    clock[0] += 5.0
    assert source.look() == [] and not source.texts()['bag']['playing']
    act(source, 'play', True)
    clock[0] += 5.0
    assert heads(source.look())[-1][1] == 0.5 and not source.texts()['bag']['playing']
    act(source, 'play', True)  # once more from the start
    assert heads(source.look())[-1][1] == 0.0


@pytest.mark.parametrize('key', ['true_robot.l1=0.4005', 'sensor.delay=0.002', 'seed=3'])
def test_what_may_not_be_the_true_motion_is_called_seen(key, tmp_path, capsys):
    bag, seen = tmp_path / 'bag', key != 'seed=3'
    words = ['simulate', 'paper_circle', '--duration', '0.1', '--set', key, '--out', str(bag)]
    assert main(words) == 0
    with ExitStack() as stack:
        assert open_bag(stack, bag, False).texts()['setup']['seen'] == seen
    assert main(['export', str(bag), '--foxglove', str(tmp_path / 'copy')]) == 0
    assert ('frames of the robot, seen' in capsys.readouterr().out) == seen
    whole = recording.read(bag).log
    _, path = Frames(lambda: iter([whole]), len(whole.time), seen)._paths(0).markers
    assert path.ns == 'end effector' + ', seen' * seen


def test_a_jump_shows_the_past_of_a_moment_under_another_number(source):
    number = heads(source.look())[-1][0]
    assert act(source, 'seek', 0.25) == '0.250 s'
    past = heads(source.look())
    assert {n for n, *_ in past} == {number + 1} == {source.texts()['layout']['number']}
    times = [time for _, time, _ in past]
    assert times[-1] == pytest.approx(0.25) and times == sorted(times) and len(times) > 5
    act(source, 'step', 1)
    assert heads(source.look())[-1][1] == pytest.approx(0.251)
    act(source, 'step', -1)
    assert heads(source.look())[-1][1] == pytest.approx(0.25)
    act(source, 'seek', 99)
    assert heads(source.look())[-1][1] == 0.5


@pytest.mark.parametrize(
    ('action', 'value'),
    [
        ('seek', 'x'), ('seek', True), ('seek', float('nan')), ('seek', [1]), ('speed', 0),
        ('speed', 1e9), ('step', None), ('ghost', 'no_such_law'), ('ghost', 7),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_and_changes_nothing(action, value, source):
    source.look()
    before = source.texts()
    with pytest.raises(RefusedError):
        act(source, action, value)
    assert source.texts() == before and source.look() == []


def test_the_ghost_of_the_law_that_ran_asks_for_what_it_did(source):
    act(source, 'ghost', 's_fotsmc')
    act(source, 'seek', 0.4)
    data = source.look()[-1]
    curves = np.frombuffer(data, '<f4')[-24:].reshape(12, 2)
    assert np.isfinite(curves).all()
    torque, ghost = curves[6:9], curves[9:]
    # The torque of a state acts in the next step: extremes of a smooth motion hardly differ.
    np.testing.assert_allclose(ghost, torque, atol=0.05)


def test_code_that_others_name_is_not_opened(tmp_path):
    trap = tmp_path / 'trap.py'
    trap.write_text(f'open({str(tmp_path / "sprung")!r}, "w")')
    robot = {'robot_model': 'trap', 'custom_robots': [str(trap)], 'custom_laws': [str(trap)]}
    with pytest.raises(UnknownNameError):
        robot_of(known_values({'controller': robot}, None))
    found = known_values({'controller': {'custom_laws': [str(trap)], 'scenario': str(trap)}}, None)
    assert found['custom_laws'] == found['custom_robots'] == []
    assert not (tmp_path / 'sprung').exists()


def test_values_of_the_nodes_win_over_those_of_the_scenario():
    heard = {
        'controller': {'scenario': 'paper_line', 'robot.l1': 0.21, 'nobody': 1, 'period': None},
        'trajectory': {'trajectory.shape': 'circle'},
    }
    found = known_values(heard, None)
    assert (found['robot.l1'], found['trajectory.shape']) == (0.21, 'circle')
    assert found['period'] == 1e-3 and 'nobody' not in found


@pytest.mark.parametrize(
    ('present', 'value', 'expected'),
    [
        (1.0, 2, 2.0), (1.0, 2.5, 2.5), ([1.0, 2.0], 3, [3.0, 3.0]), ([1.0], [3, 4.5], [3.0, 4.5]),
        ('a', 'b', 'b'), (1, 2, 2), (True, False, False), (1.0, '2', None), (1.0, True, None),
        (1.0, [1.0], None), ('a', 1, None), (1, 2.5, None), (True, 1, None), ([1.0], ['x'], None),
        (1.0, 10**400, None),
    ],
)  # fmt: skip
def test_a_value_gets_the_type_of_its_parameter(present, value, expected):
    if expected is None:
        with pytest.raises(RefusedError, match=r'smc\.z must be'):
            meant('smc.z', present, value)
    else:
        found = meant('smc.z', present, value)
        assert found == expected and type(found) is type(expected)


def test_units_and_ranges_are_those_that_the_node_tells():
    told = {
        'smc.z': Description('slope [1/s]', 0.0, float('inf')),
        'smc.shape': Description('a form', None, None),
        'pid.Kp': Description('gain [N m/rad]', 0.0, 1e5),
    }
    controller = {'smc.z': 20.0, 'smc.shape': 'sign', 'law': 'smc', 'period': 1e-3}
    found = laws_and_shapes({'controller': controller}, {'controller': told}, ['smc'])
    assert found['gains'] == {
        'smc': [
            {
                'key': 'smc.z', 'name': 'z', 'value': 20.0,
                'text': 'slope', 'unit': '1/s', 'low': 0.0, 'high': None,
            },
            {
                'key': 'smc.shape', 'name': 'shape', 'value': 'sign',
                'text': 'a form', 'unit': '', 'low': None, 'high': None,
            },
        ]
    }  # fmt: skip
    assert found['laws'] == [{'name': 'smc', 'title': 'SMC'}]


MOTION = {
    'circle.radius': 0.03, 'line.end': [0.46, 0.41], 'trajectory.shape': 'circle',
    'trajectory.lookahead': 0.02, 'trajectory.transition': 2.0, 'robot.l1': 0.2, 'period': 1e-3,
    'granted.motion': '2 points',
}  # fmt: skip
FIXED = ('robot.l1', 'period', 'trajectory.lookahead')
OF_MOTION = {key: Description('radius [m]', 0.0, np.inf, key in FIXED) for key in MOTION}
DESCRIBED = {'trajectory': OF_MOTION}


def test_shapes_are_offered_with_what_can_be_changed_of_them():
    found = laws_and_shapes({'trajectory': MOTION}, DESCRIBED, [])
    assert found['shape'] == 'circle'
    names = {shape: [one['name'] for one in own] for shape, own in found['shapes'].items()}
    assert names == {'circle': ['radius', 'transition'], 'line': ['end', 'transition']}
    assert found['shapes']['circle'][0] == {
        'key': 'circle.radius', 'name': 'radius', 'value': 0.03,
        'text': 'radius', 'unit': 'm', 'low': 0.0, 'high': None,
    }  # fmt: skip


class Graph:
    """A graph that notes what it is asked for and answers at once."""

    def __init__(self):
        self.parameters = {'controller': {'smc.z': 20.0, 'period': 1e-3}, 'trajectory': MOTION}
        self.descriptions, self.asked = DESCRIBED, []

    def watch(self, namespace):
        self.watched = namespace

    def set_parameter(self, node, key, value, tell):
        self.asked.append((node, key, value))
        tell(key != 'law', 'there is no such law')

    def emergency_stop(self, tell):
        self.asked.append('stop')
        tell(True, 'stopped')


@pytest.fixture
def graph():
    graph, robots = Graph(), Robots()
    values = {'laws': 'smc, pid'}
    robots.report(0.0, 'controller: loop', '/left/controller', OK, 'ok', values)
    source = GraphSource(graph, robots, None, '/left')
    source._watched.parameters = graph.parameters
    return source, graph


def test_a_node_refuses_in_its_own_words(graph):
    source, nodes = graph
    assert nodes.watched == '/left'
    with pytest.raises(RefusedError, match=r'^there is no such law$'):
        act(source, 'law', 'fuzzy')
    assert act(source, 'emergency_stop', None) == 'stopped'
    act(source, 'gain', {'key': 'smc.z', 'value': 25})
    act(source, 'motion', {'key': 'circle.radius', 'value': 0})
    act(source, 'motion', {'key': 'trajectory.shape', 'value': 'line'})
    assert nodes.asked == [
        ('controller', 'law', 'fuzzy'), 'stop', ('controller', 'smc.z', 25.0),
        ('trajectory', 'circle.radius', 0.0), ('trajectory', 'trajectory.shape', 'line'),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ('action', 'value'),
    [
        ('gain', {'key': 'period', 'value': 1.0}), ('gain', {'key': 'smc.no', 'value': 1.0}),
        ('gain', {'key': 'smc.z', 'value': 'x'}), ('gain', {'key': ['smc.z'], 'value': 1.0}),
        ('gain', 7), ('gain', {'key': 'smc.z'}), ('law', 7), ('law', 'x' * 1000),
        ('ghost', 'smc'), ('motion', 7), ('motion', {'key': 'circle.radius', 'value': 'x'}),
        ('motion', {'key': 'robot.l1', 'value': 0.3}), ('motion', {'key': 'period', 'value': 1.0}),
        ('motion', {'key': 'trajectory.lookahead', 'value': 0.3}),
        ('motion', {'key': 'granted.motion', 'value': 'x'}),
        ('motion', {'key': 'law', 'value': 'pid'}),
    ],
)  # fmt: skip
def test_what_is_no_request_reaches_no_node(action, value, graph):
    source, nodes = graph
    with pytest.raises(RefusedError):
        act(source, action, value)
    assert nodes.asked == []


def test_a_gain_has_the_range_that_its_own_node_tells_and_is_no_shape_of_the_motion():
    """Another node that was given it, too, says nothing of it."""
    nodes = {'controller': {'smc.z': 2.0}, 'trajectory': {'smc.z': 2.0, **MOTION}}
    own, silent = Description('gain [1/s]', 0.0, 9.0), Description('', None, None)
    told = {'controller': {'smc.z': own}, 'trajectory': {'smc.z': silent, **OF_MOTION}}
    found = laws_and_shapes(nodes, told, ['smc'])
    assert found['gains']['smc'] == [
        {'key': 'smc.z', 'name': 'z', 'value': 2.0, 'text': 'gain', 'unit': '1/s', 'low': 0.0,
         'high': 9.0},
    ]  # fmt: skip
    assert set(found['shapes']) == {'circle', 'line'}


def test_a_long_bag_plays_from_windows(tmp_path, monkeypatch):
    """It shows what it shows as a whole, and holds a few seconds of it."""
    bag = tmp_path / 'bag'
    assert main(['simulate', 'paper_circle', '--duration', '6', '--out', str(bag)]) == 0
    monkeypatch.setattr(evaluated_bag, 'LONG', 1.0)
    monkeypatch.setattr(bag_source, 'AHEAD', 0.7)
    for name, seconds in (('AHEAD', 0.7), ('PAST', 0.5), ('NEAR', 0.2)):
        monkeypatch.setattr(bag_source, name, seconds)
    steps = [
        ('play', True, 0.0), ('speed', 1.0, 0.5), ('speed', 2.0, 0.5), ('seek', 4.0, 0.0),
        ('step', 1.0, 0.1), ('step', -1.0, 0.0), ('step', -1.0, 0.0), ('play', True, 0.4),
        ('ghost', 'smc', 0.3), ('seek', 0.3, 0.3), ('ghost', '', 0.3), ('seek', 5.5, 0.9),
        ('play', True, 0.2),
    ]  # fmt: skip
    shown, clock = [], [100.0]
    for small in (1 << 40, 0):
        monkeypatch.setattr(evaluated_bag, 'SMALL', small)
        clock[0] = 100.0
        with ExitStack() as stack:
            source = open_bag(stack, bag, False, clock=lambda: clock[0])
            frames = [source.look()]
            for action, value, passed in steps:
                act(source, action, value)
                clock[0] += passed
                frames += [source.look(), source.texts()]
                held = len(source._log.time)
                assert held < 3000 or small
        shown.append(frames)
    assert shown[0] == shown[1]


def test_a_part_of_a_long_bag_begins_and_ends_where_it_was_asked_for(bag, monkeypatch):
    monkeypatch.setattr(evaluated_bag, 'SMALL', 0)
    monkeypatch.setattr(evaluated_bag, 'LONG', 0.1)
    with ExitStack() as stack:
        source = open_bag(stack, bag, False, BagView(start=0.2, stop=0.3))
        assert heads(source.look())[0][1] == 0.2
        assert source.texts()['bag']['duration'] == 0.3
