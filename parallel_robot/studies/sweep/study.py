"""A study as its file says it: laws, scenarios, number of runs, uncertainty."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import yaml

from parallel_robot.studies.sweep import uncertainty
from parallel_robot.studies.sweep.uncertainty import Uncertainty
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config, plain_data, yaml_file
from parallel_robot_model.configuration.config_files import (
    MAX_BASES,
    absolute_scenario,
    scenario_stem,
)
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.configuration.plain_data import (
    LocatedDict,
    SourceLocation,
    with_location,
)

# A study that starts from another one, its base, and says only what differs.

GROUPS = ('set', 'uncertainty')  # are merged key by key; a key is in one of them


def _merged_with_base(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """What a study says with what its base says; whatever is malformed is left to be refused."""
    found = {**base, **own}
    below, above = ({key: _keys(each, key) for key in GROUPS} for each in (base, own))
    said = {key for group in above.values() for key in group}
    for key in GROUPS:
        if own.get(key) is None or isinstance(own[key], dict):
            kept = {name: value for name, value in below[key].items() if name not in said}
            found[key] = kept | above[key]
    if isinstance(own.get('laws'), list):
        found['laws'] = _chosen_laws(base.get('laws'), own['laws'])
    return found


def _chosen_laws(known: Any, names: Sequence[Any]) -> Any:
    """Laws of a study by name."""
    if not isinstance(known, dict) or len({*map(str, names)}) < len(names):
        return [*names]
    return {name: known.get(name, {}) for name in names}


def places_with_base(
    base: Mapping[str, SourceLocation],
    own: Mapping[str, SourceLocation],
    content: Mapping[str, Any],
) -> dict[str, SourceLocation]:
    """Where the keys of a study with a base stand; `content` is that of the study alone."""
    replaced = content.keys() - {*GROUPS}
    kept = {key: place for key, place in base.items() if key.partition('.')[0] not in replaced}
    return {**kept, **own}


def _keys(content: Mapping[str, Any], group: str) -> dict[str, Any]:
    """Dotted keys of `set` or `uncertainty`, and their values."""
    found = content.get(group)
    if not isinstance(found, dict):
        return {}
    return config.flat(found) if group == 'set' else found


MOST_RUNS = 10_000_000
MOST_SCRAMBLES = 1000
# What makes the experiment, or has a key of its own in a study.
FIXED = ('scenario', 'law', 'preset', 'robot_model', 'joints', 'duration', 'seed', *config.CUSTOM)


# Groups of the controller of which a law may have values of its own.
OF_CONTROLLER = ('approach', 'controller', 'estimator', 'lock_in', 'repetition')


@dataclass(frozen=True)
class Variant:
    """A law with gains, and parameters of its controller, of its own."""

    name: str  # what the results call it
    law: str  # name of the law
    gains: Mapping[str, Any]  # keys of the configuration and their values


@dataclass(frozen=True)
class Study:
    """A study."""

    # names of the scenarios, or the absolute paths of their files; each has another name
    scenarios: tuple[str, ...]
    laws: tuple[Variant, ...]
    # number of samples of the uncertainty; each is a run of every law in every scenario. 0:
    # the file does not say
    runs: int
    seed: int  # seed of the samples and of the runs
    method: Literal['sobol', 'random']  # how the uncertainty is sampled
    duration: float | None  # length of each run [s]; None: that of its scenario, or of its motion
    fixed: Mapping[str, Any]  # keys of the configuration and their values in all runs
    uncertainties: tuple[Uncertainty, ...]  # the uncertain parameters
    scrambles: int = 1  # number of independently scrambled Sobol sequences that the samples are of
    # whether each error is also held against the limit at the chattering of its run
    calm: bool = False
    # where the keys of its file stand, e.g. ``set.friction.viscous``
    places: Mapping[str, SourceLocation] = field(default_factory=dict)
    text: str = ''  # its file; of one with a base, or with laws of its own, all of it in one

    def of_case(self, variant: Variant) -> LocatedDict:
        """What all runs of a law change in the configuration of a scenario."""
        changed = {
            **({} if self.duration is None else {'duration': (self.duration, 'duration')}),
            **{key: (value, f'set.{key}') for key, value in self.fixed.items()},
            **{
                key: (value, f'laws.{variant.name}.{key.removeprefix(f"{variant.law}.")}')
                for key, value in variant.gains.items()
            },
            'law': (variant.law, f'laws.{variant.name}'),
        }
        names = {key: name for key, (_, name) in changed.items()} | {'scenario': 'scenarios'}
        if names['law'] not in self.places:  # a list of names
            names['law'] = 'laws'
        return LocatedDict(
            {key: value for key, (value, _) in changed.items()},
            {key: self.places[name] for key, name in names.items() if name in self.places},
        )

    def changed(self, runs: int | None, fixed: Mapping[str, Any]) -> Study:
        """The study with another number of runs and more fixed values.

        Raises:
            InputError: a value is wrong, a key cannot be fixed, or nothing says how many runs.
        """
        if runs is None:
            if not self.runs:
                raise InputError('runs is missing: neither the study nor --runs says how many')
            runs = self.runs
        runs = check('--runs', int, Field('', '', 1, MOST_RUNS), runs)
        if runs % self.scrambles:
            raise InputError(
                f'runs must be a multiple of the {self.scrambles} scrambles, not {runs}'
            )
        for uncertain in self.uncertainties:
            if uncertain.key in fixed:
                raise InputError(f'--set {uncertain.key}: it is uncertain in this study')
        return replace(
            self,
            runs=runs,
            fixed={**self.fixed, **_fixed('--set', fixed)},
            places={k: place for k, place in self.places.items() if k[4:] not in fixed},
        )


def file_of(name: str, kind: str = 'study', folder: str = 'studies') -> Path:
    """The file of a study, or of another kind: a path, or the name of one in a folder of config.

    Raises:
        InputError: there is no such file.
    """
    known = {path.stem: path for path in (config.directory() / folder).glob('*.yaml')}
    if name in known:
        return known[name]
    path = Path(name)
    if path.suffix not in ('.yaml', '.yml') and '/' not in name:
        raise UnknownNameError(kind, name, known)
    return path


def read(path: Path) -> str:
    """Text of a study file.

    Raises:
        InputError: it cannot be read.
    """
    try:
        with path.open('rb') as stream:
            return stream.read(plain_data.MAX_LENGTH + 1).decode()
    except OSError as error:
        raise InputError(f'cannot read the study {path}: {error.strerror}') from None
    except ValueError:
        raise InputError(f'the study {path} is not text in UTF-8') from None


def parse(
    text: str,
    name: str = 'study',
    folder: Path | None = None,
    laws: Sequence[str] | None = None,
) -> Study:
    """Read a study; whether its keys exist is checked with the scenarios, see plan.py.

    Args:
        text: Content of the file.
        name: Name of the file, for messages.
        folder: Directory of the file, from which its paths count; None: the current one.
        laws: Names of laws in place of those of the study, or some of these.

    Raises:
        InputError: the text is not YAML, or something in it is wrong.
    """
    content, places, whole = _loaded(text, name, folder, ())
    if laws is not None:
        content['laws'] = _chosen_laws(content.get('laws'), laws)
        places = {key: place for key, place in places.items() if key.partition('.')[0] != 'laws'}
    with with_location(LocatedDict({}, places), name):
        found = _study(content, folder)
    if not whole or laws is not None:
        text = yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
    return replace(found, places=places, text=text)


def _loaded(
    text: str, name: str, folder: Path | None, way: tuple[Path, ...]
) -> tuple[dict[str, Any], dict[str, SourceLocation], bool]:
    """Content of a study with that of its bases, its places, and whether it has no base."""
    try:
        content = plain_data.load(text)
    except plain_data.NotFiniteError as error:
        with with_location(LocatedDict({}, yaml_file.key_locations(text, name)), name):
            raise InputError(str(error), error.key) from None
    except ValueError as error:
        raise InputError(f'{name} cannot be read as YAML: {error}') from None
    if not isinstance(content, dict):
        raise InputError(f'{name} must hold keys and values')
    places = yaml_file.key_locations(text, name)
    if 'base' not in content:
        return content, places, True
    with with_location(LocatedDict({}, places), name):
        base = check('base', str, Field('', ''), content.pop('base'))
        file = file_of(absolute_scenario(base, folder))
        if file in way or len(way) == MAX_BASES:
            steps = ' -> '.join(path.name for path in [*way, file])
            raise InputError(f'base: the bases of a study lead in a circle: {steps}', 'base')
        below = read(file)
    known, far, _ = _loaded(below, str(file), file.parent, (*way, file))
    scenarios = known.get('scenarios')
    if isinstance(scenarios, list) and all(isinstance(each, str) for each in scenarios):
        known['scenarios'] = [absolute_scenario(each, file.parent) for each in scenarios]
    return _merged_with_base(known, content), places_with_base(far, places, content), False


def _study(content: dict[str, Any], folder: Path | None) -> Study:
    known = {'scenarios', 'laws', 'runs', 'seed', 'method', 'scrambles', 'duration', 'set'}
    known |= {'uncertainty', 'calm'}
    for key in content:
        if key not in known:
            raise UnknownNameError('key', key, known, key)
    for key in ('scenarios', 'laws'):
        if key not in content:
            raise InputError(f'{key} is missing')
    scenarios = [
        absolute_scenario(each, folder) for each in _names('scenarios', content['scenarios'])
    ]
    named = [scenario_stem(scenario) for scenario in scenarios]
    for name in named:
        if named.count(name) > 1:
            raise InputError(f'scenarios: two are called {name}; rename a file', 'scenarios')
    entries = _mapping('uncertainty', content.get('uncertainty'))
    for key in entries:
        _check_free('uncertainty', key)
    fixed = _fixed('set', _mapping('set', content.get('set')))
    for key in fixed.keys() & entries.keys():
        raise InputError(f'{key} is both in set and in uncertainty', f'uncertainty.{key}')
    laws = _laws(content['laws'])
    for key in {key for law in laws for key in law.gains} & entries.keys():
        raise InputError(f'{key} is both in laws and in uncertainty', f'uncertainty.{key}')
    method = check(
        'method', Literal['sobol', 'random'], Field('', ''), content.get('method', 'sobol')
    )
    scrambles = check(
        'scrambles', int, Field('', '', 1, MOST_SCRAMBLES), content.get('scrambles', 1)
    )
    if scrambles > 1 and method != 'sobol':
        raise InputError('scrambles are of Sobol sequences: method must be sobol', 'scrambles')
    return Study(
        tuple(scenarios),
        laws,
        check('runs', int, Field('', '', 1, MOST_RUNS), content['runs'])
        if 'runs' in content
        else 0,
        check('seed', int, Field('', '', 0, 2**63 - 1), content.get('seed', 0)),
        method,
        check('duration', float, Field('s', '', 0.0), content['duration'])
        if 'duration' in content
        else None,
        fixed,
        tuple(uncertainty.parse(key, entry) for key, entry in entries.items()),
        scrambles,
        check('calm', bool, Field('', ''), content.get('calm', False)),
    )


def _laws(given: Any) -> tuple[Variant, ...]:
    """Laws from a list of names, or from names with gains."""
    if not isinstance(given, dict):
        return tuple(Variant(name, name, {}) for name in _names('laws', given))
    found = []
    for name in _names('laws', list(given)):
        gains = config.flat(_mapping(f'laws.{name}', given[name]))
        law = check(f'laws.{name}.law', str, Field('', ''), gains.pop('law', name))
        found.append(Variant(name, law, {_key(law, key): gains[key] for key in gains}))
    return tuple(found)


def _key(law: str, own: str) -> str:
    """The key of the configuration for what stands at a law."""
    return own if own.partition('.')[0] in OF_CONTROLLER else f'{law}.{own}'


def _names(key: str, given: Any) -> tuple[str, ...]:
    """A list of different names."""
    names: tuple[str, ...] = check(key, tuple[str, ...], Field('', ''), given)
    if not names:
        raise InputError(f'{key} must name at least one', key)
    for name in names:
        if names.count(name) > 1:
            raise InputError(f'{key} names {name} twice', key)
    return names


def _mapping(key: str, given: Any) -> dict[str, Any]:
    """Keys and values; nothing at all stands for none."""
    if given is None:
        return {}
    if not isinstance(given, dict):
        raise InputError(f'{key} must hold keys and values, not {given!r}', key)
    return given


def _fixed(where: str, given: Mapping[str, Any]) -> dict[str, Any]:
    """Fixed values by dotted key; a file of a study names no code."""
    values = config.flat(given)
    allowed: Collection[str] = config.CUSTOM if where == '--set' else ()
    for key in values:
        if key not in allowed:
            _check_free(where, key)
    return values


def _check_free(where: str, key: str) -> None:
    """Refuse a key that a study cannot change."""
    if key in config.CUSTOM:
        raise InputError(
            f'{where}: {key} is given on the command line alone: it is code', f'{where}.{key}'
        )
    if key in FIXED:
        raise InputError(f'{where}: {key} cannot stand there', f'{where}.{key}')
