"""The posture at given positions of the actuated joints: continued from the one before.

The passive joints follow on their branch. What is found depends on the posture before by no more
than rounding: it is rounded to a grid, from which the last step is the same for all.
"""

from __future__ import annotations

import math

import numpy as np

from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import internal, kernel
from parallel_robot_model.mechanisms.closures import (
    accelerations,
    bias,
    derive,
    errors,
    evaluate,
    motions,
    update_frames,
)
from parallel_robot_model.mechanisms.mechanism import (
    FOUND,
    NOT_CLOSED,
    NOT_FINITE,
    SINGULAR,
    Index,
    Mechanism,
)
from parallel_robot_model.mechanisms.spatial import clear, copy
from parallel_robot_model.mechanisms.tool import unwrap_rotation
from parallel_robot_model.mechanisms.workspace import FRAMES_SET, SIGN, Workspace, solve_vector

# The posture that a workspace keeps, and how a new one becomes it.
#
# Its last bits do not tell where it was looked for: passive positions are rounded to a grid, from
# which the last step is the same for all.

CLOSED = 1e-12  # error of a closed posture, in units of the length
POLISHED = 1e-13  # and at which no further step is needed
TRIES = 2  # of other points of the grid, where the trial was not near enough to know its own


@internal
def initialize(mechanism: Mechanism, workspace: Workspace) -> int:
    """Update the frames at the memory, unless they are up to date."""
    if workspace.state[FRAMES_SET] != 0:
        return FOUND
    copy(workspace.all, workspace.trial)
    copy(workspace.all, workspace.here)
    fault = converge(mechanism, workspace)
    if fault == FOUND:
        unwrap_rotation(mechanism, workspace)
        commit(mechanism, workspace)
        workspace.state[FRAMES_SET] = 1
    return fault


@internal
def commit(mechanism: Mechanism, workspace: Workspace) -> None:
    """Make the trial the memory."""
    copy(workspace.trial, workspace.all)
    for j in range(len(workspace.q)):
        workspace.q[j] = workspace.trial[mechanism.actuated[j]]


@internal
def commit_or_restore(mechanism: Mechanism, workspace: Workspace, fault: int, angle: float) -> int:
    """Make the trial the memory, or return to the memory after a fault."""
    if fault == FOUND:
        commit(mechanism, workspace)
    else:
        restore(mechanism, workspace, angle)
    return fault


@internal
def restore(mechanism: Mechanism, workspace: Workspace, angle: float) -> None:
    """Return to the posture of the memory."""
    workspace.angle[0] = angle
    copy(workspace.all, workspace.trial)
    evaluate(mechanism, workspace)
    derive(mechanism, workspace)


@internal
def converge(mechanism: Mechanism, workspace: Workspace) -> int:
    """Close the loops near the trial by Newton's method from a grid point; write W.

    The grid makes the result independent of the last bits of the trial.
    """
    r = len(workspace.error)
    if r == 0:
        update_frames(mechanism, workspace)
        workspace.state[SIGN] = 1
        return FOUND
    steps, tries = 0, 0
    round_to_grid(workspace, workspace.layout.passive)
    while steps < 4:
        sign = evaluate(mechanism, workspace)
        if sign == 0:
            return SINGULAR
        largest = 0.0
        for row in range(r):
            largest = max(largest, abs(workspace.error[row]))
        if steps > 0 and largest <= (POLISHED if steps < 3 else CLOSED):
            workspace.state[SIGN] = sign
            derive(mechanism, workspace)
            return FOUND
        correct(workspace)
        if steps == 0 and tries < TRIES and not _was_nearest(workspace):
            round_to_grid(workspace, workspace.layout.passive)
            tries += 1
        else:
            steps += 1
    return NOT_CLOSED


@internal
def round_to_grid(workspace: Workspace, joints: Index) -> None:
    """Round some joints of the trial to their grid."""
    grid, trial = workspace.layout.grid, workspace.trial
    for c in range(len(joints)):
        i = joints[c]
        trial[i] = grid[i] * np.rint(trial[i] / grid[i])


@internal
def _was_nearest(workspace: Workspace) -> bool:
    """Whether the trial before its correction was the point of the grid next to it."""
    passive, grid, scale = workspace.layout.passive, workspace.layout.grid, workspace.layout.scale
    nearest = True
    for c in range(len(passive)):
        i = passive[c]
        nearest &= abs(scale[i] * workspace.single[c]) <= 0.5 * grid[i]
    return nearest


@internal
def correct(workspace: Workspace) -> float:
    """Correct the trial by its errors.

    Returns:
        The largest correction of a joint, in its units.
    """
    single, layout = workspace.single, workspace.layout
    for k in range(len(single)):
        single[k] = workspace.error[k]
    solve_vector(workspace.factors, single)
    size = 0.0
    for c in range(len(single)):
        i = layout.passive[c]
        workspace.trial[i] -= layout.scale[i] * single[c]
        size = max(size, abs(single[c]))
        if math.isnan(single[c]):
            return np.nan
    return size


ATTEMPTS = 1000  # steps of one way, those that failed included
SHORTEST = 2.0**-30  # step, of the rest of the way, that is tried
LONGEST = 0.5  # rad, change of a passive joint in a step
CHORDS = 12  # corrections of a step
BENT = 0.4  # change of the Jacobian in a step, relative, at which corrections converge well
FAST = 1e3  # rates of passive joints over those of actuated ones, at the end of the reach
COARSE = 1e-7  # accuracy of a posture in between
EXACT = 2e-14  # and of one that is rounded to the grid next
NEAR = 2e-10  # error of a prediction that mostly has the right point of the grid next to it
NOISE = 1e-11  # corrections below it need not become smaller


@kernel
def close(mechanism: Mechanism, workspace: Workspace, q: Array) -> int:
    """Find the posture at positions of the actuated joints, near that of the memory.

    Args:
        mechanism: The mechanism.
        workspace: Its workspace; the memory is the posture found, and stays in a fault.
        q: Actuated joints [rad or m], shape (n,).

    Returns:
        FOUND, NOT_CLOSED, SINGULAR or NOT_FINITE.
    """
    return _record_answer(mechanism, workspace, q, EXACT)


@kernel
def close_coarsely(mechanism: Mechanism, workspace: Workspace, q: Array) -> int:
    """As :func:`close`, with an error of COARSE, for a posture that is only judged.

    The next way begins there, that of :func:`close` to the same positions, too.
    """
    fault = _record_answer(mechanism, workspace, q, COARSE)
    if fault == FOUND:
        workspace.q[0] = np.nan
    return fault


@internal
def _record_answer(mechanism: Mechanism, workspace: Workspace, q: Array, accuracy: float) -> int:
    """Find the posture with an accuracy, EXACT or COARSE."""
    fault = initialize(mechanism, workspace)
    if fault != FOUND or _same(q, workspace.q):
        return fault
    if not finite(q):
        return NOT_FINITE
    angle = workspace.angle[0]
    if len(workspace.error) == 0 and workspace.layout.rotation_coordinate == 0:
        for j in range(len(q)):
            workspace.trial[mechanism.actuated[j]] = q[j]
        update_frames(mechanism, workspace)
        fault = FOUND
    else:
        fault = _follow_path(mechanism, workspace, q, accuracy)
    return commit_or_restore(mechanism, workspace, fault, angle)


@internal
def _same(a: Array, b: Array) -> bool:
    same = True
    for i in range(len(a)):
        same &= a[i] == b[i]
    return same


@internal
def finite(x: Array) -> bool:
    """Whether all elements are numbers."""
    total = 0.0
    for i in range(len(x)):
        total += 0.0 * x[i]
    return total == 0.0


@internal
def _follow_path(mechanism: Mechanism, workspace: Workspace, q: Array, accuracy: float) -> int:
    """Go from the memory to positions of the actuated joints, step by step."""
    copy(workspace.all, workspace.here)
    share = 1.0
    bent, length = _write_tangent(mechanism, workspace, q)
    exactly = accuracy == EXACT
    near = length * bent * bent <= (NEAR if exactly else 0.1 * COARSE)
    near &= bent <= BENT and length <= LONGEST
    near &= not (exactly and math.isnan(workspace.q[0]))  # from where loops are closed well
    for _ in range(ATTEMPTS):
        if share < SHORTEST:
            break
        last = share >= 1.0
        failed = FOUND
        if near:
            _predict(mechanism, workspace, q, share)
        elif not _step(mechanism, workspace, q, share, bent, length, accuracy):
            failed = NOT_CLOSED
        if failed == FOUND:
            failed = evaluate_trial(mechanism, workspace, last and exactly)
        if failed == FOUND and near and not exactly:
            failed = FOUND if correct(workspace) <= COARSE else NOT_CLOSED
        if failed == FOUND and not unwrap_rotation(mechanism, workspace):
            failed = NOT_CLOSED
        if failed == FOUND and last:
            if not exactly:
                derive(mechanism, workspace)
            return FOUND
        if failed == FOUND:
            copy(workspace.trial, workspace.here)
            derive(mechanism, workspace)
            bent, length = _write_tangent(mechanism, workspace, q)
            share = 2.0 * share / (1.0 - share)
            share = share if share < 0.9 else 1.0
            continue
        if last or failed == SINGULAR:  # have the factors of the last posture of the way again
            copy(workspace.here, workspace.trial)
            evaluate(mechanism, workspace)
        share = share if near else 0.5 * share
        near = False
    driven = 0.0
    for j in range(len(q)):
        i = mechanism.actuated[j]
        driven = max(driven, abs(workspace.way[0, i]) / workspace.layout.scale[i])
    return stop_reason(length, driven)


@internal
def evaluate_trial(mechanism: Mechanism, workspace: Workspace, exactly: bool) -> int:
    """Compute errors and factors at the trial, made exact on demand; FOUND or a fault."""
    sign, fault = workspace.state[SIGN], FOUND
    if exactly:
        fault = converge(mechanism, workspace)
        found, workspace.state[SIGN] = workspace.state[SIGN], sign
    else:
        found = evaluate(mechanism, workspace)
    return SINGULAR if fault == FOUND and found != sign else fault


@internal
def stop_reason(length: float, driven: float) -> int:
    """Why a path ends at `here`: NOT_CLOSED at the end of the reach, else SINGULAR."""
    return NOT_CLOSED if not length <= FAST * driven else SINGULAR


@internal
def _write_tangent(mechanism: Mechanism, workspace: Workspace, q: Array) -> tuple[float, float]:
    """Write the derivatives of the way to q."""
    way, W, here = workspace.way, workspace.W, workspace.here
    clear(way[0])
    for i in range(len(here)):
        for j in range(len(q)):
            way[0, i] += W[i, j] * (q[j] - here[mechanism.actuated[j]])
    if len(workspace.error) == 0:
        clear(way[1])
        return 0.0, 0.0
    motions(mechanism, workspace, way[0])
    clear(way[1])
    accelerations(mechanism, workspace, way[0], way[1])
    bias(mechanism, workspace, way[1])
    first, second = 0.0, 0.0
    for c in range(len(workspace.layout.passive)):
        i = workspace.layout.passive[c]
        way[1, i] *= 0.5
        first = max(first, abs(way[0, i]) / workspace.layout.scale[i])
        second = max(second, abs(way[1, i]) / workspace.layout.scale[i])
    return 2.0 * second / first if first > 0.0 else 0.0, first


@internal
def _predict(mechanism: Mechanism, workspace: Workspace, q: Array, share: float) -> None:
    """Write the trial at a share of the way, by its derivatives."""
    trial, here, way = workspace.trial, workspace.here, workspace.way
    for i in range(len(trial)):
        trial[i] = here[i] + share * (way[0, i] + share * way[1, i])
    if share >= 1.0:
        for j in range(len(q)):
            trial[mechanism.actuated[j]] = q[j]


@internal
def _step(
    mechanism: Mechanism,
    workspace: Workspace,
    q: Array,
    share: float,
    bent: float,
    length: float,
    accuracy: float,
) -> bool:
    """Go a share of the way, and close the loops there with the factors from its begin.

    Those of the trial take their place once where that saves corrections of the last step.
    """
    bent *= share
    length *= share
    if not (bent <= BENT and length <= LONGEST):
        return False
    _predict(mechanism, workspace, q, share)
    if len(workspace.error) == 0:
        update_frames(mechanism, workspace)
        return True
    enough = accuracy if share >= 1.0 else COARSE
    before = length + 10.0 * COARSE  # the posture where the way begins is not closed better
    curved = bent / length if length > 0.0 else 0.0  # change of the Jacobian by a correction
    anew = False
    for k in range(CHORDS):
        if anew:
            if evaluate(mechanism, workspace) == 0:
                return False
        else:
            update_frames(mechanism, workspace)
            errors(mechanism, workspace)
        size = correct(workspace)
        if not size <= (BENT * before if k > 0 else before) + NOISE:
            return False
        if k > 0 and before > NOISE:
            bent = max(bent, size / before)
        if anew:
            bent = curved * size
        anew = k == 0 and share >= 1.0 and size * bent * bent > enough
        if size * bent <= enough:
            return True
        if size <= NOISE and size >= BENT * before:
            return True
        before = size
    return False
