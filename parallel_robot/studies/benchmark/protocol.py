"""A protocol as its file says it: robots, motions, troubles, samples and the search for gains."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from parallel_robot.analysis.metrics import SMOOTH, samples_beside
from parallel_robot.studies.sweep import study, uncertainty
from parallel_robot.studies.sweep.plan import Plan, Row, plan
from parallel_robot.studies.sweep.study import Study, Variant
from parallel_robot.studies.sweep.uncertainty import Uncertainty
from parallel_robot_control.configuration import resolve
from parallel_robot_model.common.errors import InputError, UnknownNameError
from parallel_robot_model.configuration import config, plain_data
from parallel_robot_model.configuration.fields import Field, check
from parallel_robot_model.robots.registry import units_of

DEFAULT = 'protocol_1'
KEYS = (
    'version', 'duration', 'seed', 'scrambles', 'speeds', 'search', 'quick', 'set', 'ages',
    'uncertainty', 'forces', 'mixes', 'robots',
)  # fmt: skip
ENDS = ('low', 'high')  # of a distribution of forces, which are multiplied


@dataclass(frozen=True)
class Search:
    """The search for the tuned gains of a law on a robot."""

    trials: int  # gains that are tried
    runs: int  # robots of each trial
    seed: int  # seed of these robots and of the proposals
    chattering: float  # most excess chattering, as a share of the force of the robot
    search: tuple[str, ...]  # keys that are searched beside the gains
    bounds: tuple[str, ...]  # where gains are searched, as words of ``tune --bounds``


@dataclass(frozen=True)
class Trouble:
    """What is unknown, and what else is set: of a mix, or of one on a robot."""

    fixed: Mapping[str, Any]  # keys of the configuration and their values
    uncertain: Mapping[str, Uncertainty]  # uncertain parameters by key


@dataclass(frozen=True)
class Robot:
    """A robot of the protocol."""

    name: str
    scenario: str
    force: float  # in what the mixes give forces [N m], or [N] of slides
    motions: tuple[str, ...]  # shapes of its motions
    mixes: Mapping[str, Trouble]  # its troubles by name of the mix

    @property
    def unit(self) -> str:
        """Unit of the force of its joints."""
        return units_of(resolve(self.scenario)).of('N m')


@dataclass(frozen=True)
class Protocol:
    """A protocol."""

    name: str  # name of its file
    version: int  # its number
    digest: str  # SHA-256 of all that counts: its file, the scenarios and the robots
    duration: float  # length of a run [s]
    seed: int  # of robots, noise and delays
    scrambles: int  # independent sequences of samples
    speeds: tuple[float, ...]  # factors of the speed of a motion
    ages: Mapping[str, Mapping[str, Any]]  # keys that tell the age of a state, or hide it, by name
    robots: tuple[Robot, ...]
    search: Search  # the search for gains
    quick: bool  # whether it is only the first look that the protocol allows


def read(name: str = DEFAULT, quick: bool = False, phrase: str | None = None) -> Protocol:
    """Read a protocol.

    Args:
        name: Name of a file in config/benchmarks, or a path.
        quick: Whether only a first look is wanted.
        phrase: Words from which other samples are drawn than those to develop on.

    Raises:
        InputError: there is no such file, or something in it is wrong.
    """
    if phrase is not None and not phrase.strip():
        raise InputError(f'a phrase must have words, not {phrase!r}')
    file = study.file_of(name, 'protocol', 'benchmarks')
    try:
        content = plain_data.load(study.read(file))
    except ValueError as error:
        raise InputError(f'{file} cannot be read as YAML: {error}') from None
    if not isinstance(content, dict):
        raise InputError(f'{file} must hold keys and values')
    try:
        return _protocol(content, file, quick, phrase)
    except InputError as error:
        raise InputError(f'{file}: {error}') from None


def seed_from(phrase: str) -> int:
    """The seed that belongs to a phrase: the first 62 bits of its SHA-256 in UTF-8."""
    return int.from_bytes(hashlib.sha256(phrase.encode()).digest()[:8], 'big') >> 2


def _protocol(content: Mapping[str, Any], file: Path, quick: bool, phrase: str | None) -> Protocol:
    for key in content:
        if key not in KEYS:
            raise UnknownNameError('key', key, KEYS)
    for key in KEYS:
        if key not in content:
            raise InputError(f'{key} is missing')
    whole = Field('', '', 1, study.MOST_SCRAMBLES)
    scrambles = check('scrambles', int, whole, content['scrambles'])
    search = _group('search', content['search'])
    robots = [
        _robot(name, each, content) for name, each in _group('robots', content['robots']).items()
    ]
    digest = _digest(content, robots)
    if quick:
        less = _group('quick', content['quick'])
        robots = [robot for robot in robots if robot.name in less['robots']]
        scrambles = check('quick.scrambles', int, whole, less['scrambles'])
        search = {**search, 'trials': less['trials']}
    seeds = Field('', '', 0, 2**63 - 1)
    return Protocol(
        file.stem,
        check('version', int, Field('', '', 1), content['version']),
        digest,
        check('duration', float, Field('s', '', 0.1), content['duration']),
        check('seed', int, seeds, content['seed']) if phrase is None else seed_from(phrase),
        scrambles,
        check('speeds', tuple[float, ...], Field('', '', 1e-6, 1e6), content['speeds']),
        {name: config.flat(each) for name, each in _group('ages', content['ages']).items()},
        tuple(robots),
        Search(
            check('search.trials', int, Field('', '', 1), search.get('trials')),
            check('search.runs', int, Field('', '', 1), search.get('runs')),
            check('search.seed', int, seeds, search.get('seed')),
            check('search.chattering', float, Field('', '', 0.0), search.get('chattering')),
            check('search.search', tuple[str, ...], Field('', ''), search.get('search')),
            check('search.bounds', tuple[str, ...], Field('', ''), search.get('bounds')),
        ),
        quick,
    )


def _robot(name: str, given: Any, content: Mapping[str, Any]) -> Robot:
    given = _group(f'robots.{name}', given)
    for key in ('scenario', 'force', 'motions'):
        if key not in given:
            raise InputError(f'robots.{name}.{key} is missing')
    force = check(f'robots.{name}.force', float, Field('N m', '', 0.0), given['force'])
    mixes = {}
    for mix, trouble in _group('mixes', content['mixes']).items():
        trouble = _group(f'mixes.{mix}', trouble)
        forces = {**_group('forces', content['forces']), **trouble.get('forces', {})}
        uncertain = {
            **_group('uncertainty', content['uncertainty']),
            **trouble.get('uncertainty', {}),
            **{
                key: {k: force * value if k in ENDS else value for k, value in entry.items()}
                for key, entry in forces.items()
            },
            **given.get('uncertainty', {}),
        }
        fixed = {**content['set'], **trouble.get('set', {}), **given.get('set', {})}
        period = check('set.period', float, Field('s', '', 1e-6), fixed.get('period', 1e-3))
        if not samples_beside(period):
            raise InputError(
                f'set.period is {period:g} s: the score is at the chattering of a run, of which '
                f'nothing is left at {SMOOTH:g} s and more'
            )
        mixes[mix] = Trouble(
            config.flat(fixed),
            {key: uncertainty.parse(key, entry) for key, entry in uncertain.items()},
        )
    motions = check(f'robots.{name}.motions', tuple[str, ...], Field('', ''), given['motions'])
    return Robot(name, given['scenario'], force, motions, mixes)


def _group(key: str, given: Any) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise InputError(f'{key} must hold keys and values, not {given!r}')
    return given


def _digest(content: Mapping[str, Any], robots: list[Robot]) -> str:
    """SHA-256 of a protocol with the files of its scenarios and robots."""
    parts: dict[str, Any] = {'protocol': content}
    folder = config.directory()
    for robot in robots:
        values = resolve(robot.scenario)
        model = values['robot_model']
        places = [
            f'scenarios/{robot.scenario}.yaml',
            f'robots/{model}.yaml',
            f'machines/{model}.xml',
        ]
        known = [folder / place for place in places if (folder / place).is_file()]
        parts[robot.name] = [values['joints'], *(path.read_text() for path in known)]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


# The conditions of a protocol, and which of its samples each has: a balanced third of all.
#
# Robot, motion, speed, mix of trouble and age make a condition. Of motion, speed and mix, three of
# each, a scramble has the nine combinations whose numbers add up to its own number modulo three:
# in them every pair of two levels is met once, and three scrambles have all (Latin squares).

THIRD = 3  # as many levels have motion, speed and mix


@dataclass(frozen=True)
class Condition:
    """What a law is judged in."""

    robot: Robot
    motion: str  # shape of the motion
    speed: float  # factor of its speed
    mix: str  # name of the mix of trouble
    age: str  # whether the age of a state is told or hidden
    samples: Mapping[int, int]  # scramble to the number of the sample in it
    first: int  # number of its first sample among those of the protocol

    @cached_property
    def labels(self) -> dict[str, str]:
        """What it is, by names of columns."""
        speed = f'{self.speed:.3g}'
        return {
            'robot': self.robot.name, 'motion': self.motion, 'speed': speed, 'mix': self.mix,
            'age': self.age,
        }  # fmt: skip


def conditions(protocol: Protocol) -> Iterator[Condition]:
    """The conditions that a protocol has, with the numbers of their samples."""
    first = 0
    for robot in protocol.robots:
        counts = [0] * protocol.scrambles
        counted = product(
            enumerate(robot.motions), enumerate(protocol.speeds), enumerate(robot.mixes)
        )
        for ((i, motion), (j, speed), (k, mix)), age in product(counted, protocol.ages):
            residue = (i + j + k) % THIRD
            samples = {}
            for scramble in range(residue, protocol.scrambles, THIRD):
                samples[scramble] = counts[scramble]
                counts[scramble] += 1
            if samples:
                yield Condition(robot, motion, speed, mix, age, samples, first)
                first += len(samples)


def planned(
    condition: Condition,
    protocol: Protocol,
    variants: Sequence[Variant],
    code: Mapping[str, Any],
) -> Plan:
    """The plan of a condition.

    Args:
        condition: The condition.
        protocol: The protocol.
        variants: The laws.
        code: Keys of the configuration that name the files of laws.
    """
    trouble = condition.robot.mixes[condition.mix]
    fixed = {
        **trouble.fixed,
        **protocol.ages[condition.age],
        'trajectory.shape': condition.motion,
        'trajectory.speed_factor': condition.speed,
        **code,
    }
    most = max(condition.samples.values()) + 1
    scrambles = protocol.scrambles
    return _plan(condition.robot, variants, protocol, fixed, trouble, most * scrambles, scrambles)


def search_plan(robot: Robot, protocol: Protocol, law: str, code: Mapping[str, Any]) -> Plan:
    """The plan of the search for gains: the first motion, in the first mix, with ages told."""
    trouble = next(iter(robot.mixes.values()))
    age = next(iter(protocol.ages.values()))
    fixed = {**trouble.fixed, **age, 'trajectory.shape': robot.motions[0], **code}
    alike = [Variant(law, law, {})]
    return _plan(
        robot, alike, protocol, fixed, trouble, protocol.search.runs, 1, protocol.search.seed
    )


def _plan(
    robot: Robot,
    variants: Sequence[Variant],
    protocol: Protocol,
    fixed: Mapping[str, Any],
    trouble: Trouble,
    runs: int,
    scrambles: int,
    seed: int | None = None,
) -> Plan:
    return plan(
        Study(
            (robot.scenario,),
            tuple(variants),
            runs,
            protocol.seed if seed is None else seed,
            'sobol',
            protocol.duration,
            fixed,
            tuple(trouble.uncertain.values()),
            scrambles,
        )
    )


def rows(condition: Condition, of: Plan, case: int) -> list[Row]:
    """The runs of a law in a condition, one for each of its samples."""
    scrambles = of.study.scrambles
    return [
        of.rows(case, number * scrambles + scramble, 1)[0]
        for scramble, number in condition.samples.items()
    ]
