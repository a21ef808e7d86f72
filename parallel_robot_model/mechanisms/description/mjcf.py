"""MJCF, read by the compiler of MuJoCo."""

from __future__ import annotations

import contextlib
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError, optional, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import robot_file
from parallel_robot_model.configuration.robot_file import Node, children, refused
from parallel_robot_model.mechanisms.description.parts import (
    BALL,
    HINGE,
    SLIDE,
    UNLIMITED,
    WORLD,
    Actuator,
    Body,
    Coupling,
    Description,
    Frame,
    Joint,
    Loop,
    listed,
)

# MJCF before MuJoCo compiles it: nothing that needs files, nothing that fills the memory.

REFUSED = {
    'include': 'is not resolved: read the file by its path',
    'attach': 'attaches another model; write it as one',
    'model': 'is another model; write it as one',
    'composite': 'is a flexible thing; a robot is of rigid bodies',
    'flexcomp': 'is a flexible thing; a robot is of rigid bodies',
    'deformable': 'is a flexible thing; a robot is of rigid bodies',
}
DROPPED = {
    'asset', 'visual', 'statistic', 'sensor', 'custom', 'size', 'light', 'camera', 'contact',
    'extension', 'plugin',
}  # fmt: skip
REFERENCES = ('material', 'fitscale')  # of shapes to assets
NAMES = {'name', 'class', 'childclass', 'model', 'joint', 'site', 'body', 'group'}
COPIES = 1000  # of bodies that <replicate> may make


def prepare(root: Node) -> list[str]:
    """Remove from a tree of MJCF what has no part in masses and joints.

    Args:
        root: The element <mujoco>, which is changed.

    Returns:
        What was left out that moves a robot, for people.

    Raises:
        InputError: an element needs other files, or has no place in a robot.
    """
    doubts: list[str] = []
    _prune(root, 1, doubts)
    _drop_cables(root, doubts)
    for compiler in root.iter('compiler'):
        for key in ('balanceinertia', 'boundmass', 'boundinertia', 'settotalmass'):
            if compiler.get(key, 'false') not in ('false', '0', '-1'):
                doubts.append(f'the file asks for {key}, so its masses or inertias are changed')
    last = Node('compiler', fusestatic='false', discardvisual='false')
    last.append(Node('lengthrange', mode='none'))
    root.append(last)
    return doubts


def _drop_cables(root: Node, doubts: list[str]) -> None:
    """Remove tendons that wind around shapes, and what drives or ties them."""
    names = set()
    for tendons in children(root, 'tendon'):
        for cable in children(tendons, 'spatial'):
            names.add(cable.get('name', ''))
            tendons.remove(cable)
    for parent in children(root, 'actuator') + children(root, 'equality'):
        for node in children(parent):
            if {node.get('tendon', node.get('tendon1')), node.get('tendon2')} & names:
                parent.remove(node)
    if names:
        doubts.append(f'tendons in space are left out, and what drives them: {listed(names)}')


def _prune(node: Node, copies: int, doubts: list[str]) -> None:
    """Refuse, remove and clean what stands in an element."""
    if node.tag == 'replicate':
        count = node.get('count', '1').strip()
        copies *= int(count) if count.isdecimal() and len(count) < 9 else COPIES + 1
        if copies > COPIES:
            raise refused(node, f'makes more than {COPIES} copies')
    for name in REFERENCES:
        node.attrib.pop(name, None)
    for name, value in node.items():
        if name not in NAMES and 'nan' in value.lower().split():
            raise refused(node, f'{name}={printable(value)!r} is not a number')
    for child in children(node):
        tag = str(child.tag)
        if tag in REFUSED:
            raise refused(child, REFUSED[tag])
        if tag in DROPPED:
            node.remove(child)
            if tag == 'plugin':
                doubts.append(f'a plugin in {printable(node.tag)} is left out')
        else:
            _prune(child, copies, doubts)


# MuJoCo's compiler: MJCF made a model without files.


def _specified(text: str, source: str, merged: bool) -> Any:
    """The specification of a model, with no shapes but those that inertias need."""
    mujoco = optional('mujoco')
    with _naming(source, merged):
        spec = mujoco.MjSpec.from_string(text)
        for body in spec.bodies:
            _need_no_meshes(mujoco, spec, body, source)
    return spec


def compiled(spec: Any, source: str, merged: bool) -> Any:
    """The model of a specification.

    Raises:
        InputError: MuJoCo does not take it.
    """
    with _naming(source, merged):
        return spec.compile()


@contextlib.contextmanager
def _naming(source: str, merged: bool) -> Iterator[None]:
    """What MuJoCo refuses, with the name of the file."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter('ignore')  # of states and of contacts
            yield
    except (ValueError, optional('mujoco').FatalError) as error:
        raise InputError(f'{source}: {_reason(str(error), merged)}') from None


def _need_no_meshes(mujoco: Any, spec: Any, body: Any, source: str) -> None:
    """Refuse a body whose inertia is that of a mesh; make other meshes points without mass."""
    kinds = mujoco.mjtGeom
    meshes = kinds.mjGEOM_MESH, kinds.mjGEOM_HFIELD, kinds.mjGEOM_SDF
    lowest, highest = spec.compiler.inertiagrouprange
    from_geoms = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    known = body.explicitinertial and not from_geoms
    for geom in body.geoms:
        if geom.type not in meshes and not geom.meshname:
            continue
        counts = lowest <= geom.group <= highest and geom.mass != 0 and geom.density != 0
        if counts and not known and _moves(body):
            raise InputError(
                f'{source}: body {printable(body.name)!r} has no inertial, and that of its mesh '
                f'{printable(geom.meshname)!r} is not known: add one'
            )
        geom.type, geom.meshname, geom.hfieldname = kinds.mjGEOM_SPHERE, '', ''
        geom.size, geom.mass, geom.fromto = [1e-3, 0, 0], 0.0, [math.nan] * 6


def _moves(body: Any) -> bool:
    """Whether a body, or one that carries it, has a joint."""
    while body.name != 'world':
        if len(body.joints):
            return True
        body = body.parent
    return False


def _reason(text: str, merged: bool) -> str:
    """What MuJoCo says, on one line."""
    text = re.sub(r'(XML )?Error: *', '', ' '.join(text.split()))
    return printable(re.sub(r',? line \d+', '', text) if merged else text)


# Which joints the actuators of MJCF drive, and how strong they are.


def actuators(model: Any, joints: Sequence[str], doubts: list[str]) -> list[Actuator]:
    """The actuators of hinges and slides.

    Args:
        model: A compiled model.
        joints: Names of its joints.
        doubts: Where to tell of servos, and of actuators that drive something else.
    """
    mujoco = optional('mujoco')
    kinds = mujoco.mjtTrn
    found, servos, others = [], [], []
    for i in range(len(model.actuator_trntype)):
        name = str(model.actuator(i).name) or f'actuator_{i}'
        joint = int(model.actuator_trnid[i, 0])
        on_joint = int(model.actuator_trntype[i]) in (
            kinds.mjTRN_JOINT,
            kinds.mjTRN_JOINTINPARENT,
        )
        if not on_joint or int(model.jnt_type[joint]) == mujoco.mjtJoint.mjJNT_BALL:
            others.append(name)
            continue
        name = str(model.actuator(i).name) or joints[joint]
        if int(model.actuator_biastype[i]) != mujoco.mjtBias.mjBIAS_NONE:
            servos.append(name)
        greatest = _effort(mujoco, model, i)
        found.append(Actuator(name, joints[joint], (-greatest, greatest)))
    if servos:
        doubts.append(f'servos are taken for motors, their gains left out: {listed(servos)}')
    if others:
        doubts.append(f'actuators that drive no single joint are left out: {listed(others)}')
    return found


def _effort(mujoco: Any, model: Any, index: int) -> float:
    """Greatest torque or force of an actuator at its joint."""
    gear = abs(float(model.actuator_gear[index, 0]))
    limits = [math.inf]
    if model.actuator_forcelimited[index]:
        limits.append(float(np.abs(model.actuator_forcerange[index]).max()))
    fixed = int(model.actuator_gaintype[index]) == mujoco.mjtGain.mjGAIN_FIXED
    free = int(model.actuator_biastype[index]) == mujoco.mjtBias.mjBIAS_NONE
    still = int(model.actuator_dyntype[index]) == mujoco.mjtDyn.mjDYN_NONE
    one = len(model.actuator_ctrllimited) == len(model.actuator_trntype)  # control of each
    if one and model.actuator_ctrllimited[index] and fixed and free and still:
        gain = abs(float(model.actuator_gainprm[index, 0]))
        limits.append(gain * float(np.abs(model.actuator_ctrlrange[index]).max()))
    return min(limits) * gear if gear else math.inf


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
    return _specified(robot_file.write_xml(root, merged), source, merged), doubts


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
            tendons=(),
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
        forces = model.jnt_actfrcrange[index] if model.jnt_actfrclimited[index] else UNLIMITED
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
            effort=(float(forces[0]), float(forces[1])),
            damping=self._polynomial('dof_damping', dof),
            coulomb=float(model.dof_frictionloss[dof]),
            armature=float(model.dof_armature[dof]),
        )

    def _polynomial(self, field: str, index: int) -> tuple[float, ...]:
        """The coefficients of a force, as many as the release of MuJoCo knows."""
        higher = getattr(self._model, f'{field}poly', np.zeros((index + 1, 0)))[index]
        return (float(getattr(self._model, field)[index]), *map(float, higher))

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
