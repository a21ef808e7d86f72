"""MJCF, read by the compiler of MuJoCo."""

from __future__ import annotations

import contextlib
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_model.common.errors import InputError, optional, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.configuration import robot_file
from parallel_robot_model.configuration.robot_file import Node, children, refused
from parallel_robot_model.mechanisms.description.mjcf_fields import unread
from parallel_robot_model.mechanisms.description.parts import (
    UNLIMITED,
    WORLD,
    Actuator,
    Body,
    Coupling,
    Description,
    Frame,
    Joint,
    Loop,
    Polynomial,
    Range,
    Tendon,
    added,
    listed,
    slides_of,
)
from parallel_robot_model.mechanisms.joint_kinds import BALL, KINDS, SLIDE, JointKind

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
SWITCHED = {  # flags, and what is nothing where a file switches them off
    'spring': (
        'jnt_stiffness', 'jnt_stiffnesspoly', 'qpos_spring',
        'tendon_stiffness', 'tendon_stiffnesspoly',
    ),
    'damper': ('dof_damping', 'dof_dampingpoly', 'tendon_damping', 'tendon_dampingpoly'),
    'frictionloss': ('dof_frictionloss', 'tendon_frictionloss'),
    'limit': ('jnt_limited', 'tendon_limited'),
}  # fmt: skip
CONSTRAINTS = 'equality', 'frictionloss', 'limit'  # that the solver makes, and one flag stops
TORQUE_SCALE = 10  # where the numbers of a weld have it
NAMES = {'name', 'class', 'childclass', 'model', 'joint', 'site', 'body', 'group'}
COPIES = 1000  # of bodies that <replicate> may make


def _drop_cables(root: Node, warnings: list[str]) -> None:
    """Remove tendons that wind around shapes, and what drives or ties them."""
    names = set()
    for tendons in children(root, 'tendon'):
        for cable in children(tendons, 'spatial'):
            if cable.get('armature', '').strip(' +-.0'):
                raise refused(cable, 'has armature: its inertia is not known here')
            names.add(cable.get('name', ''))
            tendons.remove(cable)
    for parent in children(root, 'actuator') + children(root, 'equality'):
        for node in children(parent):
            if {node.get('tendon', node.get('tendon1')), node.get('tendon2')} & names:
                parent.remove(node)
    if names:
        warnings.append(f'tendons in space are left out, and what drives them: {listed(names)}')


def _prune(node: Node, copies: int, warnings: list[str]) -> None:
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
                warnings.append(f'a plugin in {printable(node.tag)} is left out')
        else:
            _prune(child, copies, warnings)


# MuJoCo's compiler: MJCF made a model without files.


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
        text = re.sub(r'(XML )?Error: *', '', ' '.join(str(error).split()))
        text = re.sub(r',? line \d+', '', text) if merged else text
        raise InputError(f'{source}: {printable(text)}') from None


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
    spec, warnings = specification(root, source, merged)
    return _Reading(compiled(spec, source, merged), source, warnings).description()


def specification(root: Node, source: str, merged: bool) -> tuple[Any, list[str]]:
    """What MuJoCo makes of MJCF, with no shapes but those that inertias need, and doubts.

    Args:
        root: The element <mujoco>; what is not needed is removed from it.
        source: What the file is called in messages.
        merged: Whether it was made of several files.

    Raises:
        InputError: MuJoCo is not installed or does not take the file, or an element needs other
            files or has no place in a robot.
    """
    warnings: list[str] = []
    _prune(root, 1, warnings)
    _drop_cables(root, warnings)
    for compiler in root.iter('compiler'):
        for key in ('balanceinertia', 'boundmass', 'boundinertia', 'settotalmass'):
            if compiler.get(key, 'false') not in ('false', '0', '-1'):
                warnings.append(f'the file asks for {key}, so its masses or inertias are changed')
    last = Node('compiler', fusestatic='false', discardvisual='false')
    last.append(Node('lengthrange', mode='none'))
    root.append(last)
    mujoco = optional('mujoco')
    with _naming(source, merged):
        spec = mujoco.MjSpec.from_string(robot_file.write_xml(root, merged))
        for body in spec.bodies:
            _need_no_meshes(mujoco, spec, body, source)
    return spec, warnings


class _Drive(NamedTuple):
    """An actuator of MuJoCo and what it acts on."""

    actuator: Actuator  # with the name of a joint; empty: it drives no single one
    tendon: int  # index of a fixed tendon that it pulls, or -1
    motor: bool  # whether its control is a force


class _Reading:
    """A compiled model on its way to a description."""

    def __init__(self, model: Any, source: str, warnings: list[str]) -> None:
        self._model, self._source, self._warnings = model, source, warnings
        self._mujoco = optional('mujoco')
        self._bodies = [self._name(model.body(i), 'body', i) for i in range(model.nbody)]
        self._joints = [self._name(model.joint(i), 'joint', i) for i in range(model.njnt)]
        for flag, names in SWITCHED.items():
            for name in names if self._off(flag) else ():
                if hasattr(model, name):
                    getattr(model, name)[:] = 0
        if self._off('gravity') or (self._off('spring') and self._off('damper')):
            model.body_gravcomp[:] = 0.0

    def description(self) -> Description:
        model = self._model
        loops, couplings = self._closures()
        drives, pulling = self._drives()
        self._warnings += [*unread(model), *self._of_fluid(), *self._of_balls()]
        tendons = tuple(self._tendons(pulling))
        return Description(
            source=self._source,
            bodies=tuple(self._body(i) for i in range(1, model.nbody)),
            joints=tuple(joint for i in range(model.njnt) for joint in self._joint(i)),
            loops=tuple(loops),
            couplings=tuple(couplings),
            tendons=tendons,
            actuators=tuple(drives),
            frames=self._frames(),
            keyframes=dict(self._keyframe(i) for i in range(model.nkey)),
            gravity=np.zeros(3) if self._off('gravity') else np.array(model.opt.gravity),
            doubts=tuple(self._warnings),
        )

    def _drives(self) -> tuple[list[Actuator], list[_Drive]]:
        """What drives joints, and what pulls tendons that are of several joints."""
        count = len(self._model.actuator_trntype)
        names = [self._name(self._model.actuator(i), 'actuator', i) for i in range(count)]
        off = [i for i in range(count) if self._is_off(i)]
        drives = {i: self._drive(i, names[i]) for i in range(count) if i not in off}
        driven = {i: drive for i, drive in drives.items() if drive.actuator.joint}
        moved = {drive.actuator.joint for drive in driven.values() if drive.motor}
        servos = [i for i, drive in driven.items() if not drive.motor]
        beside = [i for i in servos if driven[i].actuator.joint in moved]
        left = {
            'actuators are switched off by the file': off,
            'actuators that drive no single joint are left out': [*drives.keys() - driven.keys()],
            'servos beside motors are left out': beside,
            'servos are taken for motors, their gains left out': [*{*servos} - {*beside}],
        }
        for what, which in left.items():
            if which:
                own = (drives[i].actuator.name if i in drives else names[i] for i in sorted(which))
                self._warnings.append(f'{what}: {listed(own)}')
        found = [
            drive.actuator._replace(effort=(0.0, 0.0)) if i in beside else drive.actuator
            for i, drive in driven.items()
        ]
        return found, [each for i, each in drives.items() if i not in driven and each.tendon >= 0]

    def _is_off(self, index: int) -> bool:
        group, off = int(self._model.actuator_group[index]), self._model.opt.disableactuator
        return self._off('actuation') or (0 <= group <= 30 and bool(off >> group & 1))

    def _drive(self, index: int, name: str) -> _Drive:
        model, kinds = self._model, self._mujoco.mjtTrn
        kind, target = int(model.actuator_trntype[index]), int(model.actuator_trnid[index, 0])
        gear = float(model.actuator_gear[_address(model, 'out', index), 0])
        joint, tendon = -1, -1
        if kind in (kinds.mjTRN_JOINT, kinds.mjTRN_JOINTINPARENT):
            joint = target
        elif kind == kinds.mjTRN_TENDON:
            tendon = target
            first, many = int(model.tendon_adr[target]), int(model.tendon_num[target])
            if many == 1:
                joint, gear = int(model.wrap_objid[first]), gear * float(model.wrap_prm[first])
        if joint >= 0 and not self._is_single(joint):
            joint = -1
        rotor = _value(model, 'actuator_armature', index)
        if rotor and joint < 0 and tendon < 0:
            raise InputError(
                f'{self._source}: actuator {printable(name)!r} has armature behind a transmission '
                'to no joint and no fixed tendon: its inertia is not known here'
            )
        dynamics, types = self._mujoco.mjtDyn, int(model.actuator_dyntype[index])
        filtered = types in (dynamics.mjDYN_FILTER, dynamics.mjDYN_FILTEREXACT)
        force = (  # whether the control or the activation is one
            int(model.actuator_gaintype[index]) == self._mujoco.mjtGain.mjGAIN_FIXED
            and int(model.actuator_biastype[index]) == self._mujoco.mjtBias.mjBIAS_NONE
        )
        motor = force and (types == dynamics.mjDYN_NONE or filtered)
        least, most = self._forces(index, force, motor)
        low, high = sorted(gear * limit if gear else 0.0 for limit in (least, most))
        moved = self._joints[joint] if joint >= 0 else ''
        actuator = Actuator(
            name=str(model.actuator(index).name) or moved or name,
            joint=moved,
            effort=(low, high) if gear else UNLIMITED,
            armature=gear**2 * rotor,
            damping=tuple(gear**2 * x for x in _polynomial(model, 'actuator_damping', index)),
            lag=float(model.actuator_dynprm[index, 0]) if filtered else 0.0,
            delay=_value(model, 'actuator_delay', index),
        )
        return _Drive(actuator, tendon, motor)

    def _forces(self, index: int, force: bool, motor: bool) -> Range:
        """Least and greatest force before the gear."""
        model, ranges = self._model, [np.array(UNLIMITED)]
        if model.actuator_forcelimited[index]:
            ranges.append(model.actuator_forcerange[index])
        gain, control = float(model.actuator_gainprm[index, 0]), _address(model, 'ctrl', index)
        if motor and model.actuator_ctrllimited[control] and not self._off('clampctrl'):
            ranges.append(np.sort(gain * model.actuator_ctrlrange[control]))
        if force and model.actuator_actlimited[index]:
            ranges.append(np.sort(gain * model.actuator_actrange[index]))
        return max(float(each[0]) for each in ranges), min(float(each[1]) for each in ranges)

    def _off(self, flag: str) -> bool:
        """Whether the file switches something off."""
        bits, name = self._mujoco.mjtDisableBit, f'mjDSBL_{flag.upper()}'
        bit = getattr(bits, name) if hasattr(bits, name) else bits.mjDSBL_PASSIVE  # of old ones
        off = int(bit) | (int(bits.mjDSBL_CONSTRAINT) if flag in CONSTRAINTS else 0)
        return bool(self._model.opt.disableflags & off)

    def _of_fluid(self) -> Iterator[str]:
        """What a medium does, at rates of 1 rad/s or m/s."""
        model = self._model
        if not (model.opt.density or model.opt.viscosity) or not model.nv:
            return
        data = self._mujoco.MjData(model)
        data.qvel[:] = 1.0
        self._mujoco.mj_forward(model, data)
        force = np.abs(data.qfrc_fluid).max()
        yield f'the forces of density, viscosity and wind are left out: {force:.3g} N m at 1 rad/s'

    def _of_balls(self) -> Iterator[str]:
        """Springs, dampers and limits of balls and of bodies that float."""
        model = self._model
        for i in range(model.njnt):
            if self._is_single(i):
                continue
            dof = model.jnt_dofadr[i]
            found = {
                'spring': model.jnt_stiffness[i],
                'damping': model.dof_damping[dof],
                'friction': model.dof_frictionloss[dof],
                'range': model.jnt_limited[i],
            }
            if left := [name for name, value in found.items() if value]:
                yield f'{printable(self._joints[i])!r} is a ball: left out are its ' + ', '.join(
                    f'{name} ({found[name]:.3g})' if name != 'range' else name for name in left
                )

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
            lifted=float(model.body_gravcomp[index]),
        )

    def _kind(self, index: int) -> JointKind | None:
        """Kind of a joint; None of a body that floats."""
        name = self._mujoco.mjtJoint(self._model.jnt_type[index]).name
        return KINDS.get(name.removeprefix('mjJNT_').lower())

    def _is_single(self, index: int) -> bool:
        """Whether a joint has one freedom."""
        kind = self._kind(index)
        return kind is not None and kind.single

    def _joint(self, index: int) -> Iterator[Joint]:
        model, name, kind = self._model, self._joints[index], self._kind(index)
        body = int(model.jnt_bodyid[index]) - 1
        dof, place = model.jnt_dofadr[index], model.jnt_qposadr[index]
        if not kind:
            axes = self._matrix(model.body_quat[body + 1])  # of the world, seen from the body
            for slide, axis in zip(slides_of(name), axes, strict=True):
                yield Joint(slide, body, SLIDE, axis)
            yield Joint(name, body, BALL, np.eye(3)[2])
            return
        single = kind.single
        limited, clamped = model.jnt_limited[index] and single, model.jnt_actfrclimited[index]
        lower, upper = model.jnt_range[index] if limited else UNLIMITED
        least, greatest = model.jnt_actfrcrange[index] if clamped else UNLIMITED
        yield Joint(
            name=name,
            body=body,
            kind=kind,
            axis=np.array(model.jnt_axis[index]),
            anchor=np.array(model.jnt_pos[index]),
            zero=float(model.qpos0[place]) if single else 0.0,
            lower=float(lower),
            upper=float(upper),
            effort=(float(least), float(greatest)),
            damping=_polynomial(model, 'dof_damping', dof) if single else (),
            coulomb=float(model.dof_frictionloss[dof]),
            armature=float(model.dof_armature[dof]),
            stiffness=_polynomial(model, 'jnt_stiffness', index) if single else (),
            rest=float(model.qpos_spring[place]) if single else 0.0,
        )

    def _tendons(self, pulling: Sequence[_Drive]) -> Iterator[Tendon]:
        """Fixed tendons; those in space are gone."""
        model = self._model
        for i in range(model.ntendon):
            parts = range(model.tendon_adr[i], model.tendon_adr[i] + model.tendon_num[i])
            own = [each.actuator for each in pulling if each.tendon == i]
            lower, upper = model.tendon_range[i] if model.tendon_limited[i] else UNLIMITED
            ratios: dict[str, float] = {}
            for part in parts:
                name = self._joints[model.wrap_objid[part]]
                ratios[name] = ratios.get(name, 0.0) + float(model.wrap_prm[part])
            coulomb = float(model.tendon_frictionloss[i])
            name = self._name(model.tendon(i), 'tendon', i)
            if coulomb and len(ratios) > 1:
                what = f'friction of tendon {printable(name)!r} is left out'
                self._warnings.append(f'{what}: {coulomb:.3g} N m or N along it')
            dampings = [_polynomial(model, 'tendon_damping', i), *(each.damping for each in own)]
            slack, stretched = model.tendon_lengthspring[i]
            yield Tendon(
                name=name,
                ratios=ratios,
                lower=float(lower),
                upper=float(upper),
                damping=() if self._off('damper') else added(*dampings),
                coulomb=coulomb,
                armature=_value(model, 'tendon_armature', i) + sum(each.armature for each in own),
                stiffness=_polynomial(model, 'tendon_stiffness', i),
                rest=(float(slack), float(stretched)),
            )

    def _closures(self) -> tuple[list[Loop], list[Coupling]]:
        model, kinds = self._model, self._mujoco.mjtEq
        loops, couplings = [], []
        for i in range(model.neq):
            name, kind = self._name(model.equality(i), 'equality', i), int(model.eq_type[i])
            if not model.eq_active0[i] or self._off('equality'):
                self._warnings.append(f'equality {printable(name)!r} is not active, so left out')
            elif kind == kinds.mjEQ_JOINT:
                couplings.append(self._coupling(i, name))
            elif kind in (kinds.mjEQ_CONNECT, kinds.mjEQ_WELD):
                turns = kind == kinds.mjEQ_WELD and bool(model.eq_data[i, TORQUE_SCALE])
                loops.append(self._loop(i, name, kind == kinds.mjEQ_WELD, turns))
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

    def _loop(self, index: int, name: str, weld: bool, turns: bool) -> Loop:
        model, data = self._model, np.array(self._model.eq_data[index])
        first, second = int(model.eq_obj1id[index]), int(model.eq_obj2id[index])
        if int(model.eq_objtype[index]) == self._mujoco.mjtObj.mjOBJ_SITE:
            return Loop(name, self._site(first), self._site(second), turns)
        if not weld:
            frames = Frame(first - 1, position=data[:3]), Frame(second - 1, position=data[3:6])
            return Loop(name, *frames, False)
        rotation = self._matrix(data[6:10] / np.linalg.norm(data[6:10]))
        at = Frame(first - 1, rotation, data[3:6])
        return Loop(name, at, Frame(second - 1, position=data[:3]), turns)

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
        for i, (name, place) in enumerate(zip(self._joints, model.jnt_qposadr, strict=True)):
            values, kind = model.key_qpos[index, place : place + 7], self._kind(i)
            if kind and kind.single:
                posture[name] = float(values[0])
                continue
            turned = values[:4]
            if not kind:
                moved = values[:3] - model.qpos0[place : place + 3]
                posture |= dict(zip(slides_of(name), map(float, moved), strict=True))
                turned = np.zeros(4)
                back = model.qpos0[place + 3 : place + 7] * (1.0, -1.0, -1.0, -1.0)
                self._mujoco.mju_mulQuat(turned, back, values[3:7])
            posture[name] = tuple(map(float, turned))
        return self._name(model.key(index), 'key', index), posture


def _address(model: Any, what: str, index: int) -> int:
    """Where the numbers of an actuator stand; each has one of everything in old releases."""
    addresses = getattr(model, f'actuator_{what}adr', None)
    return index if addresses is None else int(addresses[index])


def _value(model: Any, field: str, index: int) -> float:
    """A number that old releases do not have."""
    return float(getattr(model, field)[index]) if hasattr(model, field) else 0.0


def _polynomial(model: Any, field: str, index: int) -> Polynomial:
    """The coefficients of a force, up to the last that is not zero."""
    fields = (getattr(model, name, None) for name in (field, f'{field}poly'))
    whole = [x for each in fields if each is not None for x in np.atleast_1d(each[index])]
    return tuple(map(float, np.trim_zeros(whole, 'b')))
