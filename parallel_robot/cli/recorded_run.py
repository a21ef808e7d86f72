"""A run that was recorded, and its results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from parallel_robot.analysis import evaluated_bag, readable_metrics, run_results, timing
from parallel_robot.analysis.evaluated_bag import EvaluatedBag
from parallel_robot.analysis.run_results import MotionAlone
from parallel_robot.analysis.timing import Timing
from parallel_robot.bags import history
from parallel_robot.bags.limits import TRUSTED
from parallel_robot.bags.reading.bag_view import AS_RECORDED
from parallel_robot.bags.run import recorded_robot, run_log, run_windows
from parallel_robot.bags.run.recorded_robot import RobotCode
from parallel_robot_model.common.tables import Part
from parallel_robot_model.configuration.loop import length


class Made(NamedTuple):
    """A run that was recorded.

    Attributes:
        log: The run; of a long one, its last states.
        past: What happened beside the motion.
        timed: How it kept its time.
        evaluated: Returns all of its figures.
    """

    log: run_log.RunLog
    past: history.History
    timed: Timing
    evaluated: Callable[[], EvaluatedBag]

    @property
    def failure(self) -> str:
        """Why it has no figures; empty if it has."""
        return history.failure(self.past, self.log.start_stamp, int(self.log.stamps[-1]))


def read(out: Path, code: RobotCode) -> Made:
    """Read the bag of a run, a long one in windows.

    Raises:
        BagError: it has no state.
    """
    if evaluated_bag.long(out, AS_RECORDED):
        found = evaluated_bag.evaluate(out, code, motion_only=False)
        assert not isinstance(found, MotionAlone)
        return Made(found.log, found.past, found.timing, lambda: found)
    whole = recorded_robot.read(out, TRUSTED, code)
    timed = timing.evaluate(whole.log, whole.history)
    return Made(whole.log, whole.history, timed, lambda: evaluated_bag.of_whole(out, whole))


def lines(made: Made) -> list[str]:
    """The metrics of a run up to the first state without a pose, in lines."""
    log = made.log
    if made.failure:
        return [f'{log.scenario}, {log.law}: no figures of a run that was {made.failure}']
    found = made.evaluated()
    laws = ', then '.join(run_windows.laws_of(found.parts))
    head = readable_metrics.head(log.scenario, laws, found.metrics, length(log.config))
    told = [head, *readable_metrics.brief(found.metrics, log.messages)]
    return [*told, *_remarks(found)]


def _remarks(found: EvaluatedBag) -> list[str]:
    return [f'  {text}' for text in (*found.remarks, *run_windows.stretches_told(found.parts))]


def tables(made: Made) -> tuple[list[Part], dict[str, Any]]:
    """The metrics as tables, and as plain data."""
    verdict = [*filter(None, [timing.verdict(made.timed)])]
    if made.failure:
        names = {'scenario': made.log.scenario, 'law': made.log.law}
        told = {'failure': made.failure, 'timing': timing.as_json(made.timed)}
        return [*verdict, *lines(made)], names | told
    found = made.evaluated()
    data = run_results.summarise(made.log, found.metrics, made.timed)
    data['law'] = ', then '.join(run_windows.laws_of(found.parts))
    parts = run_results.tables(data, found.metrics, length(made.log.config))
    return [*verdict, *parts, *_remarks(found)], data
