"""The trajectory node beside a law in C++, started as docs/fmu.md says: a command starts it."""

import re
from pathlib import Path

import numpy as np
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64MultiArray

from parallel_robot_model.messages import topics
from parallel_robot_model.processes.node_processes import MODULES

pytest_plugins = ['ros_fixtures']

PAGE = Path(__file__).parents[1] / 'docs' / 'fmu.md'


def test_the_first_command_of_the_law_starts_the_motion(launch, domain, peer):
    (words,) = re.findall(
        '^ros2 run parallel_robot trajectory (.*)$', PAGE.read_text(), re.MULTILINE
    )
    process = launch(MODULES['trajectory'], *words.split())
    heard = peer.listen(topics.REFERENCE._replace(name='/paper_law/reference'))
    publisher = peer.node.create_publisher(
        Float64MultiArray, '/paper_law/commands', QoSProfile(depth=1)
    )
    peer.until(lambda: publisher.get_subscription_count() and len(heard) > 200)

    def speeds():
        return [np.abs(message.points[0].velocities).max() for message in heard]

    assert not any(speeds())
    publisher.publish(Float64MultiArray(data=[0.0, 0.0, 0.0]))
    peer.until(lambda: max(speeds()) > 0.01)
    assert process.running
