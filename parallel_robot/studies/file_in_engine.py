"""A described machine beside what an engine makes of the same file, as the file is.

MuJoCo compiles MJCF, Pinocchio reads URDF. Their inertia and forces are reduced to the actuated
joints by the rates with which the suite's other joints follow; these must keep the loops closed.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError, optional, printable
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.closure_solver import close
from parallel_robot_model.mechanisms.description.home import posture
from parallel_robot_model.mechanisms.description.machine import Machine, parsed
from parallel_robot_model.mechanisms.description.parts import Frame, null_space
from parallel_robot_model.mechanisms.description.tree import Tree, build, link_frames
from parallel_robot_model.mechanisms.dynamics import model
from parallel_robot_model.mechanisms.mechanism import BASE, FOUND, Mechanism
from parallel_robot_model.mechanisms.workspace import boxed
from parallel_robot_model.robots.registry import RobotModel

POSTURES = 6  # the first is home
SPREAD = 0.05  # rad, or of the length of the machine, of the others about it
TRIES = 20  # of one posture, each time nearer to home
ROUNDING = 1e-9  # relative difference
SPINS = 1e-6  # that of an inertia where rods spin freely, whose own inertia counts as none
FAINT = 1e-6  # of the weight at the length of the machine: a torque that is none


class Compared(NamedTuple):
    """A quantity in the suite and in an engine, where they differ most."""

    what: str  # the quantity
    where: str  # the joint, joints or loop
    unit: str  # of the next three
    here: float  # in the suite
    there: float  # in the engine
    size: float  # largest element of the quantity
    tolerance: float = ROUNDING  # relative difference that is none

    @property
    def share(self) -> float:
        """The difference relative to the size."""
        return 0.0 if self.here == self.there else abs(self.here - self.there) / self.size

    @property
    def agrees(self) -> bool:
        """Whether the difference is rounding."""
        return self.share < self.tolerance

    def text(self) -> str:
        """The difference in words."""
        here, there = (f'{x:.4g}' if np.isfinite(x) else 'none' for x in self[3:5])
        by = f' by {abs(self.here - self.there):.3g} {self.unit}' if self.share < np.inf else ''
        return f'{self.what}{by.rstrip()} at {self.where} ({here} here, {there} there)'


def compare(robot: RobotModel, path: Path, seed: int = 0) -> tuple[str, list[Compared]]:
    """Hold a machine as it is read from a file against what an engine makes of that file.

    Args:
        robot: The machine; of its parameters those that choose joints, tool and home count.
        path: Its file.
        seed: Of postures and rates.

    Returns:
        Name of the engine, and each quantity where it differs most.

    Raises:
        InputError: no engine here reads such a file, or it does not take it.
    """
    module: Any = robot.module
    machine, description = module.machine(robot.parameters), module.description
    kind = str(parsed(module.text, description.source)[0].tag)
    if kind not in ENGINES:
        raise InputError(f'no engine here reads <{kind}>')
    engine: Any = ENGINES[kind](path)
    tree = build(description, posture(description, robot.parameters.home))
    held = [machine.names.index(name) for name in robot.parameters.held]
    random, found = np.random.default_rng(seed), dict[str, Compared]()
    for each in (*_at_postures(machine, tree, held, engine, random), *_limits(machine, engine)):
        if each.what not in found or not each.share <= found[each.what].share:
            found[each.what] = each
    return engine.name, [*found.values()]


def _at_postures(
    made: Machine, tree: Tree, held: list[int], engine: Any, random: np.random.Generator
) -> Iterator[Compared]:
    """Loops, inertia and forces at home and near it."""
    m, work = boxed(given := engine.known(made.mechanism))
    parts = zip(tree.links, given.rotation, given.origin, given.axis, strict=True)
    links = [link._replace(rotation=r, origin=o, axis=a) for link, r, o, a in parts]
    tree, n = tree._replace(links=tuple(links)), len(made.actuated)
    unit = np.where([unit == 'm' for unit in made.units], given.length, 1.0)
    weight = given.mass.sum() * float(np.linalg.norm(given.gravity)) * given.length
    M, Q = np.zeros((2, n, n))
    still, moving = np.zeros((2, n))
    for k in range(POSTURES):
        for tried in range(TRIES):
            away = 0.7**tried * SPREAD * unit * random.uniform(-1.0, 1.0, n) * (k > 0)
            if close(m, work, given.home[given.actuated] + away) == FOUND:
                break
        rates = unit * random.uniform(0.5, 1.0, n) * random.choice([-1.0, 1.0], n)
        model(m, work, np.zeros(n), M, Q, still)
        model(m, work, rates, M, Q, moving)
        T = engine.put(tree, np.array(work.all))
        V = T @ work.W
        free = np.zeros((len(T), 0))
        if engine.loops is not None:
            yield from _loops(engine, V, given.length)
            own = [int(np.argmax(np.abs(T[:, i]))) for i in given.actuated]
            others = np.setdiff1d(np.arange(len(T)), own)
            idle = null_space(np.vstack([engine.loops, np.linalg.pinv(T)[held]])[:, others])
            free = np.zeros((len(T), idle.shape[1]))
            free[others] = idle
            kept = len(made.held) - len(held)
            yield Compared('idle motions', 'the machine', '', kept, idle.shape[1], 1.0)
        yield _inertia(made, M, V, free, engine.inertia)
        yield _largest('gravity and springs', made, still, V.T @ engine.still, FAINT * weight)
        ours = {
            'dampers': moving - still + np.array(made.viscous) * rates,
            'dry friction': np.array(made.coulomb) * np.sign(rates),
            'fluid': np.zeros(n),
        }
        for (what, here), there in zip(ours.items(), engine.moving(V @ rates), strict=True):
            yield _largest(what, made, here, V.T @ there)


def _loops(engine: Any, V: Array, length: float) -> Iterator[Compared]:
    """Whether the loops are closed, and stay so at the rates V of the engine's joints."""
    for what, missed, size in (
        ('loops', np.abs(engine.open), length),
        ('rates of loops', np.abs(engine.loops @ V).max(axis=1), np.abs(V).max()),
    ):
        if len(missed):
            k = int(np.argmax(missed))
            yield Compared(what, engine.names[k], '', 0.0, float(missed[k]), size)


def _inertia(made: Machine, M: Array, V: Array, free: Array, whole: Array) -> Compared:
    """The inertia matrix; motions that nothing drives are held or free, whichever is nearer."""
    cross = free.T @ whole @ V
    left = cross.T @ np.linalg.pinv(free.T @ whole @ free) @ cross
    found = [_largest('inertia', made, M, V.T @ whole @ V - each) for each in (0.0, left)]
    nearest = min(found, key=lambda each: each.share)
    return nearest._replace(tolerance=SPINS) if free.shape[1] else nearest


def _largest(what: str, made: Machine, here: Array, there: Array, least: float = 0.0) -> Compared:
    """A quantity of the joints, shape (n,) or (n, n), whose size is at least so large."""
    at = np.unravel_index(np.argmax(np.abs(here - there)), here.shape)
    where = ' and '.join(printable(made.actuated[i]) for i in dict.fromkeys(at))
    units = ('N m', 'N') if here.ndim == 1 else ('kg m^2', 'kg m', 'kg')
    unit = units[sum(made.units[i] == 'm' for i in at)]
    size = max(float(np.abs([here, there]).max()), least)
    return Compared(what, where, unit, float(here[at]), float(there[at]), size)


def _limits(made: Machine, engine: Any) -> Iterator[Compared]:
    """Ends of travel of joints, greatest efforts and rates of the actuated ones."""
    whats = 'least travel', 'greatest travel', 'least effort', 'greatest effort', 'greatest rate'
    known = made.lower, made.upper, made.least_effort, made.effort, made.velocity
    here: dict[str, tuple[float, ...]] = dict(
        zip(made.actuated, zip(*known, strict=True), strict=True)
    )
    acting = made.mechanism.elements
    for i in made.mechanism.passive:
        alone = (acting.ratio[:, i] != 0.0) & (np.count_nonzero(acting.ratio, axis=1) == 1)
        ends = acting.travel[alone]
        here[made.names[i]] = ends[:, 0].max(initial=-np.inf), ends[:, 1].min(initial=np.inf)
    turns = dict(zip(made.names, made.mechanism.turns, strict=True))
    for joint, ours in here.items():
        if joint not in engine.joints:  # a hinge of a ball, a slide of a free body
            continue
        slides = int(turns[joint] == 0.0)
        for what, one, other in zip(whats, ours, engine.limits(joint), strict=False):
            units = ('N m', 'N') if 'effort' in what else ('rad', 'm')
            size = max((abs(x) for x in (one, other) if np.isfinite(x)), default=1.0) or 1.0
            name = printable(joint)
            yield Compared(what, name, units[slides], float(one), float(other), size)


@contextlib.contextmanager
def _telling(engine: str, *errors: type[Exception]) -> Iterator[None]:
    """Say in a line why an engine does not take a file."""
    try:
        yield
    except errors as error:
        why = printable(' '.join(str(error).split()))
        raise InputError(f'{engine} does not take it: {why}') from None


# MuJoCo, which compiles a file from its path, and its numbers of kinds.

FREE, BALL = 0, 1  # of joints
EQUALITY, FRICTION = 0, (1, 2)  # of constraints
TO_JOINTS = 0, 1  # of transmissions
INTEGRATOR = 1  # of activations
STRONG, UNLIMITED = 1e9, 1e6  # a command that every limit cuts, and what none has cut


class _Mujoco:
    """MJCF without contacts."""

    def __init__(self, path: Path) -> None:
        self._mujoco: Any = optional('mujoco')
        self.name = f'MuJoCo {self._mujoco.__version__}'
        with _telling('MuJoCo', ValueError, self._mujoco.FatalError):
            self._model = self._mujoco.MjModel.from_xml_path(str(path))
        self._model.opt.jacobian = self._mujoco.mjtJacobian.mjJAC_DENSE
        self._model.opt.disableflags |= self._mujoco.mjtDisableBit.mjDSBL_CONTACT
        if hasattr(self._model, 'actuator_delay'):
            self._model.actuator_delay[:] = 0.0
        self._data = self._mujoco.MjData(self._model)
        self.joints = [self._model.joint(j).name or f'joint_{j}' for j in range(self._model.njnt)]
        self._efforts = self._strongest()
        self.inertia = np.zeros((self._model.nv, self._model.nv))

    def known(self, mechanism: Mechanism) -> Mechanism:
        """What of a mechanism the engine reads: all."""
        return mechanism

    def put(self, tree: Tree, q: Array) -> Array:
        """Take a posture of the links; return the rates of its joints by theirs."""
        model, data = self._model, self._data
        T, names = np.zeros((model.nv, len(q))), [link.name for link in tree.links]
        for j, kind in enumerate(model.jnt_type):
            at, dof, body = model.jnt_qposadr[j], model.jnt_dofadr[j], model.jnt_bodyid[j]
            if kind not in (FREE, BALL):
                i = names.index(self.joints[j])
                data.qpos[at], T[dof, i] = q[i], 1.0
                continue
            ((turned, origin), (rate, turning)), before = _frame(tree, q, body), np.eye(3)
            if kind == FREE:
                data.qpos[at : at + 3], T[dof : dof + 3] = origin, rate
                at, dof = at + 3, dof + 3
            else:
                (before, _), (_, carried) = _frame(tree, q, model.body_parentid[body])
                zero = Rotation.from_quat(model.body_quat[body], scalar_first=True)
                before, turning = before @ zero.as_matrix(), turning - carried
            relative = Rotation.from_matrix(before.T @ turned)
            data.qpos[at : at + 4] = relative.as_quat(scalar_first=True)
            T[dof : dof + 3] = turned.T @ turning
        self._mujoco.mj_fwdPosition(model, data)
        self._move(np.zeros(model.nv))
        for row, one in zip(self.inertia, np.eye(model.nv), strict=True):
            self._mujoco.mj_mulM(model, data, row, one)
        self.still = data.qfrc_bias - data.qfrc_passive - self._lifts()
        rows = data.efc_type == EQUALITY
        self.loops, self.open = data.efc_J.reshape(-1, model.nv)[rows], data.efc_pos[rows]
        self.names = [model.equality(k).name or f'equality {k}' for k in data.efc_id[rows]]
        return T

    def _move(self, rates: Array) -> None:
        self._data.qvel = rates
        self._mujoco.mj_fwdVelocity(self._model, self._data)

    def _lifts(self) -> Array:
        """What actuators do against gravity beside their commands."""
        lifting = self._model.jnt_actgravcomp[self._model.dof_jntid]
        return np.asarray(self._data.qfrc_gravcomp * lifting)

    def moving(self, rates: Array) -> tuple[Array, Array, Array]:
        """Forces against dampers, dry friction and fluid, each shape (nv,)."""
        data, before = self._data, self._data.qfrc_passive.copy()
        self._move(rates)
        rows = np.isin(data.efc_type, FRICTION)
        J = data.efc_J.reshape(-1, self._model.nv)[rows]
        dry = J.T @ (data.efc_frictionloss[rows] * np.sign(J @ rates))
        return before - data.qfrc_passive + data.qfrc_fluid, dry, -data.qfrc_fluid

    def limits(self, name: str) -> tuple[float, ...]:
        """Ends of travel, least and greatest effort of a joint."""
        model, j = self._model, self.joints.index(name)
        off = model.opt.disableflags & self._mujoco.mjtDisableBit.mjDSBL_LIMIT
        travel = model.jnt_range[j] if model.jnt_limited[j] and not off else (-np.inf, np.inf)
        return *travel, *self._efforts[:, model.jnt_dofadr[j]]

    def _strongest(self) -> Array:
        """Least and greatest effort of degrees of freedom, shape (2, nv), by strong commands.

        Servos become motors of the same force.
        """
        model, data, mujoco, found = self._model, self._data, self._mujoco, []
        ends = np.where(model.jnt_actfrclimited[:, None], model.jnt_actfrcrange, [-np.inf, np.inf])
        of_joint = np.isin(model.actuator_trntype, TO_JOINTS) & (model.actuator_plugin < 0)
        motors = np.flatnonzero(of_joint)
        control = getattr(model, 'actuator_ctrladr', np.arange(len(of_joint)))
        servos = motors[(model.actuator_biastype | model.actuator_gaintype)[motors] != 0]
        for field in (model.actuator_biastype, model.actuator_gaintype, model.actuator_actlimited):
            field[servos] = 0
        model.actuator_gainprm[servos, 0] = 1.0
        model.actuator_ctrllimited[control[servos]] = 0
        driven = np.isin(model.dof_jntid, model.actuator_trnid[motors, 0])
        for sign, end in zip((-1.0, 1.0), ends[model.dof_jntid].T, strict=True):
            for i, at in zip(motors, control[motors], strict=True):
                gain = model.actuator_gainprm[i, 0] * model.actuator_gear[i, 0]
                command = data.ctrl[at] = sign * STRONG * np.sign(gain)
                if (state := model.actuator_actadr[i]) >= 0:
                    if model.actuator_ctrllimited[at] and model.actuator_dyntype[i] != INTEGRATOR:
                        command = np.clip(command, *model.actuator_ctrlrange[at])
                    if model.actuator_actlimited[i]:
                        command = np.clip(command, *model.actuator_actrange[i])
                    data.act[state] = command
            for compute in (mujoco.mj_fwdPosition, mujoco.mj_fwdVelocity, mujoco.mj_fwdActuation):
                compute(model, data)
            force = data.qfrc_actuator - self._lifts()
            found.append(np.where(driven & (np.abs(force) < UNLIMITED), force, end))
        return np.array(found)


def _frame(tree: Tree, q: Array, body: int) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Where a body of MuJoCo is, and its rates by the links; that of index 0 is the world."""
    places, host = link_frames(tree, q), tree.hosts[body - 1] if body else Frame(BASE)
    return places.frame(host), places.rates(host)


class _Pinocchio:
    """The tree of a URDF; Pinocchio reads no loops, rotors or springs."""

    loops = None

    def __init__(self, path: Path) -> None:
        lacking = 'Pinocchio is not installed; pip install pin'
        self._pin: Any = optional('pinocchio', lacking)
        with _telling('Pinocchio', ValueError, RuntimeError):
            self._model = self._pin.buildModelFromUrdf(str(path))
        self.name = f'Pinocchio {self._pin.__version__}'
        self._data = self._model.createData()
        self.joints = [*self._model.names][1:]
        if (np.array(self._model.nvs)[1:] != 1).any():
            raise InputError(f'{self.name}: joints of several freedoms are not compared')

    def known(self, mechanism: Mechanism) -> Mechanism:
        """What of a mechanism the engine reads."""
        return mechanism._replace(armature=0.0 * mechanism.armature)

    def put(self, tree: Tree, q: Array) -> Array:
        """Take a posture of the links; return the rates of its joints by theirs."""
        pin, model, data = self._pin, self._model, self._data
        names = [link.name for link in tree.links]
        T = np.eye(len(q))[[names.index(name) for name in self.joints]]
        taken = pin.integrate(model, pin.neutral(model), T @ q)
        half = np.triu(pin.crba(model, data, taken))
        self.inertia = half + np.triu(half, 1).T
        self.still = np.array(pin.computeGeneralizedGravity(model, data, taken))
        return T

    def moving(self, rates: Array) -> tuple[Array, Array, Array]:
        """Forces against dampers, dry friction and fluid, each shape (nv,)."""
        return self._model.damping * rates, self._model.friction * np.sign(rates), 0.0 * rates

    def limits(self, name: str) -> tuple[float, ...]:
        """Ends of travel, least and greatest effort, greatest rate of a joint."""
        model, joint = self._model, self._model.getJointId(name)
        at, dof = model.idx_qs[joint], model.idx_vs[joint]
        ends = model.lowerPositionLimit[at], model.upperPositionLimit[at]
        turns = model.nqs[joint] > 1  # by cosine and sine, without end
        effort, rate = model.effortLimit[dof] or np.inf, model.velocityLimit[dof] or np.inf
        return *((-np.inf, np.inf) if turns else ends), -effort, effort, rate


ENGINES = {'mujoco': _Mujoco, 'robot': _Pinocchio}
