"""A described machine in MuJoCo, made by MuJoCo from the text of the description.

Of the suite it has the parameters, the posture of home and which joints are held; tree, loops and
masses are what MuJoCo itself reads. A body that floats becomes one on three slides, a ball three
hinges, as they are in the suite; one with a rotor stays a ball, as MuJoCo feels it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError, optional
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.home import posture
from parallel_robot_model.mechanisms.description.machine import parsed, with_actuators
from parallel_robot_model.mechanisms.description.mjcf import compiled, specification
from parallel_robot_model.mechanisms.description.parts import (
    WORLD,
    Description,
    Joint,
    slides_of,
)
from parallel_robot_model.mechanisms.description.tree import AXES, Tree, build
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.robots.registry import RobotModel
from parallel_robot_sim.mujoco_model import STEP, MujocoBodies

HELD = 1e8  # of the inertias of the machine, the rotor of a joint that is held
STIFF = 1e-6  # of the yielding that MuJoCo gives a constraint
ITERATIONS = 5  # of Newton's method, which is exact where no constraint begins or ends
SLOW = 10.0  # steps, time constant of a constraint: slow enough for RK4


class MujocoMachine(MujocoBodies):
    """A described machine at rest, moved by torques."""

    def __init__(
        self, robot: RobotModel, pose: Array, friction_viscous: Sequence[float], step: float = STEP
    ) -> None:
        """Build the machine; arguments and errors as those of MujocoRobot."""
        module: Any = robot.module
        model, *self._tool = built(module, robot.parameters, friction_viscous, step)
        self._mechanism: Mechanism = module.mechanism(robot.parameters)
        super().__init__(model, self._mechanism.actuated)
        self._places = model.jnt_qposadr[model.dof_jntid[self._mechanism.actuated]]
        self._put(self._positions(model, module.posture(robot.parameters, np.asarray(pose))))

    def _positions(self, model: Any, q: Array) -> Array:
        """Positions of all joints as MuJoCo has them, balls as quaternions."""
        qpos, axis = np.array(model.qpos0), self._mechanism.axis
        for i, joint in enumerate(model.dof_jntid):
            at = model.jnt_qposadr[joint]
            if model.jnt_type[joint] != optional('mujoco').mjtJoint.mjJNT_BALL:
                qpos[at] = q[i]
            elif i == model.jnt_dofadr[joint]:
                turned = Rotation.identity()
                for hinge in range(i, i + 3):
                    turned = turned * Rotation.from_rotvec(q[hinge] * axis[hinge])
                qpos[at : at + 4] = turned.as_quat(scalar_first=True)
        return qpos

    @property
    def pose(self) -> Array:
        """The present pose, shape (m,)."""
        mechanism, (body, point, turned) = self._mechanism, self._tool
        if not len(mechanism.coordinate):
            return self.motion[0]
        frame = self._data.xmat[body].reshape(3, 3)
        home = mechanism.tool_home.T
        rotation = Rotation.from_matrix(frame @ turned @ home).as_rotvec()
        whole = np.concatenate([self._data.xpos[body] + frame @ point, rotation])
        return np.asarray(whole[mechanism.coordinate])

    @property
    def motion(self) -> tuple[Array, Array]:
        """The actuated joints and their rates, each shape (n,)."""
        return self._data.qpos[self._places], self._data.qvel[self._actuated]


def built(
    module: Any, parameters: Any, friction_viscous: Sequence[float], step: float
) -> tuple[Any, int, Array, Array]:
    """The model of a machine, and its tool.

    Args:
        module: The described robot.
        parameters: Its parameters.
        friction_viscous: Viscous friction of the actuated joints [N m s/rad or N s/m].
        step: Integration step [s].

    Returns:
        The model, whose joints are those of the mechanism in its order; the body of the tool, its
        place there [m], shape (3,), and its rotation, shape (3, 3).

    Raises:
        InputError: MuJoCo is not installed, the description is not MJCF, or the parameters have
            another geometry.
    """
    if any(parameters.shift):
        raise InputError('shift must be zero where MuJoCo computes: its geometry is of the file')
    mujoco, mechanism = optional('mujoco'), module.mechanism(parameters)
    description = module.description
    root, merged = parsed(module.text, description.source)
    if root.tag != 'mujoco':
        raise InputError(f'only MJCF can be built in MuJoCo, not <{root.tag}>')
    spec, _ = specification(root, description.source, merged)
    as_drawn = compiled(spec, description.source, merged)
    tree = build(description, posture(description, parameters.home))
    bodies = {body.id: body for body in spec.bodies}
    for part in (*spec.actuators, *spec.keys):
        spec.delete(part)
    balls = [joint for joint in description.joints if not joint.kind.single]
    for joint in balls:
        _make_single(spec, bodies[joint.body + 1], joint, description)
    of_file = module.machine(parameters).mechanism
    for i, link in enumerate(tree.links):
        masses = ((m.mass[i], *m.centre[i], *m.inertia[i].flat) for m in (mechanism, of_file))
        if len({*masses}) > 1:
            _load(bodies, tree, i, link.body, mechanism)
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = mechanism.gravity
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.tolerance, spec.option.iterations = 0.0, ITERATIONS
    spec.option.density = spec.option.viscosity = 0.0
    model = compiled(spec, description.source, merged)
    for joint in balls:
        home = _at_home(description, tree, mechanism, joint)
        model.body_quat[joint.body + 1] = home.as_quat(scalar_first=True)
        for k in np.flatnonzero(model.jnt_bodyid == joint.body + 1):
            if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_SLIDE:
                model.jnt_axis[k] = home.inv().apply(mechanism.axis[model.jnt_dofadr[k]])
            elif model.jnt_type[k] == mujoco.mjtJoint.mjJNT_HINGE:
                model.jnt_axis[k] = mechanism.axis[model.jnt_dofadr[k]]
    _act(model, with_actuators(description), tree, mechanism, friction_viscous)
    model.eq_solref[:] = SLOW * step, 1.0
    model.eq_solimp[:] = 0.9, 0.95, 0.001, 0.5, 2.0  # of MuJoCo
    mujoco.mj_setConst(model, mujoco.MjData(model))
    model.eq_data[:] = as_drawn.eq_data  # where the file closes a loop, not where home does
    model.dof_armature[:] = mechanism.armature
    for k in np.flatnonzero(mechanism.elements.ball.any(axis=1)):
        model.dof_armature[k - 2 : k + 1] = mechanism.elements.ball[k].sum()
    held = np.setdiff1d(np.arange(model.nv), [*mechanism.actuated, *mechanism.passive])
    held = held[model.jnt_type[model.dof_jntid[held]] != mujoco.mjtJoint.mjJNT_BALL]
    model.dof_armature[held] = HELD * model.stat.meaninertia
    model.body_invweight0[:] *= STIFF
    model.dof_invweight0[:] *= STIFF
    return model, *_tool(mechanism, tree)


def _make_single(spec: Any, body: Any, ball: Joint, description: Description) -> None:
    """Replace the ball of a body, or the joint that lets it float, by slides and hinges.

    A ball with a rotor stays.
    """
    (drawn,) = body.joints  # MuJoCo allows no other beside it
    kinds = optional('mujoco').mjtJoint
    if ball.armature and drawn.type == kinds.mjJNT_BALL:
        return
    spec.delete(drawn)
    for joint in description.joints:
        if joint.name in slides_of(ball.name):
            body.add_joint(name=joint.name, type=kinds.mjJNT_SLIDE, axis=joint.axis)
    for axis, along in zip(AXES, np.eye(3), strict=True):
        name = f'{ball.name}.{axis}'
        body.add_joint(name=name, type=kinds.mjJNT_HINGE, axis=along, pos=ball.anchor)


def _at_home(description: Description, tree: Tree, mechanism: Mechanism, ball: Joint) -> Rotation:
    """Rotation of a body with a ball at home, seen from its parent."""
    link = next(i for i, link in enumerate(tree.links) if link.joint is ball)
    parent = description.bodies[ball.body].parent
    above = np.eye(3) if parent == WORLD else tree.hosts[parent].rotation
    return Rotation.from_matrix(above.T @ mechanism.rotation[link])


def _load(bodies: dict[int, Any], tree: Tree, link: int, first: int, mechanism: Mechanism) -> None:
    """Give all that a link carries to its first body."""
    moments, axes = np.linalg.eigh(mechanism.inertia[link])
    axes *= np.sign(np.linalg.det(axes))
    for i, host in enumerate(tree.hosts):
        if host.body == link:
            body, share, back = bodies[i + 1], float(i == first), host.rotation.T
            for geom in [*body.geoms]:
                geom.mass, geom.density = 0.0, 0.0
            body.explicitinertial = True
            body.mass = share * mechanism.mass[link]
            body.inertia = share * np.maximum(moments, 0.0)
            body.ipos = back @ (mechanism.centre[link] - host.position)
            body.iquat = Rotation.from_matrix(back @ axes).as_quat(scalar_first=True)


def _act(
    model: Any,
    description: Description,
    tree: Tree,
    mechanism: Mechanism,
    viscous: Sequence[float],
) -> None:
    """Let act what the suite's plant has: no ends and no dry friction, flags as the file has them.

    Springs and dampers are those of the description, which has the actuators' dampers, too.
    """
    joints = {joint.name: joint for joint in description.joints}
    model.jnt_limited[:] = False
    model.dof_frictionloss[:] = 0.0
    model.tendon_limited[:] = False
    model.tendon_frictionloss[:] = 0.0
    for i, link in enumerate(tree.links):
        joint, at = joints[link.joint.name], model.dof_jntid[i]
        single = joint.kind.single  # nothing acts in others
        _write(model, 'dof_damping', i, joint.damping if single else ())
        _write(model, 'jnt_stiffness', at, joint.stiffness if single else ())
        if single:
            model.qpos_spring[model.jnt_qposadr[at]] = joint.rest
    model.dof_damping[mechanism.actuated] = viscous
    for k, tendon in enumerate(description.tendons):
        _write(model, 'tendon_damping', k, tendon.damping)
        _write(model, 'tendon_stiffness', k, tendon.stiffness)
        model.tendon_lengthspring[k] = tendon.rest
        if tendon.armature:
            model.tendon_armature[k] = tendon.armature
    for i, body in enumerate(description.bodies, 1):
        model.body_gravcomp[i] = body.lifted


def _write(model: Any, field: str, index: int, values: Sequence[float]) -> None:
    """Write the coefficients of a force."""
    getattr(model, field)[index] = sum(values[:1])
    if hasattr(model, f'{field}poly'):
        higher = getattr(model, f'{field}poly')[index]
        higher[:] = np.pad(values[1:], (0, len(higher)))[: len(higher)]


def _tool(mechanism: Mechanism, tree: Tree) -> tuple[int, Array, Array]:
    """The body that carries the tool, and where the tool is on it."""
    body, host = next(
        (i, host) for i, host in enumerate(tree.hosts) if host.body == mechanism.tool
    )
    back = host.rotation.T
    return body + 1, back @ (mechanism.tool_point - host.position), back @ mechanism.tool_rotation
