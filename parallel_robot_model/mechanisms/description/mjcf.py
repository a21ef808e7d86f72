"""MJCF, read by the compiler of MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError, optional, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import robot_file
from parallel_robot_model.configuration.robot_file import Node
from parallel_robot_model.mechanisms.description.mjcf_actuators import actuators
from parallel_robot_model.mechanisms.description.mjcf_compiler import compiled, specified
from parallel_robot_model.mechanisms.description.mjcf_text import prepare
from parallel_robot_model.mechanisms.description.parts import (
    BALL,
    HINGE,
    SLIDE,
    WORLD,
    Body,
    Coupling,
    Description,
    Frame,
    Joint,
    Loop,
    listed,
)


def read(root: Node, source: str, merged: bool) -> Description:
    """A description from MJCF.

    Args:
        root: The element <mujoco>; what is not needed is removed from it.
        source: What the file is called in messages.
        merged: Whether it was made of several files.

    Raises:
        InputError: MuJoCo is not installed or does not take the file, or the robot has what this
            suite does not know.
    """
    spec, doubts = specification(root, source, merged)
    return _Reading(compiled(spec, source, merged), source, doubts).description()


def specification(root: Node, source: str, merged: bool) -> tuple[Any, list[str]]:
    """What MuJoCo makes of MJCF, with no shapes but those that inertias need, and doubts.

    Args:
        root: The element <mujoco>; what is not needed is removed from it.
        source: What the file is called in messages.
        merged: Whether it was made of several files.

    Raises:
        InputError: MuJoCo is not installed or does not take the file.
    """
    doubts = prepare(root)
    return specified(robot_file.write_xml(root, merged), source, merged), doubts


class _Reading:
    """A compiled model on its way to a description."""

    def __init__(self, model: Any, source: str, doubts: list[str]) -> None:
        self._model, self._source, self._doubts = model, source, doubts
        self._mujoco = optional('mujoco')
        self._bodies = [self._name(model.body(i), 'body', i) for i in range(model.nbody)]
        self._joints = [self._name(model.joint(i), 'joint', i) for i in range(model.njnt)]

    def description(self) -> Description:
        model = self._model
        loops, couplings = self._closures()
        return Description(
            source=self._source,
            bodies=tuple(self._body(i) for i in range(1, model.nbody)),
            joints=tuple(self._joint(i) for i in range(model.njnt)),
            loops=tuple(loops),
            couplings=tuple(couplings),
            actuators=tuple(actuators(model, self._joints, self._doubts)),
            frames=self._frames(),
            keyframes=dict(self._keyframe(i) for i in range(model.nkey)),
            gravity=self._gravity(),
            doubts=tuple(self._doubts),
        )

    def _gravity(self) -> Array:
        model = self._model
        if floating := [self._bodies[i] for i in np.flatnonzero(model.body_gravcomp)]:
            self._doubts.append(f'gravcomp is left out, bodies weigh: {listed(floating)}')
        off = model.opt.disableflags & int(self._mujoco.mjtDisableBit.mjDSBL_GRAVITY)
        return np.zeros(3) if off else np.array(model.opt.gravity)

    @staticmethod
    def _name(part: Any, kind: str, index: int) -> str:
        return str(part.name) or f'{kind}_{index}'

    def _matrix(self, quaternion: Any) -> Array:
        matrix = np.empty(9)
        self._mujoco.mju_quat2Mat(matrix, np.array(quaternion))
        return matrix.reshape(3, 3)

    def _body(self, index: int) -> Body:
        model = self._model
        axes = self._matrix(model.body_iquat[index])
        return Body(
            name=self._bodies[index],
            parent=int(model.body_parentid[index]) - 1,
            rotation=self._matrix(model.body_quat[index]),
            position=np.array(model.body_pos[index]),
            mass=float(model.body_mass[index]),
            centre=np.array(model.body_ipos[index]),
            inertia=(axes * model.body_inertia[index]) @ axes.T,
        )

    def _joint(self, index: int) -> Joint:
        model, kinds = self._model, self._mujoco.mjtJoint
        body = int(model.jnt_bodyid[index])
        kind = {kinds.mjJNT_HINGE: HINGE, kinds.mjJNT_SLIDE: SLIDE, kinds.mjJNT_BALL: BALL}.get(
            int(model.jnt_type[index])
        )
        if kind is None:
            raise InputError(
                f'{self._source}: body {printable(self._bodies[body])!r} floats (free joint); '
                'a robot must be fixed to the world'
            )
        dof = model.jnt_dofadr[index]
        lower, upper = model.jnt_range[index] if model.jnt_limited[index] else (-np.inf, np.inf)
        forces = model.jnt_actfrcrange[index] if model.jnt_actfrclimited[index] else (-np.inf,) * 2
        if model.jnt_stiffness[index] and kind != BALL:
            self._doubts.append(
                f'joint {printable(self._joints[index])!r} has a spring, which is left out'
            )
        return Joint(
            name=self._joints[index],
            body=body - 1,
            kind=kind,
            axis=np.array(model.jnt_axis[index]),
            anchor=np.array(model.jnt_pos[index]),
            zero=0.0 if kind == BALL else float(model.qpos0[model.jnt_qposadr[index]]),
            lower=-np.inf if kind == BALL else float(lower),
            upper=np.inf if kind == BALL else float(upper),
            effort=float(max(np.abs(forces))),
            viscous=float(np.atleast_1d(model.dof_damping[dof]).flat[0]),
            coulomb=float(model.dof_frictionloss[dof]),
            armature=float(model.dof_armature[dof]),
        )

    def _closures(self) -> tuple[list[Loop], list[Coupling]]:
        model, kinds = self._model, self._mujoco.mjtEq
        loops, couplings = [], []
        for i in range(model.neq):
            name, kind = self._name(model.equality(i), 'equality', i), int(model.eq_type[i])
            if not model.eq_active0[i]:
                self._doubts.append(f'equality {printable(name)!r} is not active, so left out')
            elif kind == kinds.mjEQ_JOINT:
                couplings.append(self._coupling(i, name))
            elif kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                loops.append(self._loop(i, name, kind == kinds.mjEQ_WELD))
            else:
                raise InputError(
                    f'{self._source}: equality {printable(name)!r} is of a kind that is not '
                    'known: connect, weld or joint'
                )
        return loops, couplings

    def _coupling(self, index: int, name: str) -> Coupling:
        model = self._model
        first, second = model.eq_obj1id[index], model.eq_obj2id[index]
        constant, ratio, *higher = (float(value) for value in model.eq_data[index, :5])
        if any(higher):
            raise InputError(
                f'{self._source}: equality {printable(name)!r} is not linear: polycoef may have '
                'two coefficients'
            )
        offset = constant + float(model.qpos0[model.jnt_qposadr[first]])
        if second < 0:
            return Coupling(name, self._joints[first], '', 0.0, offset)
        offset -= ratio * float(model.qpos0[model.jnt_qposadr[second]])
        return Coupling(name, self._joints[first], self._joints[second], ratio, offset)

    def _loop(self, index: int, name: str, weld: bool) -> Loop:
        model, data = self._model, np.array(self._model.eq_data[index])
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        if int(model.eq_objtype[index]) == self._mujoco.mjtObj.mjOBJ_SITE:
            return Loop(name, self._site(first), self._site(second), weld)
        if not weld:
            frames = Frame(first - 1, position=data[:3]), Frame(second - 1, position=data[3:6])
            return Loop(name, *frames, False)
        rotation = self._matrix(data[6:10] / np.linalg.norm(data[6:10]))
        return Loop(
            name, Frame(first - 1, rotation, data[3:6]), Frame(second - 1, position=data[:3]), True
        )

    def _site(self, index: int) -> Frame:
        model = self._model
        rotation = self._matrix(model.site_quat[index])
        return Frame(int(model.site_bodyid[index]) - 1, rotation, np.array(model.site_pos[index]))

    def _frames(self) -> dict[str, Frame]:
        model = self._model
        frames = {self._bodies[i]: Frame(i - 1 if i else WORLD) for i in range(model.nbody)}
        return frames | {
            model.site(i).name: self._site(i) for i in range(model.nsite) if model.site(i).name
        }

    def _keyframe(self, index: int) -> tuple[str, dict[str, float | tuple[float, ...]]]:
        model = self._model
        posture: dict[str, float | tuple[float, ...]] = {}
        for name, address, kind in zip(
            self._joints, model.jnt_qposadr, model.jnt_type, strict=True
        ):
            values = model.key_qpos[index, address : address + 4]
            ball = int(kind) == self._mujoco.mjtJoint.mjJNT_BALL
            posture[name] = tuple(map(float, values)) if ball else float(values[0])
        return self._name(model.key(index), 'key', index), posture
