"""The conditions of a protocol, and which of its samples each has: a balanced third of all.

Robot, motion, speed, mix of trouble and age make a condition. Of motion, speed and mix, three of
each, a scramble has the nine combinations whose numbers add up to its own number modulo three: in
them every pair of two levels is met once, and three scrambles have all (Latin squares).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

from parallel_robot.studies.benchmark.protocol import Protocol, Robot, Trouble
from parallel_robot.studies.sweep.plan import Plan, Row, plan
from parallel_robot.studies.sweep.study import Study, Variant

THIRD = 3  # as many levels have motion, speed and mix


@dataclass(frozen=True)
class Condition:
    """What a law is judged in.

    Attributes:
        robot: The robot.
        motion: Shape of the motion.
        speed: Factor of its speed.
        mix: Name of the mix of trouble.
        age: Whether the age of a state is told or hidden.
        samples: Scramble to the number of the sample in it.
        first: Number of its first sample among those of the protocol.
    """

    robot: Robot
    motion: str
    speed: float
    mix: str
    age: str
    samples: Mapping[int, int]
    first: int

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
