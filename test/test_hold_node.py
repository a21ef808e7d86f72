"""The trajectory node that holds the pose in which it finds a robot, as at a first power-up."""

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from parallel_robot_model.messages import topics
from parallel_robot_model.processes.node_processes import MODULES
from trajectory_gen.configuration import resolve, trajectory_of

pytest_plugins = ['ros_fixtures']

POSE = [0.51, 0.39, 1.45]  # not that of any file
ZERO = [0.3, -0.2, 0.1]  # rad, of the encoders
NAMES = ['gripper', 'joint3', 'joint1', 'joint2']  # as a broadcaster orders them


def angles(pose):
    held = {'trajectory.shape': 'hold', 'hold.pose': pose}
    (position,) = trajectory_of(resolve('paper_circle', held)).sample(0.0).position
    return position


def state(position, names=NAMES):
    """A joint state without efforts or rates, with a joint of which nothing is known."""
    shown = np.add(position, ZERO)
    known = {**dict(zip(('joint1', 'joint2', 'joint3'), shown, strict=True)), 'gripper': np.nan}
    return JointState(name=names, position=[known[name] for name in names])


UNUSABLE = {
    'joint_states: position is not finite': state([np.nan] * 3),
    'joint_states: joint2 is missing': state(angles(POSE), NAMES[:3]),
    'mode fits the joint angles': state([*angles(POSE)[:2], 2.4]),
    'motion refused': state(angles([0.51, 0.39, 2.35])),  # close to a singularity
}


def test_it_waits_for_the_pose_of_the_robot_and_holds_that(launch, domain, peer):
    words = ['-p', 'trajectory.shape:=hold', '-p', 'time_mode:=wall']
    words += ['-p', f'estimator.zero_angle:={ZERO}']
    process = launch(MODULES['trajectory'], '--ros-args', *words)
    heard, told = peer.listen(topics.REFERENCE), []
    peer.node.create_subscription(
        DiagnosticArray, '/diagnostics', lambda array: told.append(array.status[0]), 10
    )
    publisher = peer.publisher(topics.JOINT_STATES)

    def says(reason):
        return any(
            reason in status.message and status.level == DiagnosticStatus.ERROR for status in told
        )

    peer.until(lambda: says('no joint_states yet'))
    for reason, message in UNUSABLE.items():
        publisher.publish(message)
        peer.until(lambda: says(reason))  # noqa: B023
    answer = peer.call(Trigger, 'trajectory/ready', Trigger.Request(), process)
    assert not answer.success and answer.message.startswith('waits for the pose')
    assert not heard and 'holds' not in process.stderr
    publisher.publish(state(angles(POSE)))
    peer.until(lambda: heard)
    publisher.publish(state(angles([0.5, 0.37, 1.5])))  # later ones are of no concern
    count = len(heard)
    peer.until(lambda: len(heard) > count + 500)
    for message in heard:
        (point,) = message.points
        np.testing.assert_allclose(point.positions, angles(POSE), atol=1e-9)
        assert not np.any(point.velocities) and not np.any(point.accelerations)
    process.until(lambda: 'holds the pose in which the robot is: ' in process.stderr)
    assert 'x = 0.51 m, y = 0.39 m, phi = 1.45 rad' in process.stderr


@pytest.mark.parametrize(
    ('guess', 'reason'),
    [
        ('[0.5, 0.4]', 'controller.guess must be [x, y, phi], not [0.5, 0.4]'),
        ('[3.0, 3.0, 0.0]', 'the robot does not reach [3.0, 3.0, 0.0], the guess of its pose'),
    ],
)
def test_a_wrong_guess_costs_one_line(guess, reason, launch, domain):
    words = ['-p', 'trajectory.shape:=hold', '-p', f'controller.guess:={guess}']
    process = launch(MODULES['trajectory'], '--ros-args', *words)
    assert process.wait() == 2
    assert process.stderr.splitlines() == [f'parallel_robot: {reason}']
