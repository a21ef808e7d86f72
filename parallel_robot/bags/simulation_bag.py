"""The bag of a closed loop without ROS: the same topics, types and stamps as the nodes' bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.bags import custom_sources
from parallel_robot.bags.bag_writer import BagWriter
from parallel_robot.bags.certificate import Certificate
from parallel_robot.bags.experiment import SIMULATION, describe
from parallel_robot.bags.progress import tracked
from parallel_robot_control import faults
from parallel_robot_control.contract import JointReference
from parallel_robot_control.cycle import at_measurement
from parallel_robot_control.estimator import delay_text
from parallel_robot_control.messages import (
    Status,
    Telemetry,
    answers_message,
    reported_limits,
    status_message,
    telemetry_messages,
)
from parallel_robot_model.common.errors import RunError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.hazard_times import HazardTimes
from parallel_robot_model.messages import layouts, topics
from parallel_robot_sim.messages import state_layout, state_messages
from parallel_robot_sim.simulation import Simulation
from trajectory_gen.messages import pose_messages, reference_messages


def save(directory: str | Path, values: Mapping[str, Any], simulation: Simulation) -> None:
    """Write a simulation as a bag, see :func:`write`.

    Raises:
        BagError: the directory exists or cannot be created.
        RunError: the disk is full or gone.
    """
    try:
        write(directory, values, simulation)
    except OSError as error:
        raise RunError(f'cannot write {directory}: {error.strerror}') from None


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
    course, samples = simulation.course, np.arange(count)
    heard = course.heard.head(count)
    stamps = loop.step_start + samples * loop.period_ns
    age = experiment.plant.setup.imperfections.age  # s, which the stamps tell
    acts = stamps - heard.late * loop.period_ns  # as the controller knows it
    measured = acts - round(age * NANOSECONDS)
    slow = due = samples[:: topics.SLOW]
    if loop.hazards:
        age_limit = experiment.plant.safety.state_age
        times = HazardTimes(experiment.plant.hazards, loop.period, age_limit)
        due = np.array(times.due(count, topics.SLOW), np.int64)
    passive = run.passive_position.shape[1] if values['plant.publish_passive'] else 0
    late = age + simulation.delay[due]
    desired = course.reference
    desired_motion = (desired.position, desired.velocity, desired.acceleration)
    then = at_measurement.py_func(  # type: ignore[attr-defined]
        JointReference(*(row[due - heard.late[due]] for row in desired_motion)), late
    )
    telemetry = Telemetry(
        then.position - run.position[due],
        then.velocity - run.velocity[due],
        run.coupled_error[due],
        run.sliding_variable[due],
    )
    commands = layouts.float64_multi_array(len(loop.joints)).records(
        count, data=run.command[:count]
    )
    layout = state_layout(loop.joints, passive)
    states = state_messages(layout, measured, run, round(age / loop.period), heard.late)
    records = {
        topics.JOINT_STATES: (samples[heard.told], _bytes_of(states, heard.told)),
        topics.REFERENCE: (samples, reference_messages(loop.joints, stamps, reference)),
        topics.COMMANDS: (samples[heard.answered], _bytes_of(commands, heard.answered)),
    }
    for topic, messages in telemetry_messages(loop.joints, measured[due], telemetry).items():
        records[topic] = due, messages
    if robot.PLANAR:
        shown = slow[course.shown[slow]]
        records[topics.POSE] = shown, pose_messages(stamps[shown], run.pose[shown])
        records[topics.POSE_REFERENCE] = slow, pose_messages(stamps[slow], reference.pose[slow])
    reasons, suite = faults.of(robot), topics.recorded(robot.PLANAR)
    facts = describe(loop, values, loop.step_start, SIMULATION)
    sources = [custom_sources.attachment(*file) for file in custom_sources.named(values)]
    with BagWriter(directory, suite, facts) as writer:
        for name, source in sources:
            writer.attach(name, source)
        writer.write(topics.ACTIVE_LAW.name, loop.step_start, layouts.text_message(law.name))
        status, phases = None, simulation.phases
        known_stamps = loop.step_start + course.known * loop.period_ns
        answers, last, written = [], 0, dict.fromkeys(records, 0)
        estimator = experiment.control.setup.estimator
        acted = reported_limits(run.acted[:count], measured, heard.answered, course.renewals)
        logged = {*due.tolist(), count - 1}
        for k in tracked(range(count), count, 'states written'):
            log_time = int(stamps[k])
            delay = delay_text(estimator, int(phases[k]))
            last = k if heard.answered[k] else last
            now = Status(law.name, reasons.get(int(run.fault[k])), int(acted[last]), delay)
            if now != status and (heard.answered[k] or k in course.lost):
                status, told_at = now, int(acts[last])
                writer.write(topics.STATUS.name, told_at, status_message(told_at, status))
            if heard.answered[k]:
                answers.append(k)
            if k in logged and answers:
                known = known_stamps[answers - heard.late[answers]]
                asked = np.stack([measured[answers], known, acts[answers]], axis=1)
                message = answers_message(asked, run.command[answers])
                writer.write(topics.ANSWERED.name, log_time, message)
                answers.clear()
            for topic, (rows, messages) in records.items():
                index = written[topic]
                if index < len(rows) and rows[index] == k:
                    writer.write(topic.name, log_time, messages[index].tobytes())
                    written[topic] += 1
        writer.certificates = {
            topic.name: Certificate(writer.written[topic.name], 0) for topic in suite
        }


def _bytes_of(messages: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """The bytes of some messages, one row each: choosing records would lose what is between."""
    return np.frombuffer(messages.tobytes(), np.uint8).reshape(len(messages), -1)[chosen]
