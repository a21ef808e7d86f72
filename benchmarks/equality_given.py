"""What equality.py gives both trees: files of docs, wrong files, a bag of a stranger's robot."""

from __future__ import annotations

import shutil
from pathlib import Path

import checkout
import numpy as np
import yaml
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

GIVEN = {  # files of this tree
    'example_law.py': 'docs/example_law.py',
    'example_law_with_memory.py': 'docs/example_law_with_memory.py',
    'example_robot.py': 'docs/example_robot.py',
    'example_trajectory.py': 'docs/example_trajectory.py',
    'example_parameters.yaml': 'docs/example_parameters.yaml',
    'example_motion.csv': 'docs/example_motion.csv',
    'motion.yaml': 'docs/example_motion.yaml',
    'scenario.yaml': 'docs/example_scenario.yaml',
    'machine.xml': 'config/machines/five_bar.xml',
}
PROTOCOL = 'config/benchmarks/protocol_1.yaml'


def give(folder: Path) -> None:
    """Write all of it into a new folder."""
    folder.mkdir()
    for name, source in GIVEN.items():
        shutil.copy(checkout.ROOT / source, folder / name)
    (folder / 'wrong.yaml').write_text('base: paper_circle\ncircle: {radius: 0.02\n')
    (folder / 'wrong_type.yaml').write_text('base: paper_circle\ncircle.radius: wide\n')
    (folder / 'junk').mkdir()
    (folder / 'junk' / 'junk_0.mcap').write_bytes(bytes(range(256)) * 8)
    protocol = yaml.safe_load((checkout.ROOT / PROTOCOL).read_text())
    protocol |= {'duration': 0.5, 'scrambles': 2, 'speeds': [3.0]}
    protocol['search'] |= {'trials': 2, 'runs': 1}
    protocol['robots'] = {'planar_3rrr': protocol['robots']['planar_3rrr']}
    (folder / 'protocol.yaml').write_text(yaml.safe_dump(protocol, sort_keys=False))
    stranger(folder / 'foreign')


def stranger(bag: Path) -> None:
    """A bag of others: 200 Hz, other names and order of the joints, other topics."""
    store = get_typestore(Stores.ROS2_JAZZY)
    types = store.types
    head, clock = types['std_msgs/msg/Header'], types['builtin_interfaces/msg/Time']
    names, order = ['axis_3', 'axis_1', 'axis_2'], [2, 0, 1]
    home = np.array([1.45, 3.25, -0.53])  # rad, of a robot like the paper's
    speed, shift = 2.0 * np.pi * np.array([0.5, 0.7, 0.9]), np.array([0.0, 1.0, 2.0])
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics = {
            topic: writer.add_connection(topic, kind, typestore=store)
            for topic, kind in (
                ('/arm/joints', 'sensor_msgs/msg/JointState'),
                ('/arm/desired', 'trajectory_msgs/msg/JointTrajectory'),
                ('/arm/efforts', 'std_msgs/msg/Float64MultiArray'),
            )
        }

        def write(topic: str, stamp: int, message: object) -> None:
            kind = topics[topic].msgtype
            writer.write(topics[topic], stamp, bytes(store.serialize_cdr(message, kind)))

        for k in range(400):
            t, stamp = 0.005 * k, 10**18 + 5_000_000 * k
            wave = 0.05 * np.sin(speed * t + shift)
            rate = 0.05 * speed * np.cos(speed * t + shift)
            effort = 2.0 * rate - 0.8 * speed**2 * wave + 0.5 * np.sign(rate)
            off = 1e-4 * np.sin(40.0 * t + shift)
            header = head(clock(*divmod(stamp, 10**9)), '')
            point = types['trajectory_msgs/msg/JointTrajectoryPoint'](
                (home + wave)[order], rate[order], (-(speed**2) * wave)[order], np.zeros(0),
                types['builtin_interfaces/msg/Duration'](0, 0),
            )  # fmt: skip
            motion = types['trajectory_msgs/msg/JointTrajectory'](header, names, [point])
            state = types['sensor_msgs/msg/JointState'](
                header, names, (home + wave + off)[order], rate[order], effort[order]
            )
            layout = types['std_msgs/msg/MultiArrayLayout']([], 0)
            write('/arm/desired', stamp, motion)
            write('/arm/joints', stamp + 100_000, state)
            command = types['std_msgs/msg/Float64MultiArray'](layout, effort)
            write('/arm/efforts', stamp + 400_000, command)
