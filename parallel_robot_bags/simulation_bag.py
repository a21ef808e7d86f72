"""The bag of a closed loop without ROS: the same topics, types and stamps as the nodes' bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot_bags import custom_sources
from parallel_robot_bags.bag_writer import BagWriter
from parallel_robot_bags.certificate import Certificate
from parallel_robot_bags.experiment import SIMULATION, describe
from parallel_robot_bags.progress import tracked
from parallel_robot_base import layouts, topics
from parallel_robot_base.loop import STEP_START
from parallel_robot_base.units import NANOSECONDS
from parallel_robot_control import faults
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import at_measurement
from parallel_robot_control.estimator import told_delay
from parallel_robot_control.messages import (
    Status,
    Telemetry,
    answers_message,
    status_message,
    telemetry_messages,
    told_limits,
)
from parallel_robot_sim.messages import state_layout, state_messages
from parallel_robot_sim.simulation import Simulation
from trajectory_gen.messages import pose_messages, reference_messages


def write(directory: str | Path, values: Mapping[str, Any], simulation: Simulation) -> None:
    """Write a simulation as a bag.

    Args:
        directory: Where the bag will be; must not exist.
        values: The resolved configuration.
        simulation: The simulated run.

    Raises:
        BagError: the directory exists or cannot be created.
        OSError: the disk is full or gone.
    """
    experiment, reference, run = simulation.experiment, simulation.reference, simulation.run
    loop, law, robot = experiment.loop, experiment.control.law, experiment.trajectory.robot.module
    count = run.steps
    stamps = STEP_START + np.arange(count) * loop.period_ns
    age = experiment.plant.setup.imperfections.age  # s, which the stamps tell
    measured = stamps - round(age * NANOSECONDS)
    rows = slice(count)
    slow = slice(0, count, topics.SLOW)
    passive = run.passive_position.shape[1] if values['plant.publish_passive'] else 0
    late = age + simulation.delay[rows][slow]
    desired_motion = (reference.position, reference.velocity, reference.acceleration)
    then = at_measurement.py_func(  # type: ignore[attr-defined]
        JointReference(*(row[rows][slow] for row in desired_motion)), late
    )
    telemetry = Telemetry(
        then.position - run.position[slow],
        then.velocity - run.velocity[slow],
        run.coupled_error[slow],
        run.sliding_variable[slow],
    )
    commands = layouts.float64_multi_array(len(loop.joints)).records(count, data=run.command[rows])
    layout, samples = state_layout(loop.joints, passive), round(age / loop.period)
    records = {
        topics.JOINT_STATES: state_messages(layout, measured, run, samples),
        topics.REFERENCE: reference_messages(loop.joints, stamps, reference),
        topics.COMMANDS: commands,
        **telemetry_messages(loop.joints, measured[slow], telemetry),
    }
    if robot.PLANAR:
        poses, desired = run.pose[slow], reference.pose[rows][slow]
        records[topics.POSE] = pose_messages(stamps[slow], poses)
        records[topics.POSE_REFERENCE] = pose_messages(stamps[slow], desired)
    known, suite = faults.of(robot), topics.recorded(robot.PLANAR)
    facts = describe(loop, values, STEP_START, SIMULATION)
    sources = [custom_sources.attachment(*file) for file in custom_sources.named(values)]
    with BagWriter(directory, suite, facts) as writer:
        for name, source in sources:
            writer.attach(name, source)
        writer.write(topics.ACTIVE_LAW.name, STEP_START, layouts.text_message(law.name))
        status, phases = None, simulation.phases
        estimator = experiment.control.setup.estimator
        acted = told_limits(run.acted[rows], loop.period)
        for k in tracked(range(count), count, 'states written'):
            log_time = int(stamps[k])
            delay = told_delay(estimator, int(phases[k]))
            now = Status(law.name, known.get(int(run.fault[k])), int(acted[k]), delay)
            if now != status:
                status = now
                writer.write(topics.STATUS.name, log_time, status_message(log_time, status))
            if k % topics.SLOW == 0 or k == count - 1:
                answered = slice(max(0, (k - 1) // topics.SLOW * topics.SLOW + 1), k + 1)
                acts = stamps[answered]
                whole = np.stack([measured[answered], acts, acts], axis=1)
                message = answers_message(whole)
                writer.write(topics.ANSWERED.name, log_time, message)
            for topic, messages in records.items():
                index, rest = divmod(k, topic.every)
                if rest == 0:
                    writer.write(topic.name, log_time, messages[index].tobytes())
        writer.certificates = {
            topic.name: Certificate(writer.written[topic.name], 0) for topic in suite
        }
