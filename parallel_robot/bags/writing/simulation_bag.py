"""The bag of a closed loop without ROS: the same topics, types and stamps as the nodes' bag."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.bags import trust
from parallel_robot.bags.experiment import SIMULATION, describe
from parallel_robot.bags.files.bag_files import Certificate
from parallel_robot.bags.files.mcap_writer import Rows
from parallel_robot.bags.output import Progress
from parallel_robot.bags.writing.bag_writer import BagWriter
from parallel_robot_control.estimation.lock_in import delay_text
from parallel_robot_control.messages import (
    Status,
    answers_message,
    reported_limits,
    status_message,
    telemetry_messages,
)
from parallel_robot_control.safety import faults
from parallel_robot_model.common.errors import RunError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.messages import layouts, topics
from parallel_robot_sim.plant_core import ReportedEffort, state_layout, state_messages
from parallel_robot_sim.simulation import Simulation
from parallel_robot_sim.timeline import Timeline
from trajectory_gen.messages import pose_messages, reference_messages

AT_ONCE = 20_000  # samples whose messages are put together at once
STAMPS = 3  # of an answer, before its torques
RANKS = 16  # more than the topics of a sample: the order of its messages


def save(directory: str | Path, values: Mapping[str, Any], parts: Iterable[Simulation]) -> None:
    """Write a simulation as a bag, see :func:`write`.

    Raises:
        BagError: the directory exists or cannot be created.
        RunError: the disk is full or gone.
    """
    try:
        write(directory, values, parts)
    except OSError as error:
        raise RunError(f'cannot write {directory}: {error.strerror}') from None


def write(directory: str | Path, values: Mapping[str, Any], parts: Iterable[Simulation]) -> None:
    """Write a simulation as a bag, part by part as they come.

    Args:
        directory: Where the bag will be; must not exist. It is made when there is a first part.
        values: The resolved configuration.
        parts: The simulated run, in parts that follow one another; at least one.

    Raises:
        BagError: the directory exists or cannot be created.
        OSError: the disk is full or gone.
    """
    coming = iter(parts)
    part = next(coming)
    loop, robot = part.experiment.loop, part.experiment.trajectory.robot
    suite, count = topics.recorded(robot.place > 0), (loop.last_index or 0) + 1
    facts = describe(loop, values, loop.step_start, SIMULATION)
    sources = [trust.attachment(*file) for file in trust.named_files(values)]
    with BagWriter(directory, suite, facts) as writer, Progress(count, 'states written') as shown:
        for name, source in sources:
            writer.attach(name, source)
        law = layouts.text_message(part.experiment.control.law.name)
        writer.write(topics.ACTIVE_LAW.name, loop.step_start, law)
        streams = _Streams(values)
        while True:
            following = next(coming, None)
            done = 0
            for some in _pieces(streams.of(part, following is None), part.run.steps):
                writer.extend(some)
                done += AT_ONCE
                shown.show(part.first + min(done, part.run.steps))
            if following is None:
                break
            part = following
        counts = writer.written
        writer.certificates = {topic.name: Certificate(counts[topic.name], 0) for topic in suite}


def _pieces(streams: Sequence[Rows], count: int) -> Iterator[list[Rows]]:
    """The messages of a part of a run of so many samples, AT_ONCE samples at a time."""
    for begin in range(0, count, AT_ONCE):
        limits = RANKS * np.array([begin, begin + AT_ONCE])
        rows = [slice(*np.searchsorted(each.places, limits)) for each in streams]
        yield [
            Rows(each.topic, each.places[some], each.log_times[some], each.payloads[some])
            for each, some in zip(streams, rows, strict=True)
        ]


class _Streams:
    """The messages of a run, part by part: what a part hands on to the next."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self._passive: bool = values['plant.publish_passive']
        self._effort: ReportedEffort | None = None
        self._status: Status | None = None
        self._limits = 0, 0  # those of the status, and when one acted [ns]
        self._acts = 0  # ns, of the last state that was answered
        self._answers: np.ndarray | None = None  # that no message tells yet

    def of(self, part: Simulation, last: bool) -> list[Rows]:
        """The messages of a part; `last`: whether it is the last one."""
        experiment, reference, run = part.experiment, part.reference, part.run
        loop, robot = experiment.loop, experiment.trajectory.robot
        count = run.steps
        timeline, samples = part.timeline, np.arange(count)
        reception = timeline.reception
        begin = loop.step_start + part.first * loop.period_ns
        stamps = begin + samples * loop.period_ns
        acts = stamps - reception.late * loop.period_ns  # as the controller knows it
        measured = acts - round(part.age * NANOSECONDS)
        slow = due = samples[-part.first % topics.SLOW :: topics.SLOW]
        if not part.first:
            due = experiment.plant.hazards.due(count, topics.SLOW)
        if self._effort is None:
            self._effort = ReportedEffort(round(part.age / loop.period))
        told = self._effort.of(run.effort[:count])[samples - np.maximum(reception.late, 0)]
        passive = run.passive_position.shape[1] if self._passive else 0
        layout = state_layout(loop.joints, passive)
        states = state_messages(layout, measured, run, told)
        commands = layouts.float64_multi_array(len(loop.joints)).records(
            count, data=run.command[:count]
        )
        records = {
            topics.JOINT_STATES: (
                samples[reception.published],
                _bytes_of(states)[reception.published],
            ),
            topics.REFERENCE: (
                samples,
                _bytes_of(reference_messages(loop.joints, stamps, reference)),
            ),
            topics.COMMANDS: (
                samples[reception.answered],
                _bytes_of(commands)[reception.answered],
            ),
        }
        telemetry = topics.Telemetry(*(each[due] for each in run.telemetry))
        for topic, messages in telemetry_messages(loop.joints, measured[due], telemetry).items():
            records[topic] = due, _bytes_of(messages)
        if robot.place:
            shown = slow[reception.shown[slow]]
            poses = pose_messages(robot, stamps[shown], run.pose[shown])
            records[topics.POSE] = shown, _bytes_of(poses)
            poses = pose_messages(robot, stamps[slow], reference.pose[slow])
            records[topics.POSE_REFERENCE] = slow, _bytes_of(poses)
        known = begin + reception.newest * loop.period_ns
        answered = np.flatnonzero(reception.answered)
        asked = [measured[answered], known[answered - reception.late[answered]], acts[answered]]
        answers = np.hstack([np.stack(asked, axis=1), run.command[answered].view(np.int64)])
        logged = np.union1d(due, [count - 1] if last else due)
        return [
            self._statuses(part, timeline, measured, acts),
            self._answered(logged, stamps, answered, answers),
            *(
                Rows(topic.name, RANKS * rows + rank, stamps[rows], messages)
                for rank, (topic, (rows, messages)) in enumerate(records.items(), 2)
            ),
        ]

    def _statuses(
        self, part: Simulation, timeline: Timeline, measured: np.ndarray, acts: np.ndarray
    ) -> Rows:
        """Where the status changes."""
        experiment, count = part.experiment, part.run.steps
        answered = timeline.reception.answered
        limits = reported_limits(
            part.run.active_limits[:count], measured, answered, timeline.renewals, self._limits
        )
        last = np.maximum.accumulate(np.where(answered, np.arange(count), -1))
        acted = np.where(last < 0, self._limits[0], limits[last])
        since = np.where(last < 0, self._acts or acts[0], acts[last])
        told = answered.copy()
        told[[*timeline.lost]] = True
        rows = np.flatnonzero(told)
        phases = part.phases
        kinds = np.stack([part.run.fault[rows], acted[rows], phases[rows]], axis=1)
        changes = np.any(np.diff(kinds, axis=0, prepend=kinds[:1] - 1), axis=1)
        robot = experiment.trajectory.robot
        known, units = faults.of(robot.module), robot.joint_units
        chosen, messages = [], []
        refused = {k: part.refusal(number) for k, number in part.refused}
        for k in sorted({*rows[changes].tolist(), *refused}):
            delay = delay_text(experiment.control.setup, int(phases[k]), units)
            fault, law = known.get(int(part.run.fault[k])), experiment.control.law.name
            now = Status(law, fault, int(acted[k]), delay, refused=refused.get(k, ''))
            if now != self._status:
                self._status = now._replace(refused='')
                chosen.append(k)
                messages.append(status_message(int(since[k]), now))
        acting = np.flatnonzero((part.run.active_limits[:count] != 0) & answered)
        stamp = int(measured[acting[-1]]) if acting.size else self._limits[1]
        self._limits, self._acts = (int(acted[-1]), stamp), int(since[-1])
        places = np.array(chosen, np.int64)
        return Rows(topics.STATUS.name, RANKS * places, since[places], messages)

    def _answered(
        self, logged: np.ndarray, stamps: np.ndarray, answered: np.ndarray, answers: np.ndarray
    ) -> Rows:
        """What the commands answer, told at the samples `logged`."""
        before = answers[:0] if self._answers is None else self._answers
        waiting = np.vstack([before, answers])
        ends = len(before) + np.searchsorted(answered, logged, side='right')
        some = np.diff(ends, prepend=0) > 0
        places, ends = logged[some], ends[some].tolist()
        messages = [
            answers_message(waiting[a:b, :STAMPS], waiting[a:b, STAMPS:].view(np.float64))
            for a, b in itertools.pairwise([0, *ends])
        ]
        self._answers = waiting[ends[-1] if ends else 0 :]
        return Rows(topics.ANSWERED.name, RANKS * places + 1, stamps[places], messages)


def _bytes_of(messages: np.ndarray) -> np.ndarray:
    """The bytes of messages, one row each: choosing records would lose what is between."""
    return np.frombuffer(messages.tobytes(), np.uint8).reshape(len(messages), -1)
