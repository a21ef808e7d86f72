"""A running loop under observation: started, settled, disturbed, brought back, recorded."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from reliability.hosts import inside
from reliability.judging import Record, is_well
from reliability.loop import NODES, Loop
from reliability.watch_node import Watch, decoded

from parallel_robot_model.common.errors import RunError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.fields import group
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.messages import cdr, layouts, topics
from parallel_robot_sim.plant_core import state_layout
from trajectory_gen.configuration import trajectory_of

READY = 120.0  # s, for the nodes to be ready; their kernels may have to be compiled
LEAD = 1.0  # s, from the start being given to t = 0
GRID = NANOSECONDS // 10  # ns, grid of t = 0
PATIENCE = 20.0  # s, for the loop to recover
RECENT = 100  # poses, for a look at how the loop is
FRESH = 0.3  # s, age of the newest pose of a loop that runs
CLEAR = 0.5  # s, between two calls of ~/clear_fault
REPORT = 1.2  # s, within which every node publishes its diagnostics
NOTED = {  # what a node counts, by a word of its description: how it stands in the table
    'time-out': 'the motors take their safe action',
    'too old': 'states refused as too old',
    'stamps that repeat or go back': 'messages refused by their stamps',
    'stamps that jump back': 'later references dropped',
    'new runs': 'taken for a new run of the robot',
    'two publishers': 'taken for two publishers',
}
ERROR = 2  # level of diagnostic_msgs/DiagnosticStatus


class Bench:
    """A loop and who watches it; use as a context manager."""

    def __init__(
        self,
        folder: Path,
        changed: Mapping[str, Any],
        relay: Sequence[str] = (),
        far: str = '',
    ) -> None:
        """Start the processes, the controller on the host `far`; see Loop."""
        self.folder = folder
        self.changed = dict(changed)
        self.values = config.resolve('paper_circle', changed)
        self.relay = tuple(relay)
        self._trajectory = trajectory_of(self.values)
        joints = group(self.values, LoopParameters, '').joints
        self._layouts = {
            topics.JOINT_STATES: state_layout(joints, passive=len(joints)),
            topics.COMMANDS: layouts.float64_multi_array(len(joints)),
            topics.POSE: layouts.pose_stamped(topics.FRAME),
            topics.POSE_REFERENCE: layouts.pose_stamped(topics.FRAME),
        }
        self.far = far
        self.start = 0  # ns, stamp of t = 0
        self.watch = Watch()
        try:
            self.loop = Loop(folder, changed, relay, {'controller': inside(far)})
        except BaseException:
            self.watch.close()
            raise

    def __enter__(self) -> Bench:
        """Start the motion and let it settle.

        Raises:
            RunError: a node does not start, or the platform does not come to its reference.
        """
        try:
            self._until(self._ready, READY)
            now = time.time_ns()
            self.start = (now + round(LEAD * NANOSECONDS)) // GRID * GRID
            if not self.watch.start(self.start):
                raise RunError('the nodes do not take their start')
            self.recover()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        """End the processes."""
        self.close()

    def close(self) -> None:
        """End the processes."""
        try:
            self.loop.close()
        finally:
            self.watch.close()

    def run(self, inject: Callable[[Bench], str]) -> Record:
        """Inject a fault, bring the loop back as an operator would, and return what was seen."""
        counts = self._counts()
        self.watch.forget()
        began = time.time_ns()
        note, failures = '', []
        try:
            note = inject(self)
        except subprocess.SubprocessError as error:  # the other rows are still of interest
            failures.append(str(error))
        over = time.time_ns()
        try:
            self.recover()
            time.sleep(REPORT)
        except RunError as error:
            failures.append(str(error))
        failures += [
            f'{name} does not answer'
            for name in NODES
            if name not in self.loop.dead() and self.watch.trigger(f'{name}/ready') is None
        ]
        heard = {
            topic: decoded(layout, self.watch.heard[topic])
            for topic, layout in self._layouts.items()
        }
        stamps, distance = self._distances()
        applied = heard[topics.JOINT_STATES]['effort']
        return Record(
            (stamps - began) / NANOSECONDS,
            distance,
            (over - began) / NANOSECONDS,
            np.concatenate([applied[:, :3], heard[topics.COMMANDS]['data']]),
            all(
                bool(np.isfinite(records[name]).all())
                for records in heard.values()
                for name in records.dtype.names or ()
            ),
            tuple(text for _, text in self.watch.faults),
            tuple(filter(None, (note, *self._notes(counts)))),
            tuple(failures),
        )

    def recover(self) -> None:
        """Wait until the loop is well, clearing faults meanwhile.

        Raises:
            RunError: a node has ended, or the loop does not recover in time.
        """
        last, begun = 0.0, time.time_ns()

        def well() -> bool:
            nonlocal last
            now = time.monotonic()
            if now - last > CLEAR:
                last = now
                if self.watch.fault:
                    self.watch.trigger('controller/clear_fault', CLEAR)
                _, level, _, _ = self.watch.diagnostics.get('plant', (0, 0, '', {}))
                if level == ERROR:
                    self.watch.trigger('plant/reset', CLEAR)
            stamps, distance = self._distances(RECENT)
            age = (time.time_ns() - stamps) / NANOSECONDS
            fresh = bool(age.size) and age[-1] < FRESH
            since = stamps > begun  # what a fault does shows a little later
            return fresh and not self.watch.fault and is_well(-age[since], distance[since])

        self._until(well, PATIENCE)

    def _ready(self) -> bool:
        answers = [self.watch.trigger(f'{name}/ready', 0.5) for name in NODES]
        return all(answer is not None and answer[0] for answer in answers)

    def _until(self, condition: Callable[[], bool], patience: float) -> None:
        deadline = time.monotonic() + patience
        while not condition():
            for name, line in self.loop.dead().items():
                raise RunError(f'{name} ended: {line}')
            if time.monotonic() > deadline:
                raise RunError(f'not well within {patience:g} s')
            time.sleep(0.05)

    def _distances(self, last: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Stamps of the last poses [ns], and their distances from the motion [m]."""
        poses = decoded(self._layouts[topics.POSE], self.watch.heard[topics.POSE][-last:])
        stamps = cdr.stamps_of(poses)
        wanted = self._trajectory.sample((stamps - self.start) / NANOSECONDS).pose
        return stamps, np.hypot(poses['x'] - wanted[:, 0], poses['y'] - wanted[:, 1])

    def _counts(self) -> dict[tuple[str, str], int]:
        """What the nodes have counted of NOTED, by node and text."""
        counts: dict[tuple[str, str], int] = {}
        for name, (_, _, _, figures) in self.watch.diagnostics.items():
            for key, value in figures.items():
                for word, text in NOTED.items():
                    if word in key and value.isdigit():
                        counts[name, text] = counts.get((name, text), 0) + int(value)
        return counts

    def _notes(self, before: Mapping[tuple[str, str], int]) -> list[str]:
        """What the nodes have counted since."""
        notes = [
            f'{name}: {text}'
            for (name, text), count in self._counts().items()
            if count > before.get((name, text), 0)
        ]
        plant = self.watch.diagnostics.get('plant')
        return [*notes, *([f'plant: {plant[2]}'] if plant and plant[1] == ERROR else [])]
