"""Messages of a bag as a run log: one row for each state, with what belongs to it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from parallel_robot.bags.bag_reader import AS_RECORDED, Bag, BagView
from parallel_robot.bags.experiment import SIMULATION
from parallel_robot.bags.messages.message_arrays import WHOLE, Samples, Span
from parallel_robot.bags.run import matching, run_messages, two_sources
from parallel_robot.bags.run.matching import Answers, Used
from parallel_robot.bags.run.run_log import RunLog, count, rows, within
from parallel_robot.bags.run.run_messages import beyond, doubts, too_strong
from parallel_robot.bags.run.two_sources import Contradiction
from parallel_robot_control.joint_states import StateRhythm
from parallel_robot_control.reference_buffer import REFERENCE_FIELDS
from parallel_robot_model.common.errors import BagError
from parallel_robot_model.common.units import NANOSECONDS
from parallel_robot_model.configuration.loop import LoopParameters
from parallel_robot_model.messages import topics
from parallel_robot_model.messages.topics import Topic
from parallel_robot_model.robots.registry import units_of
from parallel_robot_sim.imperfections import reported_age


def aligned(
    bag: Path,
    found: Bag[list[Samples]],
    streams: Mapping[Topic, list[Samples]],
    settings: tuple[dict[str, Any], LoopParameters, int],
    view: BagView = AS_RECORDED,
    span: Span = WHOLE,
) -> RunLog:
    """The run of a bag, or a part of it.

    Args:
        bag: The bag, for error messages.
        found: What was read of it.
        streams: Its messages, see :func:`run_messages.streams_of`.
        settings: See :func:`experiment.configuration`.
        view: What it does not say itself.
        span: The part; messages around it are there, too.

    Raises:
        BagError: it is not of a run, or a topic that the log needs is not in it.
    """
    (values, loop, start), known = settings, bool(found.metadata)
    units, age, view = units_of(values), reported_age(values), view.of(known)
    messages = run_messages.of(bag, found, streams, loop.joints, units)
    states, references, warnings = messages.states, messages.references, messages.warnings
    if not start and span == WHOLE:  # of a part it is known
        start = int(max(states.stamps[0], references.stamps[0]))
    used = _used(bag, states.stamps + age, max(start, int(references.stamps[0])))
    stamps, position = states.stamps[used], states.numbers['position'][used]
    effort = states.numbers['effort'][used] if 'effort' in states.numbers else None
    desired = matching.reference_at(
        stamps, references.stamps, *(references.numbers[name] for name in REFERENCE_FIELDS)
    )
    time = (stamps - start) / NANOSECONDS
    part: slice | np.ndarray = slice(None)
    if (view.start, view.stop) != (None, None):
        part = within(time, view.start, view.stop)
    told = [*_repeated(stamps), *doubts(bag, stamps[part], position[part], units)]
    if not known:  # units and signs of the suite are known
        told += beyond(position[part], units)
        if effort is not None:
            strongest = np.asarray(values.get('plant.torque_limit', np.inf), np.float64)
            told += too_strong(effort[part], strongest, units)
    rhythm = StateRhythm(loop.period_ns)
    rhythm.note(stamps)
    rhythm.look()
    if known and rhythm.warning and not loop.lockstep:
        told.append(rhythm.warning)
    limit = matching.timeout(values, references.stamps)
    referenced = matching.newest_age(stamps + age, references.stamps) <= limit
    if span == WHOLE and not referenced.all():
        told.append(matching.without_reference(stamps, start, references.stamps, referenced))
    warnings += [f'{bag}: {each}' for each in told]
    assumed = _assumed(values, loop.joints, known, view)
    if assumed:
        warnings.append(f'{bag} {assumed}')
    answer, answers, in_use = _answers(
        stamps, states, references, messages.commands, messages.answers, span == WHOLE
    )
    apart = Contradiction(), Contradiction()
    if found.metadata.get('source') != SIMULATION:  # whose units, signs and faults are known
        period = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
        about = (position[part], desired[0][part], period, units)
        apart = two_sources.positions(loop.joints, *about), apart[1]
        if effort is not None and np.isfinite(answer).any():
            about = (effort[part], _commanded(answer)[part], period, units)
            apart = apart[0], two_sources.efforts(loop.joints, *about)
        warnings += [f'{bag}: {each.text}' for each in apart if each.text]
    states_period = loop.period_ns if loop.lockstep else rhythm.period
    run = RunLog(
        loop.scenario if known or view.assumes else 'unknown',
        loop.law if known or view.assumes else 'unknown',
        loop.joints,
        values,
        start,
        stamps,
        time,
        position,
        states.numbers['velocity'][used],
        _commanded(answer) if effort is None else effort,
        *desired,
        messages.commands.numbers['data'],
        count(messages.streams, loop.period_ns, messages.answers, states_period, span),
        answer,
        states.log_times[used],
        answers,
        in_use,
        effort is not None,
        tuple(warnings),
        referenced,
        not known,
        *apart,
    )
    if span == WHOLE:
        return run
    inside = np.flatnonzero((run.stamps >= span.begin) & (run.stamps < span.end))
    return rows(run, inside)._replace(
        command=run.command[span.holds(topics.COMMANDS, messages.commands)],
        answers=answers and answers.between(span.begin_heard, span.end_heard),
    )


def _used(bag: Path, acts: np.ndarray, first: int) -> np.ndarray:
    """Which states have a reference at or before them, shape (N,).

    Args:
        bag: The bag, for error messages.
        acts: Times of the states [ns], shape (N,).
        first: The first time that has a reference and belongs to the run [ns].
    """
    used: np.ndarray = acts >= first
    if not used.any():
        raise BagError(f'{bag}: no state has a reference at or before its stamp')
    kept = acts[used]
    if len(kept) > 1 and not (kept[-1] > kept[0] and np.median(np.diff(kept)) > 0.0):
        raise BagError(f'{bag}: the stamps of {topics.JOINT_STATES.name} do not increase')
    return used


def _repeated(stamps: np.ndarray) -> list[str]:
    """That states repeat stamps [ns], shape (N,), a line, if they do."""
    repeated = int((np.diff(np.sort(stamps)) == 0).sum())
    if not repeated:
        return []
    what = f'{repeated} messages on {topics.JOINT_STATES.name} repeat a stamp'
    return [f'{what}: the motion was reset, or had two publishers']


def _answers(
    stamps: np.ndarray,
    states: Samples,
    references: Samples,
    commands: Samples,
    recorded: Answers | None,
    whole: bool,
) -> tuple[np.ndarray, Answers | None, Used | None]:
    """Commands of the states with these stamps; see RunLog.answer, answers and used."""
    answers, sure = recorded, True
    if answers is None:
        answers, sure = matching.match_by_time(states, commands, whole)
    command = matching.command_of_states(stamps, answers.states)
    answer = answers.torque[command]
    answer[command < 0] = np.nan
    if recorded is None:
        return answer, answers if sure else None, None
    known = np.where(command < 0, 0, answers.references[command])
    acts = np.where(known > 0, answers.acts[command], stamps)
    return answer, answers, matching.used_references(stamps, acts, known, references)


def _commanded(answer: np.ndarray) -> np.ndarray:
    """Torques commanded before each state: the last answer to an earlier one, at first zero.

    Args:
        answer: Command that answered each state [N m], NaN where there is none, shape (N, n).
    """
    given = np.vstack([np.zeros((1, answer.shape[1])), answer[:-1]])
    known = np.isfinite(given).all(axis=1)
    return given[np.maximum.accumulate(np.where(known, np.arange(len(given)), 0))]


def _assumed(values: Mapping[str, Any], joints: Sequence[str], known: bool, view: BagView) -> str:
    """What was assumed of a bag that does not say of what it is; empty where nothing was."""
    given = view.told()
    if known:
        return f'is read with {given} in place of what it says itself' if given else ''
    robot = f'{values["robot_model"]} with the parameters of {view.scenario or "the paper"}'
    what = f'does not say of which robot it is: taken to be of {robot}, joints {", ".join(joints)}'
    return f'{what}; given: {given}' if given else f'{what}; --scenario and --set say another'
