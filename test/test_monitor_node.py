"""The monitor as a real process."""

import signal

import mujoco
import numpy as np
import pytest
from assembly import simulated
from bags import motion_of, streams, write_foreign
from geometry import PAPER_START, legs, wrap

from parallel_robot.analysis import metrics
from parallel_robot.analysis.monitor import OF_TOPICS, WindowMetrics
from parallel_robot.analysis.monitor_node import LINKS
from parallel_robot.bags.run import recording
from parallel_robot_model.configuration import config
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import Topic

pytest_plugins = ['ros_fixtures']


def test_it_publishes_what_analyze_says_of_a_bag(launch, peer, tmp_path):
    values = config.resolve('paper_circle', {'duration': 0.5})
    simulation = simulated(values)
    rows = slice(simulation.run.steps)
    messages = streams(
        simulation.reference.position[rows], simulation.run.position, simulation.run.effort
    )
    write_foreign(tmp_path / 'bag', messages)
    log = recording.read(tmp_path / 'bag').log
    found = metrics.evaluate(motion_of(log), all_of_it=True)
    expected = [found[key] for key in OF_TOPICS]

    process = launch('parallel_robot.analysis.monitor_node')
    heard = [
        peer.listen(Topic(f'monitor/{name}', 'std_msgs/msg/Float64'))
        for name in WindowMetrics._fields
    ]
    publishers = {name: peer.publisher(name) for name in (topics.REFERENCE, topics.JOINT_STATES)}

    def send(part):
        for topic, publisher in publishers.items():
            for _, data in messages[topic][part]:
                publisher.publish(data)

    def play():
        for first in range(0, 501, 50):  # not all at once: more than 512 overflow shared memory
            send(slice(first, first + 50))
            for _ in range(2 * len(heard)):
                peer.spin(0.01)

    def agree():
        return all(heard) and np.allclose([v[-1].data for v in heard], expected, rtol=1e-9)

    peer.until(lambda: agree() or play())  # again where states overtook their references
    assert process.end(signal.SIGINT) == 0


def test_it_publishes_what_draws_the_robot(launch, peer, robot):
    zero = [0.3, -0.2, 0.1]  # rad, of the encoders
    words = ('--ros-args', '-p', f'estimator.zero_angle:={zero}')
    process = launch('parallel_robot.analysis.monitor_node', *words)
    texts = peer.listen(topics.ROBOT_DESCRIPTION)
    links = peer.listen(LINKS)
    publisher = peer.publisher(topics.JOINT_STATES)
    theta, beta = legs(robot, PAPER_START)
    state = streams(np.tile(theta, (100, 1)), np.tile(theta + zero, (100, 1)))[topics.JOINT_STATES]

    def play():
        for _, data in state:
            publisher.publish(data)
        peer.spin(0.05)

    peer.until(lambda: (texts and links) or play())
    model = mujoco.MjModel.from_xml_string(texts[-1].data)
    assert {model.joint(k).name for k in range(model.njnt)} == set(links[-1].name)
    known = dict(zip(links[-1].name, links[-1].position, strict=True))
    for k, name in enumerate(('joint1', 'joint2', 'joint3')):
        assert wrap(known[name] - theta[k]) == pytest.approx(0, abs=1e-9)
        assert wrap(known[f'{name}_passive'] - (beta - theta)[k]) == pytest.approx(0, abs=1e-9)
    assert process.end(signal.SIGINT) == 0
