"""Law, gains and preset of a running controller, over the services of ROS."""

import numpy as np
import pytest
from assembly import simulated
from bags import content
from diagnostic_msgs.msg import DiagnosticArray
from domain_coordinator import domain_id
from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.serialization import deserialize_message
from ros_fixtures import Peer, Process
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, String
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.processes.node_processes import MODULES
from trajectory_gen.configuration import trajectory_of

pytest_plugins = ['ros_fixtures']

TABLE_2 = {'G': 10.0, 'g': 0.01, 'Gamma1': 16.0, 'Gamma2': 6.5, 'gamma1': 0.5, 'gamma2': 0.67,
           'lambda': 0.9}  # fmt: skip
MOTION = trajectory_of(config.resolve('paper_circle')).sample(np.arange(1000) * 1e-3)
JOINTS = ['joint1', 'joint2', 'joint3']
OFFSET = np.array([1e-3, -2e-3, 3e-3])  # rad


class Session:
    """A controller in lockstep, and a peer that is trajectory and plant to it."""

    def __init__(self, process, peer):
        self.process, self.peer = process, peer
        self.laws, self.statuses = peer.listen(topics.ACTIVE_LAW), peer.listen(topics.STATUS)
        self.commands = peer.listen(topics.COMMANDS)
        self._reference = peer.publisher(topics.REFERENCE)
        self._states = peer.publisher(topics.JOINT_STATES)
        self._k = 0

    def call(self, kind, service, **fields):
        name = f'controller/{service}'
        return self.peer.call(kind, name, kind.Request(**fields), self.process)

    def set(self, **changes):
        """Results of one request, '__' for the dot of a key."""
        messages = [
            Parameter(key.replace('__', '.'), value=value).to_parameter_msg()
            for key, value in changes.items()
        ]
        return self.call(SetParameters, 'set_parameters', parameters=messages).results

    def refused(self, **changes):
        """The one reason why a request was refused as a whole."""
        before = self.get(*self.names)
        results = self.set(**changes)
        assert len(results) == len(changes) and not any(r.successful for r in results)
        assert self.get(*self.names) == before
        (reason,) = {result.reason for result in results}
        assert '\n' not in reason
        return reason

    def accepted(self, **changes):
        results = self.set(**changes)
        assert all(result.successful for result in results), results

    names = ('law', 'preset', *(f's_fotsmc.{gain}' for gain in TABLE_2), 'smc.z', 'nftsmc.gamma1')

    def get(self, *names):
        values = self.call(GetParameters, 'get_parameters', names=names).values
        return [parameter_value_to_python(value) for value in values]

    def step(self):
        """Publish a reference and a state; return torque."""
        k, count = self._k, len(self.commands)
        self._k += 1
        sec, nanosec = divmod(10**9 + k * 10**6, 10**9)
        wanted = [MOTION.position[k], MOTION.velocity[k], MOTION.acceleration[k]]
        point = JointTrajectoryPoint()
        point.positions, point.velocities, point.accelerations = map(list, wanted)
        reference = JointTrajectory(joint_names=JOINTS, points=[point])
        state = JointState(name=JOINTS)
        state.position, state.velocity = list(wanted[0] - OFFSET), list(wanted[1])
        state.effort = [0.0, 0.0, 0.0]
        for message, publisher in ((reference, self._reference), (state, self._states)):
            message.header.stamp.sec, message.header.stamp.nanosec = sec, nanosec
            publisher.publish(message)
        self.peer.until(lambda: len(self.commands) > count)
        return np.array(self.commands[-1].data)

    def until_status(self, **wanted):
        """Wait for a status of a law, a fault and limits that have acted."""

        def told():
            items = self.statuses[-1].status[0].values if self.statuses else []
            return wanted.items() <= {item.key: item.value for item in items}.items()

        self.peer.until(told)


@pytest.fixture(scope='module')
def session(compiled, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch, domain_id() as number:
        patch.setenv('ROS_DOMAIN_ID', str(number))
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        words = [MODULES['controller'], '--ros-args', '-p', 'time_mode:=lockstep']
        process, peer = Process(words, tmp_path_factory.mktemp('controller'), {}), Peer()
        try:
            session = Session(process, peer)
            peer.meet('controller', process)
            yield session
            assert process.running and 'Traceback' not in process.stderr
        finally:
            peer.close()
            process.clean()


@pytest.fixture(autouse=True)
def _paper(session):
    session.accepted(preset='paper', law='s_fotsmc')


def test_before_the_first_state_the_latched_topic_names_the_law_after_a_switch(session):
    """The first test here: no state has come yet."""
    session.accepted(law='smc')
    session.step()
    session.peer.until(lambda: session.laws and session.laws[-1].data == 'smc')
    session.until_status(law='smc')


def test_a_switch_takes_effect_at_the_next_state_without_a_jump(session):
    for law in ('pid', 's_fotsmc', 'super_twisting'):
        before = session.step()
        session.accepted(law=law)
        first = session.step()
        assert 0.0 < np.abs(first - before).max() <= 1.0 + 1e-9
        session.peer.until(lambda: session.laws[-1].data == law)  # noqa: B023
        session.until_status(
            law=law, fault='none', **{'limits that acted': 'ramp after a take-over'}
        )
        late = session.peer.listen(topics.ACTIVE_LAW)
        session.peer.until(lambda: late)  # noqa: B023
        assert [message.data for message in late] == [law]


def test_a_whole_number_is_stored_as_a_number(session):
    session.accepted(s_fotsmc__G=12)
    (value,) = session.get('s_fotsmc.G')
    assert (type(value), value) == (float, 12.0)


REFUSED = {
    'NaN': ({'s_fotsmc__G': float('nan')}, 's_fotsmc.G must be finite'),
    'infinite': ({'smc__z': float('inf')}, 'smc.z must be finite'),
    'out of range': ({'s_fotsmc__G': -1.0}, 's_fotsmc.G must be at least 0 rad/s^3, not -1'),
    'text': ({'s_fotsmc__G': 'much'}, "s_fotsmc.G must be a number, not 'much'"),
    'a list': ({'s_fotsmc__G': [1.0, 2.0]}, 's_fotsmc.G must be a number, not [1.0, 2.0]'),
    'truth': ({'s_fotsmc__G': True}, 's_fotsmc.G must be a number, not True'),
    'gain unknown': ({'s_fotsmc__lamda': 1.0}, "did you mean 's_fotsmc.lambda'?"),
    'key unknown': ({'lawn': 'smc'}, "unknown parameter 'lawn'; did you mean 'law'?"),
    'law unknown': ({'law': 's_fotsmk'}, "unknown law 's_fotsmk'; did you mean 's_fotsmc'?"),
    'law a number': ({'law': 5}, "unknown law '5'"),
    'preset unknown': ({'preset': 'papr'}, 'preset is paper'),
    'not Hurwitz': ({'s_fotsmc__Gamma1': 0.0}, 'Gamma2 p + Gamma1 must be Hurwitz'),
    'one exponent': ({'s_fotsmc__gamma1': 0.6}, 'gamma2 must be 2 gamma1 / (1 + gamma1) = 0.75'),
    'the other': ({'s_fotsmc__gamma2': 0.75}, 'gamma2 must be 2 gamma1 / (1 + gamma1) = 0.6667'),
    'half good': ({'law': 'smc', 's_fotsmc__G': -1.0}, 's_fotsmc.G must be at least'),
    'half unknown': ({'smc__z': 30.0, 'smc__zz': 30.0}, "unknown parameter 'smc.zz'"),
    'preset and gain': ({'preset': 'paper', 'smc__z': 30.0}, 'preset is custom with these gains'),
    'read-only': ({'period': 0.002}, 'period is fixed at the start of the node'),
    'read-only limit': ({'safety__damping': [1.0, 1.0, 1.0]}, 'safety.damping is fixed'),
    'read-only and good': ({'law': 'smc', 'period': 0.002}, 'period is fixed'),
}  # fmt: skip


@pytest.mark.parametrize('name', REFUSED)
def test_what_is_wrong_is_refused_as_a_whole_and_the_old_law_goes_on(name, session):
    changes, reason = REFUSED[name]
    session.step()
    assert reason in session.refused(**changes)
    session.step(), session.step()
    session.until_status(law='s_fotsmc', fault='none')
    assert session.get('preset') == ['paper']


def test_gains_that_are_good_together_are_set_together(session):
    session.accepted(s_fotsmc__gamma1=0.6, s_fotsmc__gamma2=0.75)
    assert session.get('s_fotsmc.gamma1', 's_fotsmc.gamma2', 'preset') == [0.6, 0.75, 'custom']
    messages = [
        Parameter(f's_fotsmc.{key}', value=value).to_parameter_msg()
        for key, value in (('gamma1', 0.8), ('gamma2', 0.89))
    ]
    answer = self_result(session, messages)
    assert answer.successful and session.get('s_fotsmc.gamma1') == [0.8]


def self_result(session, messages):
    answer = session.call(
        SetParametersAtomically, 'set_parameters_atomically', parameters=messages
    )
    return answer.result


def test_the_preset_restores_table_2(session):
    session.accepted(s_fotsmc__G=99.0, s_fotsmc__gamma1=0.6, s_fotsmc__gamma2=0.75, smc__z=5.0)
    assert session.get('preset') == ['custom']
    session.accepted(preset='paper')
    gains = session.get(*(f's_fotsmc.{gain}' for gain in TABLE_2))
    assert dict(zip(TABLE_2, gains, strict=True)) == TABLE_2
    assert session.get('smc.z', 'preset') == [20.0, 'paper']
    session.accepted(smc__z=21)
    session.accepted(smc__z=20)
    assert session.get('preset') == ['paper']


def described(session, name):
    (descriptor,) = session.call(
        DescribeParameters, 'describe_parameters', names=[name]
    ).descriptors
    return descriptor


def test_descriptors_carry_unit_meaning_and_range(session):
    gain = described(session, 's_fotsmc.G')
    assert gain.description == 'bound of the rate of the lumped uncertainty [rad/s^3]'
    (allowed,) = gain.floating_point_range
    assert (allowed.from_value, allowed.to_value) == (0.0, np.inf) and not gain.read_only
    (allowed,) = described(session, 's_fotsmc.gamma1').floating_point_range
    assert (allowed.from_value, allowed.to_value) == (0.0, 1.0)
    assert not described(session, 'law').read_only and not described(session, 'preset').read_only
    for name in ('period', 'robot.m1', 'safety.torque_limit', 'custom_laws'):
        fixed = described(session, name)
        assert isinstance(fixed, ParameterDescriptor) and fixed.read_only and fixed.description


def test_table_2_of_nftsmc_warns_and_runs(session):
    warning = 'nftsmc: the printed surface is proved for 1 < gamma1 < 2 and gamma2 > gamma1'
    assert warning not in session.process.stderr
    session.accepted(law='nftsmc')
    session.step()
    session.until_status(law='nftsmc', fault='none')
    session.process.until(lambda: warning in session.process.stderr)
    (line,) = (line for line in session.process.stderr.splitlines() if warning in line)
    assert '[WARN]' in line


def test_a_switch_during_a_run_is_in_its_bag(launch, domain, peer, tmp_path):
    words = ['--duration', '8', '--time-mode', 'lockstep', '--out', 'bag']
    process = launch('parallel_robot.cli.command_line', 'run', 'paper_circle', *words)
    commands = peer.listen(topics.COMMANDS)
    peer.until(lambda: commands or not process.running)
    assert process.running, process.stderr
    message = Parameter('law', value='smc').to_parameter_msg()
    request = SetParameters.Request(parameters=[message])
    with process.children()[MODULES['plant']].paused():  # else the run may end before
        answer = peer.call(SetParameters, 'controller/set_parameters', request, process)
    assert answer.results[0].successful
    assert process.wait() == 0, process.stderr
    found = content(next((tmp_path / 'bag').glob('*.mcap')))
    laws = [
        (log_time, deserialize_message(data, String).data)
        for log_time, data in found['controller/active_law']
    ]
    statuses = [
        deserialize_message(data, DiagnosticArray) for _, data in found['controller/status']
    ]
    told = [{item.key: item.value for item in one.status[0].values} for one in statuses]
    assert [(one['law'], one['limits that acted'], one['fault']) for one in told] == [
        ('s_fotsmc', 'none', 'none'), ('smc', 'ramp after a take-over', 'none'),
        ('smc', 'none', 'none'),  # a second later
    ]  # fmt: skip
    stamp = statuses[1].header.stamp
    assert laws == [(10**9, 's_fotsmc'), (stamp.sec * 10**9 + stamp.nanosec, 'smc')]
    switched = round((stamp.sec - 1) * 1e3 + stamp.nanosec * 1e-6)
    torques = [
        deserialize_message(data, Float64MultiArray).data
        for _, data in found['effort_controller/commands']
    ]
    assert len(torques) == 8001 and 0 < switched < 8000
    assert np.abs(np.subtract(torques[switched], torques[switched - 1])).max() <= 1.0 + 1e-9
    values = config.resolve('paper_circle', {'duration': 8.0})
    unswitched = simulated(values).run.command
    assert np.array_equal(torques[:switched], unswitched[:switched])
    assert not np.array_equal(torques[switched], unswitched[switched])
