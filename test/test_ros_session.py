"""The supervisor's patience: for those that work, not for those that hang."""

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from parallel_robot.cli import ros_session
from parallel_robot.cli.ros_session import Session
from parallel_robot_model.common.errors import RunError
from parallel_robot_model.nodes.background import STATE_INDEX
from parallel_robot_model.processes.node_processes import Work

ASKING = 0.5  # s, that a question takes


class World:
    """Two nodes, and a clock that goes on when they are asked."""

    def __init__(self):
        self.now = 100.0  # [s]
        self.ready_at = {'plant': 100.0, 'controller': 100.0}  # when a node begins to answer [s]
        self.there_at = {'plant': 100.0, 'controller': 100.0}  # when its service can be seen [s]
        self.share = {'plant': 0.0, 'controller': 0.0}  # of a core that a node uses until then
        self.held = {'plant': 0.0, 'controller': 0.0}  # share of the time in which others have it
        self.shown = []
        self.says = SimpleNamespace(success=True, message='')

    def work(self, name):
        time = min(self.now, self.ready_at[name]) - 100.0
        return Work(self.share[name] * time, self.held[name] * time)

    def wait(self, monkeypatch, seconds):
        monkeypatch.setattr(ros_session, 'time', SimpleNamespace(monotonic=lambda: self.now))
        session = Session(self.ready_at, lambda: None)
        session._node = SimpleNamespace(count_publishers=lambda _: 1)
        session._services = SimpleNamespace(
            ready=lambda service: self.now >= self.there_at[service.removesuffix('/ready')]
        )

        def call(service):
            self.now += ASKING
            return self.says if self.now >= self.ready_at[service.removesuffix('/ready')] else None

        monkeypatch.setattr(session, '_call', call)
        session.wait_until_ready(seconds, self.work, lambda names: self.shown.append([*names]))


def test_a_node_that_compiles_has_all_the_time_it_needs(monkeypatch):
    world = World()
    world.ready_at['controller'] = 700.0
    world.share['controller'] = 0.1  # of a busy machine
    world.wait(monkeypatch, seconds=20.0)
    assert 700.0 <= world.now < 702.0
    assert world.shown[0] == ['plant', 'controller'] and world.shown[-1] == ['controller']


@pytest.mark.parametrize('share', [0.0, 0.01])  # its middleware goes on
def test_a_node_that_hangs_is_an_error(share, monkeypatch):
    world = World()
    world.ready_at['controller'] = 700.0
    world.share['controller'] = share
    with pytest.raises(
        RunError, match=r'^controller is not ready after 20 s: it does not answer$'
    ):
        world.wait(monkeypatch, seconds=20.0)
    assert world.now < 125.0


def test_a_node_that_nobody_can_see_is_an_error_however_busy(monkeypatch):
    world = World()
    world.ready_at['plant'] = world.there_at['plant'] = 700.0
    world.share['plant'] = 1.0
    with pytest.raises(RunError, match='plant is not ready'):
        world.wait(monkeypatch, seconds=20.0)


@pytest.mark.parametrize('there_at', [100.0, 390.0])
def test_time_in_which_others_have_the_processors_does_not_count(there_at, monkeypatch):
    world = World()
    world.ready_at['controller'], world.there_at['controller'] = 400.0, there_at
    world.share['controller'], world.held['controller'] = 0.02, 0.96
    world.wait(monkeypatch, seconds=20.0)
    assert 400.0 <= world.now < 402.0


def test_a_node_that_stops_working_is_an_error_from_then_on(monkeypatch):
    world = World()
    world.ready_at['controller'] = 700.0
    world.share['controller'] = 0.5
    whole = world.work
    world.work = lambda name: Work(min(whole(name).ran, 100.0), 0.0)  # until t = 300 s
    with pytest.raises(RunError, match='controller is not ready'):
        world.wait(monkeypatch, seconds=20.0)
    assert 315.0 < world.now < 330.0


def test_the_one_that_does_not_answer_is_named_before_those_that_wait_for_it(monkeypatch):
    world = World()
    world.says = SimpleNamespace(success=False, message='no publisher of commands')
    world.ready_at['controller'] = 700.0  # after the plant in the order of names
    with pytest.raises(RunError, match=r'^controller is not ready after 20 s: it does not answer'):
        world.wait(monkeypatch, seconds=20.0)


def test_a_node_that_says_what_it_lacks_is_quoted(monkeypatch):
    world = World()
    world.says = SimpleNamespace(success=False, message='no publisher of reference')
    with pytest.raises(RunError, match=r'^plant is not ready after 20 s: no publisher of ref'):
        world.wait(monkeypatch, seconds=20.0)


@pytest.mark.parametrize(
    ('said', 'state'),
    [
        ('17', 17),
        ('0', 0),
        ('held', -1),
        ('\u00b2', -1),
        ('9' * 5000, -1),
        ('-5', -1),
        ('', -1),
        ('1e3', -1),
    ],
)
def test_a_diagnostic_of_whoever_does_not_end_a_run(said, state):
    session = Session(['plant'], lambda: None)
    status = DiagnosticStatus(
        name='plant: loop', hardware_id='/plant', values=[KeyValue(key=STATE_INDEX, value=said)]
    )
    session.take_diagnostics(DiagnosticArray(status=[status]))
    assert session.state == state
