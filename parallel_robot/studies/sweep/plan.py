"""The runs of a study, numbered: run `row` is the same whenever and wherever it is computed.

Rows are counted sample by sample, so that more runs of a study only add rows. All laws of a
scenario get the same samples and seeds: what differs between their runs of a sample is the law.
"""

from __future__ import annotations

import functools
import hashlib
import json
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from parallel_robot.bags import trust
from parallel_robot.studies.sweep import uncertainty
from parallel_robot.studies.sweep.study import Study, Variant
from parallel_robot_control.configuration import resolve
from parallel_robot_control.laws import LAWS
from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import JointUnits, all_of
from parallel_robot_model.configuration import config
from parallel_robot_model.configuration.config_files import scenario_stem
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.configuration.plain_data import LocatedDict, merged, with_location
from parallel_robot_model.robots.registry import units_of
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.simulation import samples_of
from trajectory_gen.configuration import with_duration

MOST_DIMENSIONS = 21201  # of scipy's Sobol sequence
SEED = 'seed'  # key of the plant's seed, where the configuration has one


@dataclass(frozen=True)
class Row:
    """One run of a study."""

    row: int  # its number, from 0
    sample: int  # number of the sample of the uncertainty
    scenario: str  # name of the scenario, or the path of its file
    law: str  # name of the law in the study
    seed: int  # seed of whatever is random in the run
    overrides: Mapping[str, Any]  # what the run changes in the configuration of the scenario
    drawn: Mapping[str, float | str]  # uncertain values by column of the table


@dataclass(frozen=True)
class Case:
    """One law in one scenario."""

    scenario: str  # name of the scenario, or the path of its file
    variant: Variant  # the law
    overrides: Mapping[str, Any]  # what all its runs change in the configuration
    nominal: Mapping[str, Any]  # the resolved configuration without uncertainty


@dataclass(frozen=True)
class Plan:
    """A study with the configurations of its laws and scenarios, checked."""

    study: Study
    # every law in every scenario, the laws of a scenario one after another
    cases: tuple[Case, ...]

    @property
    def count(self) -> int:
        """Number of rows."""
        return self.study.runs * len(self.cases)

    @property
    def units(self) -> JointUnits:
        """Units of the joints of all its robots."""
        return all_of(units_of(case.nominal) for case in self.cases)

    @property
    def durations(self) -> list[float]:
        """Lengths of the runs [s], each once, in order."""
        return sorted({float(case.nominal['duration']) for case in self.cases})

    def leader(self, case: int) -> int:
        """Index of the first case with the scenario of a case."""
        return case - case % len(self.study.laws)

    def row(self, number: int) -> Row:
        """A row by its number.

        Raises:
            InputError: the study does not have it.
        """
        top = self.count - 1
        check('--row', int, Field('', '', 0, top), number)
        sample, case = divmod(number, len(self.cases))
        return self.rows(case, sample, 1)[0]

    def rows(self, case: int, first: int, count: int) -> list[Row]:
        """Rows of a case.

        Args:
            case: Index of the case.
            first: Its first sample.
            count: Number of samples.
        """
        of = self.cases[case]
        points = sample(self.study, self.dimensions(of), first, count)
        return [
            self._row(of, (first + k) * len(self.cases) + case, first + k, points[k].tolist())
            for k in range(count)
        ]

    def dimensions(self, case: Case) -> int:
        """Number of the draws of a run."""
        return sum(
            uncertainty.dimensions(each, case.nominal[each.key])
            for each in self.study.uncertainties
        )

    def columns(self) -> dict[str, bool]:
        """Columns of the uncertain values, and whether they hold numbers."""
        found: dict[str, bool] = {}
        for case in self.cases:
            for each in self.study.uncertainties:
                nominal = case.nominal[each.key]
                points = [0.5] * uncertainty.dimensions(each, nominal)
                drawn = uncertainty.value(each, nominal, points)
                names = uncertainty.columns(each, nominal, drawn)
                found |= dict.fromkeys(names, uncertainty.is_numeric(each))
        return found

    def description(self) -> dict[str, str]:
        """What the numbers of a row depend on, one entry for each part, without the runs."""
        configurations = [
            [scenario_stem(case.scenario), case.variant.name, case.nominal] for case in self.cases
        ]
        code = [
            trust.code_of(Path(path)).decode()
            for key in config.CUSTOM
            for path in self.study.fixed.get(key, ())
        ]
        parts = {
            'scenarios': [scenario_stem(scenario) for scenario in self.study.scenarios],
            'laws': [variant.name for variant in self.study.laws],
            'seed': self.study.seed,
            'method': sampling(self.study),
            'uncertainty': [asdict(each) for each in self.study.uncertainties],
            'configuration': [configurations, code],
        }
        if self.study.calm:
            parts['calm'] = True
        texts = {key: json.dumps(part, sort_keys=True) for key, part in parts.items()}
        long = texts['configuration'].encode()
        return texts | {'configuration': hashlib.sha256(long).hexdigest()}

    def _row(self, case: Case, number: int, sample: int, points: list[float]) -> Row:
        overrides = dict(case.overrides)
        drawn: dict[str, float | str] = {}
        seed = int(_sequence(self.study.seed, sample, 1).generate_state(1)[0] >> 1)
        if SEED in case.nominal:
            overrides[SEED] = seed
        begin = 0
        for each in self.study.uncertainties:
            nominal = case.nominal[each.key]
            end = begin + uncertainty.dimensions(each, nominal)
            overrides[each.key] = uncertainty.value(each, nominal, points[begin:end])
            drawn |= uncertainty.columns(each, nominal, overrides[each.key])
            begin = end
        return Row(number, sample, case.scenario, case.variant.name, seed, overrides, drawn)


def plan(study: Study) -> Plan:
    """Resolve the configurations of a study and check that its keys fit them.

    Raises:
        InputError: a scenario, a law or a key does not exist, a value is wrong, or a distribution
            does not fit its parameter.
    """
    cases = tuple(
        _case(study, scenario, variant) for scenario in study.scenarios for variant in study.laws
    )
    found = Plan(study, cases)
    for case in cases:
        if found.dimensions(case) > MOST_DIMENSIONS:
            raise InputError(f'at most {MOST_DIMENSIONS} uncertain numbers can be sampled')
        with with_location(LocatedDict({}, study.places)):
            nominal = _as_drawn(study, case)
        configuration = configure(nominal)
        with with_location(case.overrides):
            samples_of(configuration)
    checked: set[str] = set()
    for case, each in product(cases, study.uncertainties):
        for value in uncertainty.extremes(each, case.nominal[each.key]):
            asked = repr((case.scenario, each.key, value, _beside(case, each.key)))
            if asked not in checked:
                _check(study, case, each.key, value)
                checked.add(asked)
    return found


def _beside(case: Case, key: str) -> list[tuple[str, Any]]:
    """Overrides of a case that can decide what a key may be: the gains of a law concern it alone.

    So most laws of a scenario are checked as one: a configuration takes milliseconds.
    """
    group, laws = key.partition('.')[0], {*LAWS, 'law'}
    return sorted(
        (name, value)
        for name, value in case.overrides.items()
        if (of := name.partition('.')[0]) not in laws or of == group
    )


def _check(study: Study, case: Case, key: str, value: Any) -> None:
    """Refuse a value that an uncertain parameter cannot have."""
    try:
        configure(resolve(case.scenario, {**case.overrides, key: value}))
    except InputError as error:
        with with_location(LocatedDict({}, study.places)):
            raise InputError(f'uncertainty: {error}', f'uncertainty.{key}') from None


def sample(study: Study, dimensions: int, first: int, count: int) -> NDArray[np.float64]:
    """Points of the unit cube at which the uncertainty is sampled.

    Args:
        study: The study.
        dimensions: Dimensions of the cube.
        first: Number of the first sample.
        count: Number of samples.

    Returns:
        Shape (count, dimensions), in [0, 1).
    """
    found = np.empty((count, dimensions))
    for scramble in range(study.scrambles):  # one sample of each in turn
        begin, end = (
            -(-(number - scramble) // study.scrambles) for number in (first, first + count)
        )
        if end > begin:
            points = _sample(study.method, study.seed, scramble, dimensions, begin, end - begin)
            found[begin * study.scrambles + scramble - first :: study.scrambles] = points
    return found


def sampling(study: Study) -> str:
    """How the uncertainty is sampled, in words."""
    return study.method + (f', {study.scrambles} scrambles' if study.scrambles > 1 else '')


@functools.lru_cache(maxsize=8)  # the laws of a scenario ask for the same
def _sample(
    method: str, seed: int, scramble: int, dimensions: int, first: int, count: int
) -> NDArray[np.float64]:
    if method == 'random' or not dimensions:
        return np.array(
            [
                np.random.default_rng(_sequence(seed, k)).random(dimensions)
                for k in range(first, first + count)
            ]
        )
    from scipy.stats import qmc  # slow to import

    mixed = _sequence(seed, scramble) if scramble else _sequence(seed)
    sequence = qmc.Sobol(dimensions, seed=np.random.default_rng(mixed))
    if first:
        sequence.fast_forward(first)
    with warnings.catch_warnings():  # about counts that are no power of 2
        warnings.simplefilter('ignore', UserWarning)
        return sequence.random(count)


def _sequence(seed: int, *key: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=key)


def _case(study: Study, scenario: str, variant: Variant) -> Case:
    """A law in a scenario; messages name the scenario where it matters."""
    overrides = study.of_case(variant)
    with with_location(overrides):
        overrides = with_duration(scenario, overrides)
        nominal = resolve(scenario, overrides)
    for each in study.uncertainties:
        if each.key not in nominal:
            try:
                resolve(scenario, overrides | {each.key: 0.0})
            except InputError as error:
                text = f'uncertainty in {scenario_stem(scenario)}: {error}'
                with with_location(LocatedDict({}, study.places)):
                    raise InputError(text, f'uncertainty.{each.key}') from None
    return Case(scenario, variant, overrides, nominal)


def _as_drawn(study: Study, case: Case) -> dict[str, Any]:
    """The configuration of a case with its uncertain numbers as a draw would give them."""
    floats: dict[str, Any] = {}
    for each in study.uncertainties:
        nominal = case.nominal[each.key]
        uncertainty.dimensions(each, nominal)
        if each.distribution != 'choice':
            listed = isinstance(nominal, list)
            floats[each.key] = [*map(float, nominal)] if listed else float(nominal)
    places = {key: place for key in floats if (place := study.places.get(f'uncertainty.{key}'))}
    return resolve(case.scenario, merged((case.overrides, LocatedDict(floats, places))))
