"""Cost of every law: its kernel, and one cycle of the controller node from bytes to command.

The law from a file is docs/example_law.py: computed torque, as the suite's own of that name.

Usage: python benchmarks/laws.py [cycles]
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any

import checkout
import numpy as np
import rclpy
from rclpy.context import Context
from rows import row, show

from parallel_robot_control.configuration import resolve
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller_node import ControllerNode
from parallel_robot_control.cycle import run_cycle
from parallel_robot_control.laws import LAWS
from parallel_robot_control.safety.limiting import When
from parallel_robot_model.compiler import kernel, select, vector
from parallel_robot_model.messages import layouts, topics
from parallel_robot_model.nodes.connections import message_class, qos_of
from parallel_robot_sim.configuration import Experiment, assemble, configure
from trajectory_gen.messages import reference_messages

FILE = checkout.ROOT / 'docs' / 'example_law.py'
WARM = 200  # cycles that are not counted
BATCHES = 7  # of the kernel


@kernel
def repeat(
    count: int,
    setup: Any,
    reference: JointReference,
    position: Any,
    velocity: Any,
    dt: float,
) -> float:
    """Run a cycle `count` times, while the joints go to and fro and the motors obey."""
    total, effort, ahead = 0.0, np.zeros_like(velocity), position + dt * velocity
    for k in range(count):
        when, there = When(k, 0.0, dt), k % 2 == 1
        at, rate = select(there, ahead, position), select(there, velocity, -velocity)
        cycle = run_cycle(setup, reference, at, rate, effort, when)
        effort = cycle.torque
        total += cycle.torque[0]
    return total


def chosen(law: str) -> dict[str, Any]:
    """Parameters that choose a law; that of the file is none of LAWS."""
    return {'law': law} | ({} if law in LAWS else {'custom_laws': [str(FILE)]})


def experiment(law: str) -> Experiment:
    """The paper's circle under a law."""
    held = {'safety.residual_limit': 0.0}  # it does not go where it is pushed
    return assemble(configure(resolve('paper_circle', {'duration': 1.0, **held, **chosen(law)})))


def kernel_cost(law: str, count: int) -> list[float]:
    """Time of one cycle without Python around it [us], one figure a batch."""
    parts = experiment(law)
    motion = parts.trajectory.sample(0.0)
    theta, still = vector(motion.position[0]), vector(np.zeros(3))
    arguments = (
        parts.control.setup, JointReference(theta, still, still), theta + 1e-4, still + 1e-4,
        1e-3,
    )  # fmt: skip
    repeat(1, *arguments)
    figures = []
    for _ in range(BATCHES):
        begun = time.perf_counter()
        repeat(count, *arguments)
        figures.append(1e6 * (time.perf_counter() - begun) / count)
    return figures


def node_cost(law: str, count: int, **values: Any) -> list[float]:
    """Time from a joint state and a reference as bytes to the published command [us]."""
    words = [
        word for key, value in (chosen(law) | values).items() for word in ('-p', f'{key}:={value}')
    ]
    rclpy.init(args=['--ros-args', *words])
    node, context = ControllerNode(), Context()
    context.init()
    listener = rclpy.create_node('listener', context=context)
    kind = message_class(topics.COMMANDS.type)
    listener.create_subscription(kind, topics.COMMANDS.name, print, qos_of(topics.COMMANDS))
    while not node.count_subscribers(topics.COMMANDS.name):
        time.sleep(0.01)
    parts = experiment(law)
    indices = np.arange(WARM + count)
    motion = parts.trajectory.sample(indices * 1e-3)
    stamps = (time.time_ns() // 10**9 + 1) * 10**9 + indices * 10**6  # none is too old
    joints = node.loop.joints
    references = reference_messages(joints, stamps, motion)
    states = layouts.joint_state(joints).records(
        len(stamps),
        stamps,
        position=motion.position + 1e-4,
        velocity=motion.velocity,
        effort=np.full_like(motion.position, np.nan),
    )
    node.set_start(int(stamps[0]))
    figures = []
    for reference, state in zip(references, states, strict=True):
        data = reference.tobytes(), state.tobytes()
        begun = time.perf_counter()
        node._on_reference(data[0])
        node._on_state(data[1])
        figures.append(1e6 * (time.perf_counter() - begun))
    assert not node.alarm(), node.alarm()
    listener.destroy_node()
    context.try_shutdown()
    node.destroy_node()
    rclpy.shutdown()
    return figures[WARM:]


def main() -> None:
    """Print two rows a law: batches of its kernel, cycles of its node."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
    found = []
    for law in (*LAWS, FILE.stem):
        found.append(row(f'{law}, kernel', 'us a cycle', kernel_cost(law, count)))
        found.append(row(f'{law}, node, bytes to command', 'us a cycle', node_cost(law, count)))
        print(f'... {law}', flush=True)
    show(found)


if __name__ == '__main__':
    main()
