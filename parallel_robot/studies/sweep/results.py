"""The results of a sweep, scenario by scenario, from its table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot.analysis.metrics import Metric, named
from parallel_robot.studies.calm import Calm
from parallel_robot.studies.sweep import statistics
from parallel_robot.studies.sweep.plan import Plan
from parallel_robot.studies.sweep.statistics import Driver, Duel, Estimate
from parallel_robot.studies.sweep.store import CALM, arrow
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration.config_files import scenario_stem
from parallel_robot_sim.imperfections import ENCODERS

REASONS = 3  # most frequent reasons of failures to report


# Metrics that are summarised.
ERRORS = named('xy_rms_m', 'joint_rms_rad')  # laws are compared by the first that there is
(ROTATED,) = named('rotation_rms_rad')
OTHERS = named(
    'torque_max_nm', 'chattering_nm', 'excess_chattering_nm', 'torque_rms_nm', 'energy_j'
)


LIMIT = 'limit'
ESTIMATED = 'estimated limit'  # with an encoder, see docs/limit.md
LIMITS = ('limit_um', 'limit_urad')  # of each of ERRORS
DELAY = 'delay_um'
NEGLIGIBLE = 1e-3  # um or urad: what rounding leaves of no limit at all


@dataclass(frozen=True)
class Level:
    """What errors are held against, e.g. the limit."""

    values: Array  # of each sample that has it, in the unit of the error
    median: Estimate  # their median


@dataclass(frozen=True)
class LawResult:
    """One law in one scenario."""

    runs: Mapping[str, int]  # number of runs by status
    reasons: Mapping[str, int]  # the most frequent reasons why runs are not ok, with their numbers
    medians: tuple[Estimate, ...]  # medians of the quantities, in their units
    drivers: tuple[Driver, ...]  # what drives the error, see :func:`statistics.drivers`
    errors: Array  # the error of each run, in its unit; infinite for a run that is not ok


@dataclass(frozen=True)
class ScenarioResult:
    """All laws in one scenario."""

    # what is summarised; the first is the error. An effort that no run has, as the
    # chattering of states that are far apart, is left out
    quantities: tuple[Metric, ...]
    laws: Mapping[str, LawResult]  # law to its results, in the order of the study
    # the laws in pairs, by the error; those with the smaller medians first. Their p is
    # corrected over all pairs of the study
    duels: tuple[Duel, ...]
    # what the errors are held against, by name: 'limit' or 'estimated limit', the least
    # error of any law; 'v d', the distance that the reference travels while a state is late
    levels: Mapping[str, Level] = field(default_factory=dict)
    efforts: int = len(OTHERS)  # how many of the quantities are of the effort, the last ones
    together: str = ''  # parameters whose effects are not told apart, in words


def evaluate(runs: Path, plan: Plan) -> dict[str, ScenarioResult]:
    """Evaluate the table of a sweep.

    Args:
        runs: The file, with all rows.
        plan: The plan of the sweep.

    Returns:
        Name of a scenario to its results.
    """
    found = {
        name: _scenario(runs, plan, name) for name in map(scenario_stem, plan.study.scenarios)
    }
    adjusted = iter(statistics.corrected([d.p for each in found.values() for d in each.duels]))
    return {
        name: replace(each, duels=tuple(replace(d, p=next(adjusted)) for d in each.duels))
        for name, each in found.items()
    }


def _median(values: Array, scramble: NDArray[np.int64]) -> Estimate:
    if len(np.unique(scramble)) < 2:
        return statistics.median(values)
    return statistics.sectioned(values, scramble)


def _has_encoder(plan: Plan, scenario: str) -> bool:
    """Whether positions come in steps, which the limit takes for white noise."""
    if any(each.key in ENCODERS for each in plan.study.uncertainties):
        return True
    cases = (case for case in plan.cases if scenario_stem(case.scenario) == scenario)
    return any(bool(np.any(case.nominal[key])) for case in cases for key in ENCODERS)


def _calm_columns(plan: Plan) -> list[str]:
    """Columns of the limit by chattering, where the study asks for it."""
    return [*map(plan.units.key, CALM)] if plan.study.calm else []


def _at_own_calm(rows: Any, plan: Plan) -> Array:
    """The limit of each row at its own chattering [m or rad]; NaN where there is none."""
    curves = zip(*(rows[name].to_pylist() for name in _calm_columns(plan)), strict=True)
    chattering = rows[plan.units.key('chattering_nm')].to_numpy()
    return np.array(
        [
            Calm(*map(np.asarray, curve)).own(spent) if curve[0] else np.nan
            for curve, spent in zip(curves, chattering, strict=True)
        ]
    )


def _scenario(runs: Path, plan: Plan, scenario: str) -> ScenarioResult:
    pa = arrow()
    parameters = [name for name, numeric in plan.columns().items() if numeric]
    units = plan.units
    errors, others = ([each.in_units(units) for each in some] for some in (ERRORS, OTHERS))
    of_error = dict(zip((each.key for each in errors), map(units.key, LIMITS), strict=True))
    numbers = [quantity.key for quantity in (*errors, ROTATED, *others)] + parameters
    numbers += [*dict.fromkeys(of_error.values()), DELAY]
    found = pa.parquet.read_table(
        runs,
        columns=['law', 'sample', 'status', 'reason', *numbers, *_calm_columns(plan)],
        filters=[('scenario', '=', scenario)],
        partitioning=None,
    )
    law, sample, status, reason = (
        found[name].to_numpy() for name in ('law', 'sample', 'status', 'reason')
    )
    columns = {name: found[name].to_numpy() for name in numbers}  # NaN for null
    planar = np.isfinite(columns[errors[0].key]).any()
    error = errors[0] if planar else errors[1]
    scramble = sample % plan.study.scrambles
    limits = columns[of_error[error.key]]
    limited = limits > NEGLIGIBLE
    limit = ESTIMATED if _has_encoder(plan, scenario) else LIMIT
    ratio = error._replace(key='', name=f'error / {limit}', unit='')
    calm = _at_own_calm(found, plan) if plan.study.calm else np.full(len(law), np.nan)
    calmed = ratio._replace(name=f'{ratio.name} at own chattering')
    rotated = [ROTATED] if np.isfinite(columns[ROTATED.key]).any() else []
    good = status == 'ok'
    others = [
        each for each in others if not good.any() or np.isfinite(columns[each.key][good]).any()
    ]
    measured = (error, *rotated, *others)
    held = {}  # what the error is held against, by the quantity that the ratio is
    if limited.any():
        held[ratio] = limits
    if np.isfinite(calm).any():
        held[calmed] = 1e6 * calm
    quantities = (error, *held, *measured[1:])
    results = {}
    for variant in plan.study.laws:
        mine = law == variant.name
        scaled = [
            np.where(good[mine], quantity.scale * columns[quantity.key][mine], np.inf)
            for quantity in measured
        ]
        medians = [_median(values, scramble[mine]) for values in scaled]
        ratios = []
        for against in held.values():
            some = against[mine] > NEGLIGIBLE  # not where it is NaN
            ratios.append(_median(scaled[0][some] / against[mine][some], scramble[mine][some]))
        medians[1:1] = ratios
        drawn = {name: columns[name][mine] for name in parameters}
        drawn = {name: values for name, values in drawn.items() if np.isfinite(values).all()}
        results[variant.name] = LawResult(
            Counter(status[mine].tolist()),
            dict(Counter(reason[mine & ~good].tolist()).most_common(REASONS)),
            tuple(medians),
            tuple(statistics.drivers(drawn, scaled[0])),
            scaled[0],
        )
    ranking = sorted(results, key=lambda name: results[name].medians[0].value)
    of_laws = {name: results[name].errors for name in ranking}
    first = law == plan.study.laws[0].name  # the same of all laws
    levels = {}
    for name, values in {limit: limits, 'v d': columns[DELAY]}.items():
        some = first & np.isfinite(values)
        if (values[some] > NEGLIGIBLE).any():
            levels[name] = Level(values[some], _median(values[some], scramble[some]))
    duels = tuple(statistics.duels(of_laws))
    alike = statistics.together(drawn)
    return ScenarioResult(quantities, results, duels, levels, len(others), alike)
