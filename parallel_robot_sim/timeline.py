"""What hazards make of the course of a run: which states are answered, and what happens when."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from parallel_robot_control.assembly import Control
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller_state import clear, drop_torque, join, rejoin, trip
from parallel_robot_control.reference_buffer import extrapolate_rows
from parallel_robot_control.safety import faults, limiting
from parallel_robot_model.common.units import NANOSECONDS, Array
from parallel_robot_model.configuration.hazard_table import REASONS, Reception
from parallel_robot_sim.configuration import Plant
from trajectory_gen.trajectory import Reference


class Timeline(NamedTuple):
    """The course of a run, or of a part of one."""

    reception: Reception  # which states come to the controller, and which references it knows
    # time from the measurement of the state answered before to that of this one [s], shape
    # (N,)
    dt: Array
    reference: Reference  # desired motion as the controller knows it, one row for each sample
    # samples at which a state is answered and that is too old, shape (N,)
    stale: NDArray[np.bool_]
    # samples at which a state is answered and that is told to be old, shape (N,)
    overdue: NDArray[np.bool_]
    late: frozenset[int]  # samples at which the first state comes after too long
    # samples at which states have been refused for too long, and the fault that it is
    lost: Mapping[int, int]
    # samples at which the first state comes after a call of ``~/clear_fault``
    clears: frozenset[int]
    # samples at which a controller hears its first state; 0 is not among them
    renewals: frozenset[int]

    @property
    def returns(self) -> list[int]:
        """Samples at which references are there again."""
        rows = np.flatnonzero(self.reception.answered)
        returns: list[int] = rows[1:][np.diff(self.overdue[rows].astype(int)) < 0].tolist()
        return returns

    @property
    def cuts(self) -> list[int]:
        """Samples at which something happens to the controller before it answers."""
        rows_of_events = {0, *self.late, *self.lost, *self.clears, *self.renewals, *self.returns}
        rows = np.flatnonzero(self.reception.answered)
        begun = np.diff(self.stale[rows], prepend=False) & self.stale[rows]
        count = len(self.reception.answered)
        return sorted(k for k in {*rows_of_events, *rows[begun].tolist()} if not k or k < count)

    def apply_events(self, sample: int, control: Control, effort: Array, cause: int) -> None:
        """Let happen to the controller what does before it answers the state of a sample.

        Args:
            sample: Index of the sample.
            control: The controller, after the sample before.
            effort: Torque of the motors before the sample [N m], shape (n,).
            cause: Fault whose cause was there at the state before.
        """
        cycle: Any = control.setup.memory.state
        if sample in self.renewals:
            cycle.value, cause = control.state, faults.NONE
            join(cycle, effort)
            control.law.reset_memory()
        before = np.flatnonzero(self.reception.answered[:sample])[-1:]
        refused = ~self.reception.answered[np.flatnonzero(self.reception.published[:sample])[-1:]]
        lasts = cause != faults.NONE or self.stale[before].any() or refused.any() or cycle.lost
        if sample in self.clears and cycle.fault != faults.NONE and not lasts:
            clear(cycle)
            control.law.reset_memory()
        if sample in self.lost:
            trip(cycle, self.lost[sample])
            drop_torque(cycle)
        if sample in self.late:
            trip(cycle, faults.STATES_STALE)
            drop_torque(cycle)
        if sample in self.returns:
            rejoin(cycle)
        if len(self.stale) and self.stale[sample]:
            trip(cycle, faults.REFERENCE_STALE)


def timeline_of(plant: Plant, reference: Reference, period: float, first: int = 0) -> Timeline:
    """The course of a run over all samples of a reference.

    Args:
        plant: The plant, with its hazards.
        reference: Desired motion, one sample per period.
        period: Time between samples [s].
        first: Sample of its first row: 0, or one after all hazards.
    """
    count, tick, table = len(reference.position), round(period * NANOSECONDS), plant.hazards
    samples = np.arange(count)
    reception, dt = table.reception(first + samples), np.full(count, period)
    stale, overdue = np.zeros((2, count), bool)
    if first >= table.undisturbed_from:
        none: frozenset[int] = frozenset()
        reception = reception._replace(newest=samples)
        return Timeline(reception, dt, reference, stale, overdue, none, {}, none, none)
    # 1. Times between the states that are answered.
    rows = np.flatnonzero(reception.answered)
    measured = (samples - reception.late)[rows]
    steps = tick * np.diff(measured)
    dt[rows[1:]] = steps / NANOSECONDS
    renewed = {*_first(rows, table.renewals), *rows[:1].tolist()}
    dt[[*renewed]] = period
    gaps = {*rows[1:][steps > round(plant.safety.state_timeout * NANOSECONDS)].tolist()} - renewed
    # 2. References.
    age = tick * (samples - reception.newest)
    old = age > round(plant.safety.reference_timeout * NANOSECONDS)
    stale[rows] = old[measured]
    overdue[rows] = age[measured] > round(limiting.OVERDUE * NANOSECONDS)
    clears = _first(np.flatnonzero(reception.published), table.clears)
    return Timeline(
        reception,
        dt,
        _known(reference, reception.newest, age, old),
        stale,
        overdue,
        frozenset(gaps),
        {k: faults.NUMBERS[REASONS[why]] for k, why in table.lost.items() if k < count},
        frozenset(k for k in clears if reception.answered[k]),
        frozenset(renewed - {0}),
    )


def _first(rows: NDArray[np.int64], samples: list[int]) -> list[int]:
    """The first rows from some samples on; fewer at the end."""
    places = np.searchsorted(rows, samples)
    return [int(row) for row in rows[places[places < len(rows)]]]


def _known(
    reference: Reference, known: NDArray[np.int64], age: NDArray[np.int64], old: NDArray[np.bool_]
) -> Reference:
    """References extrapolated from the newest known ones; at rest where those are too old."""
    lost = age > 0
    fields = ('position', 'velocity', 'acceleration')
    rows = [getattr(reference, name)[known[lost]] for name in fields]
    reference_then: JointReference = extrapolate_rows(age[lost], *rows)
    changed = {}
    for name, values, before in zip(fields, reference_then, rows, strict=True):
        whole = getattr(reference, name).copy()
        at_rest = before if name == 'position' else np.zeros_like(before)
        whole[lost] = np.where(old[lost][:, np.newaxis], at_rest, values)
        changed[name] = whole
    return reference._replace(**changed)
