"""The kinds of joints: how each moves, in which units, and what files call it."""

from __future__ import annotations

from typing import NamedTuple

from parallel_robot_model.common.units import HINGES, PRISMATIC, JointUnits


class JointKind(NamedTuple):
    """A kind of joint: about one axis, or about all."""

    name: str
    turns: float  # rad about its axis by unit of its position
    slides: float  # m along its axis by unit of its position
    units: JointUnits
    urdf: tuple[str, str] = ('', '')  # what a URDF calls it without ends of travel, and with
    single: bool = True  # whether it has one freedom; if not, those of three hinges


FIXED = JointKind('fixed', 0.0, 0.0, HINGES, ('fixed', 'fixed'))
HINGE = JointKind('hinge', 1.0, 0.0, HINGES, ('continuous', 'revolute'))
SLIDE = JointKind('slide', 0.0, 1.0, PRISMATIC, ('prismatic', 'prismatic'))
BALL = JointKind('ball', 1.0, 0.0, HINGES, single=False)
KINDS = {kind.name: kind for kind in (HINGE, SLIDE, BALL)}  # of descriptions
OF_FILES: dict[str, tuple[JointKind, ...]] = {  # joints of URDF and SDF: what they are made of
    'revolute': (HINGE,), 'continuous': (HINGE,), 'prismatic': (SLIDE,), 'fixed': (), 'link': (),
    'ball': (BALL,), 'spherical': (BALL,), 'universal': (HINGE, HINGE),
    'revolute2': (HINGE, HINGE), 'planar': (SLIDE, SLIDE, HINGE),
    'floating': (SLIDE, SLIDE, SLIDE, BALL),
}  # fmt: skip
