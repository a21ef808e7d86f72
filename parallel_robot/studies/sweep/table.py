"""The table of a sweep: one row for each run, units in the names of the columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from types import ModuleType
from typing import Any

import numpy as np

from parallel_robot.analysis.metrics import Metrics, Value, of_seen, of_true
from parallel_robot.studies.sweep.plan import Plan, Row
from parallel_robot.studies.sweep.run_chunk import Floor, Outcome
from parallel_robot_model.common.errors import optional
from parallel_robot_model.common.units import HINGES, JointUnits
from parallel_robot_model.configuration.config_files import scenario_stem

# Which run it is, and what became of it.
IDENTITY = ('row', 'law', 'scenario', 'sample', 'seed', 'status', 'reason', 'limits')
Arrow = Any  # a pyarrow.Table; pyarrow is optional, and untyped


def _reached(value: Value) -> Callable[[Metrics], float]:
    """A metric whose time until a state is reached is infinite if it never is."""

    def number(found: Metrics) -> float:
        known = value(found)
        return math.inf if known is None else known

    return number


OF_MOTION: dict[str, Value] = {
    'to_1_mm_s': lambda m: m.transient.to_1_mm_s,
    'to_0_1_mm_s': lambda m: m.transient.to_0_1_mm_s,
    'xy_rms_m': lambda m: m.steady.xy_rms_m,
    'xy_max_m': lambda m: m.steady.xy_max_m,
    'rotation_rms_rad': lambda m: m.steady.rotation_rms_rad,
    'joint_rms_rad': lambda m: m.steady.joint_rms_rad,
    'sync_rms_rad': lambda m: m.steady.sync_rms_rad,
    'energy_j': lambda m: m.effort.energy_j,
}
METRICS: dict[str, Callable[[Metrics], float]] = {  # column to value; NaN is written as null
    'duration_s': lambda m: m.duration_s,
    **{name: _reached(of_true(of)) for name, of in OF_MOTION.items() if name != 'energy_j'},
    'torque_max_nm': lambda m: m.torque.max_nm,
    'torque_variation_nm_per_s': lambda m: m.torque.total_variation_nm_per_s,
    'chattering_nm': lambda m: m.torque.chattering_nm,
    'excess_chattering_nm': lambda m: m.effort.excess_chattering_nm,
    'torque_rms_nm': lambda m: m.effort.torque_rms_nm,
    'energy_j': _reached(of_true(OF_MOTION['energy_j'])),
    **{f'seen_{name}': _reached(of_seen(of)) for name, of in OF_MOTION.items()},
}


# Of the sample, not of the run: the first law of the scenario has it until a sweep is finished.
FLOOR = Floor._fields
CALM = ('calm_chattering_nm', 'calm_error')  # limit by chattering, lists, likewise [m or rad]


def arrow() -> ModuleType:
    """The module pyarrow, with ``parquet``.

    Raises:
        InputError: it is not installed.
    """
    optional('pyarrow.parquet')
    return optional('pyarrow')


def schema(plan: Plan) -> Any:
    """Columns of the table of a plan, as a pyarrow.Schema."""
    pa = arrow()
    words = ('law', 'scenario', 'status', 'reason', 'limits', 'limit_reason')
    fields = [(name, pa.string() if name in words else pa.int64()) for name in IDENTITY]
    key = plan.units.key
    fields += [(key(name), pa.float64()) for name in METRICS]
    names = dict.fromkeys(map(key, FLOOR))  # limits of slides are in um as those of a place
    fields += [(name, pa.string() if name in words else pa.float64()) for name in names]
    if plan.study.calm:
        fields += [(key(name), pa.list_(pa.float64())) for name in CALM]
    fields += [
        (name, pa.float64() if numeric else pa.string())
        for name, numeric in plan.columns().items()
    ]
    return pa.schema(fields)


def table(schema: Any, rows: Iterable[tuple[Row, Outcome]], units: JointUnits = HINGES) -> Arrow:
    """Rows with their outcomes as a table.

    Args:
        schema: See :func:`schema`.
        rows: The rows.
        units: Those of the joints of all robots of the plan.
    """
    entries = [_entry(row, outcome, units) for row, outcome in rows]
    return arrow().Table.from_pylist(entries, schema=schema)


def with_floors(rows: Arrow, plan: Plan) -> Arrow:
    """Whole samples, each row with the limit of the first law of its scenario.

    Args:
        rows: The rows of some samples, all of them, sorted by number.
        plan: The plan.
    """
    numbers = rows['row'].to_numpy()
    leaders = np.array([plan.leader(case) for case in range(len(plan.cases))])
    cases = numbers % len(leaders)
    first = np.searchsorted(numbers, numbers - cases + leaders[cases])
    of_sample = (*FLOOR, *(CALM if plan.study.calm else ()))
    for name in dict.fromkeys(map(plan.units.key, of_sample)):
        place = rows.column_names.index(name)
        rows = rows.set_column(place, rows.schema.field(name), rows[name].take(first))
    return rows


def _entry(row: Row, outcome: Outcome, units: JointUnits) -> Mapping[str, Any]:
    """One row by column; columns that are left out are null."""
    found = outcome.metrics
    values = {} if found is None else {name: of(found) for name, of in METRICS.items()}
    floor = {} if outcome.floor is None else outcome.floor._asdict()
    calm = {}
    if outcome.calm is not None:
        pairs = zip(CALM, outcome.calm, strict=True)
        calm = {units.key(name): curve.tolist() for name, curve in pairs}
    numbers = {
        units.key(name): value for name, value in {**values, **floor}.items() if value == value
    }
    return {
        'row': row.row,
        'law': row.law,
        'scenario': scenario_stem(row.scenario),
        'sample': row.sample,
        'seed': row.seed,
        'status': outcome.status,
        'reason': outcome.reason,
        'limits': outcome.limits,
        **numbers,
        **calm,
        **row.drawn,
    }
