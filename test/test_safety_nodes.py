"""Safety with real nodes in real time: services, latched status, a controller that is killed."""

import os
import re
import signal
import time
from contextlib import ExitStack

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from domain_coordinator import domain_id
from ros_fixtures import DAMPING, PERIOD, RECENT, SLOW_LOOP, STATE_TIMEOUT, Peer, Process
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import Trigger

from parallel_robot_control.safety import faults
from parallel_robot_control.safety.faults import (
    COMMANDS_DISAGREE,
    EMERGENCY_STOP,
    STATES_DISAGREE,
    STATES_STALE,
)
from parallel_robot_model.messages import topics
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

LATE = 400  # samples by which a command may come late, on a busy machine
ENOUGH = 100  # samples that show how it stays
STRANGE = 'effort_controller/commands: messages of two publishers'
PATIENT = [
    *SLOW_LOOP,
    'plant.command_timeout:=0.5',
    f'safety.state_timeout:={STATE_TIMEOUT}',
    # Else the jump from one of two plants to the other may be the first fault, not the one meant.
    'safety.speed_limit:=[100, 100, 100]',
]


@pytest.fixture
def start(launch, domain):
    """Start a node by its name, parameters and further words."""

    def start(name, *parameters, words=()):
        given = [word for parameter in parameters for word in ('-p', parameter)]
        return launch(MODULES[name], '--ros-args', *words, *given)

    return start


class Loop:
    """Controller, plant and trajectory, and what they say."""

    def __init__(self, start, peer):
        self.start, self.peer = start, peer
        self.states = peer.listen(topics.JOINT_STATES)
        self.errors = peer.listen(topics.ERROR, RECENT)
        self.statuses = peer.listen(topics.STATUS, RECENT)
        self.diagnostics = {}
        peer.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 10)
        self.nodes = {}
        for name in ('trajectory', 'plant', 'controller'):
            self.begin(name)

    def _take(self, array):
        for status in array.status:
            figures = {item.key: item.value for item in status.values}
            said = (status.level, status.message, figures, time_of(array))
            self.diagnostics[status.hardware_id] = said

    def begin(self, name):
        self.nodes[name] = self.start(name, *PATIENT)
        self.peer.see(f'/{name}')

    def until(self, condition):
        return self.peer.until(condition)

    def until_steady(self):
        """Wait until the law has brought the robot to the circle.

        A machine that stands still for seconds brings a fault before the test begins.
        """
        self.errors.clear()

        def steady():
            if self.status() and self.status()[0] == DiagnosticStatus.ERROR:
                self.call('clear_fault')
            return self.errors and np.abs(self.errors[-1].position).max() < 1e-3

        self.until(steady)

    def status(self):
        """Level and message of the newest status."""
        if not self.statuses:
            return None
        (status,) = self.statuses[-1].status
        return status.level, status.message

    def until_fault(self, fault):
        wanted = (DiagnosticStatus.ERROR, f'fault: {faults.FAULTS[fault].text}')
        self.until(lambda: self.status() == wanted)

    def call(self, service):
        name = f'controller/{service}'
        return self.peer.call(Trigger, name, Trigger.Request(), self.nodes['controller'])

    def clear(self):
        """Clear the fault as soon as its cause is gone."""
        answers = []

        def cleared():
            answers.append(self.call('clear_fault'))
            return answers[-1].success

        try:
            self.until(cleared)
        except AssertionError:
            pytest.fail(f'{len(answers)} answers, the last ones: {answers[-2:]}')

    def until_told(self, node, level, *marks):
        """Wait for diagnostics of a node that say all of this."""

        def told():
            found = self.diagnostics.get(f'/{node}')
            return found and found[0] == level and all(mark in str(found) for mark in marks)

        self.until(told)

    def strange(self):
        """Commands of strangers, as the plant counted them."""
        return int(self.diagnostics.get('/plant', (0, '', {}))[2].get(STRANGE, 0))

    def damps(self, first):
        """Whether each effort from state `first` (negative) on damps one of those before it."""
        states = self.states[first - LATE :]
        torques = efforts(states)
        right = -DAMPING * np.array([state.velocity[:3] for state in states])
        return all(
            (right[:k] == torques[k]).all(axis=1).any()
            for k in range(len(states) + first, len(states))
        )


@pytest.fixture(scope='module')
def loop(compiled, tmp_path_factory):
    """One loop for many tests; each but the last leaves it without a fault."""
    with pytest.MonkeyPatch.context() as patch, domain_id() as number, ExitStack() as stack:
        patch.setenv('ROS_DOMAIN_ID', str(number))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

        def start(name, *parameters, words=()):
            given = [word for parameter in parameters for word in ('-p', parameter)]
            words = [MODULES[name], '--ros-args', *words, *given]
            process = Process(words, tmp_path_factory.mktemp(name), {})
            stack.callback(process.clean)
            return process

        peer = Peer()
        stack.callback(peer.close)
        yield Loop(start, peer)


def time_of(message):
    """Stamp, in s."""
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9


def efforts(states):
    return np.array([state.effort[:3] for state in states])


def damped(states):
    """Whether the effort of each state but the first damps the state before it, if heard."""
    speeds = np.array([state.velocity[:3] for state in states])
    heard = np.diff([time_of(state) for state in states]) < 1.5 * PERIOD
    return (efforts(states)[1:] == -DAMPING * speeds[:-1]).all(axis=1) | ~heard


def test_a_killed_controller_leaves_the_motors_safe_and_its_successor_takes_over(loop):
    loop.until_steady()
    assert loop.nodes['controller'].end(signal.SIGKILL) == -signal.SIGKILL
    loop.until_told('plant', DiagnosticStatus.WARN, 'command time-outs')
    loop.until(lambda: damped(loop.states[-20:]).all())
    states = loop.states[:]
    since = len(states) - np.argmin(damped(states)[::-1])  # first state after the safe action
    torques = efforts(states[:since])
    kept = (torques == torques[-1]).all(axis=1)
    first = since - np.argmin(kept[::-1])
    before, begun, end, after = (time_of(states[k]) for k in (first - 1, first, since - 1, since))
    assert torques[-1].any() and end - begun - 0.02 <= 0.5 <= after - before + 0.02  # s

    told = len(loop.statuses)
    loop.diagnostics.clear()
    loop.begin('controller')
    loop.until_steady()
    loop.until(lambda: '/controller' in loop.diagnostics and len(loop.statuses) > told)
    *_, figures, at = loop.diagnostics['/controller']
    answering = PERIOD * (int(figures['answered']) + int(figures['skipped']))
    states = loop.states[since:]
    driven = np.argmin(damped(states))  # first state after a command of the new controller
    assert driven > 20
    before, after = efforts(states[driven : driven + 2])
    # Since its first answer, which is heard later where the plant discovers it late.
    ramped = max(0.0, time_of(states[driven + 1]) - (at - answering))
    braked = 1.6 * 4.0  # N m, of M and approach.acceleration: the reference has moved on
    assert np.abs(after - before).max() <= 200 * ramped + 0.1 + braked  # mostly one period
    levels = [message.status[0].level for message in list(loop.statuses)[told:]]
    assert DiagnosticStatus.WARN in levels  # the ramp has acted
    assert not loop.nodes['controller'].stderr.count('fault')


def test_an_emergency_stop_is_latched_until_it_is_cleared(loop):
    loop.until_steady()
    answer = loop.call('emergency_stop')
    assert answer.success and 'clear_fault' in answer.message
    loop.until_fault(EMERGENCY_STOP)
    begun = len(loop.states)
    loop.until(lambda: len(loop.states) > begun + ENOUGH and loop.damps(-ENOUGH))
    late = loop.peer.listen(topics.STATUS, RECENT)
    loop.until(lambda: late)
    assert late[0].status[0].level == DiagnosticStatus.ERROR
    loop.until_told('controller', DiagnosticStatus.ERROR, faults.FAULTS[EMERGENCY_STOP].text)
    assert loop.call('clear_fault').success
    loop.until(lambda: loop.status()[0] == DiagnosticStatus.WARN)
    loop.until_steady()


def test_states_that_stop_are_a_fault_that_only_states_and_a_call_end(loop):
    loop.until_steady()
    commands = loop.peer.listen(topics.COMMANDS, RECENT)
    assert loop.nodes['plant'].end(signal.SIGKILL) == -signal.SIGKILL
    loop.until_fault(STATES_STALE)
    loop.until(lambda: commands and not any(commands[-1].data))
    answer = loop.call('clear_fault')
    assert not answer.success and answer.message == faults.FAULTS[STATES_STALE].text
    assert loop.status()[0] == DiagnosticStatus.ERROR
    count = len(loop.states)
    loop.begin('plant')
    loop.until(lambda: len(loop.states) > count + 100)
    loop.until_fault(STATES_STALE)  # still, though states are there
    loop.clear()  # when the controller hears them too
    loop.until_steady()


def test_of_two_controllers_the_first_is_safe_and_the_second_never_acts(loop):
    loop.until_steady()
    states = len(loop.states)
    other = loop.start('controller', *PATIENT, words=['-r', '__node:=other'])
    loop.until_fault(COMMANDS_DISAGREE)
    loop.until_told('plant', DiagnosticStatus.WARN, STRANGE)
    answer = loop.call('clear_fault')
    assert not answer.success and answer.message == (
        '/effort_controller/commands has 2 publishers: /controller, /other; stop all but one'
    )
    begun = len(loop.states)
    loop.until(lambda: len(loop.states) > begun + ENOUGH and loop.damps(-ENOUGH))
    assert other.end(signal.SIGINT) == 0
    assert loop.status()[0] == DiagnosticStatus.ERROR  # until a person says so
    loop.clear()
    loop.until_steady()
    assert 'fault: another node publishes' in other.stderr
    assert np.abs(efforts(loop.states[states:])).max() < 50.0  # N m


@pytest.mark.endurance
def test_a_command_of_a_stranger_never_acts_however_rare(loop):
    """One of 150 N m every 1.2 s, beside a controller that damps, and beside none."""
    loop.until_steady()
    states, told = len(loop.states), loop.strange()
    stranger = loop.peer.publisher(topics.COMMANDS)
    loop.until_fault(COMMANDS_DISAGREE)

    def disturb():
        begun = len(loop.states)
        stranger.publish(Float64MultiArray(data=[150.0] * 3))
        loop.until(lambda: len(loop.states) >= begun + round(1.2 / PERIOD))

    def disturb_until(count):  # one that the next command overtook was not heard
        for _ in range(25):
            if loop.strange() >= count:
                return
            disturb()
        pytest.fail(f'{loop.strange() - told} of {count - told} were heard')

    disturb_until(told + 5)
    assert loop.nodes['controller'].end(signal.SIGKILL) == -signal.SIGKILL
    disturb()
    disturb()
    loop.statuses.clear()  # what follows is of the successor
    loop.begin('controller')
    loop.until_fault(COMMANDS_DISAGREE)
    disturb_until(told + 9)
    loop.peer.node.destroy_publisher(stranger)
    loop.clear()
    loop.until_steady()
    assert np.abs(efforts(loop.states[states:])).max() < 100.0  # N m


def test_an_emergency_stop_outlives_the_controller_until_it_is_cleared(loop):
    loop.until_steady()
    assert loop.call('emergency_stop').message == 'fault: emergency stop; ~/clear_fault ends it'
    assert loop.nodes['controller'].end(signal.SIGKILL) == -signal.SIGKILL
    loop.statuses.clear()
    loop.begin('controller')
    loop.until_fault(EMERGENCY_STOP)
    today = time.strftime('%Y-%m-%d')
    said = re.findall('emergency stop since (.*); ~/clear', loop.nodes['controller'].stderr)
    assert len(said) == 1 and said[0].startswith((today, time.strftime('%Y-%m-%d')))
    begun = len(loop.states)
    loop.until(lambda: len(loop.states) > begun + ENOUGH and loop.damps(-ENOUGH))
    assert loop.call('clear_fault').success
    loop.until_steady()
    assert loop.nodes['controller'].end(signal.SIGKILL) == -signal.SIGKILL
    loop.statuses.clear()
    loop.begin('controller')
    loop.until_steady()
    assert not loop.nodes['controller'].stderr.count('emergency stop')


def test_two_plants_are_seen_and_the_second_is_not_controlled(loop):
    loop.until_steady()
    other = loop.start('plant', *PATIENT, words=['-r', '__node:=other'])
    loop.until_fault(STATES_DISAGREE)
    loop.until_told('controller', DiagnosticStatus.ERROR, "'joint_states: publishers': '2'")
    loop.until_told('controller', DiagnosticStatus.ERROR, 'joint_states: messages of two')
    answer = loop.call('clear_fault')
    assert (
        not answer.success and '/joint_states has 2 publishers: /other, /plant' in answer.message
    )
    assert other.end(signal.SIGINT) == 0
    loop.clear()
    loop.until_steady()


def test_two_publishers_are_seen_on_a_topic_of_another_name(start, peer):
    """As with hardware, whose topics have names of their own."""
    start('controller', 'time_mode:=lockstep', words=['-r', 'joint_states:=/hardware/joints'])
    told = {}

    def take(array):
        told.update({item.key: item.value for item in array.status[0].values})

    peer.node.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    topic = topics.JOINT_STATES._replace(name='/hardware/joints')
    publishers = [peer.publisher(topic) for _ in range(2)]
    peer.until(lambda: told.get('joint_states: publishers') == str(len(publishers)))


@pytest.mark.parametrize('reason', ['parameter', 'told before'])
def test_a_controller_that_begins_in_emergency_stop_says_so_at_once(reason, start, peer):
    """Before the first state."""
    if reason == 'told before':
        killed = start('controller')
        stop = peer.call(Trigger, 'controller/emergency_stop', Trigger.Request(), killed)
        assert stop.success and killed.end(signal.SIGKILL) == -signal.SIGKILL
    process = start('controller', f'controller.stopped:={str(reason == "parameter").lower()}')
    peer.until(lambda: process.stderr.count('fault: emergency stop'))
    statuses = peer.listen(topics.STATUS, RECENT)  # which has the last one for late listeners
    peer.until(lambda: statuses)
    assert statuses[0].status[0].message == 'fault: emergency stop'
    peer.until(
        lambda: peer.call(Trigger, 'controller/clear_fault', Trigger.Request(), process).success
    )
    peer.until(lambda: statuses[-1].status[0].level == DiagnosticStatus.OK)


def test_a_stop_that_cannot_be_kept_is_told(launch, peer, tmp_path):
    (tmp_path / f'parallel_robot_{os.getuid()}').write_text('in place of the directory')
    process = launch(
        MODULES['controller'], fresh=True, XDG_STATE_HOME='/dev/null', TMPDIR=str(tmp_path)
    )
    answer = peer.call(Trigger, 'controller/emergency_stop', Trigger.Request(), process)
    assert answer.success and answer.message.startswith('fault: emergency stop; ~/clear_fault')
    assert 'will not know it: no directory of your own' in answer.message


def test_a_stop_before_the_first_state_is_told_and_can_be_cleared(start, peer):
    process = start('controller')
    statuses = peer.listen(topics.STATUS, RECENT)
    for service, level in (
        ('emergency_stop', DiagnosticStatus.ERROR),
        ('clear_fault', DiagnosticStatus.OK),
    ):
        answer = peer.call(Trigger, f'controller/{service}', Trigger.Request(), process)
        assert answer.success
        peer.until(lambda: statuses and statuses[-1].status[0].level == level)  # noqa: B023
