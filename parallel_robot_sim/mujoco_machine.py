"""A described machine in MuJoCo, made by MuJoCo from the text of the description.

Of the suite it has the parameters, the posture of home and which joints are held; tree, loops and
masses are what MuJoCo itself reads. A ball becomes three hinges, as it is in the suite.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from parallel_robot_model.common.errors import InputError, optional
from parallel_robot_model.common.units import Array
from parallel_robot_model.mechanisms.description.home import posture
from parallel_robot_model.mechanisms.description.machine import parsed
from parallel_robot_model.mechanisms.description.mjcf import compiled, specification
from parallel_robot_model.mechanisms.description.parts import BALL, WORLD, Description, Joint
from parallel_robot_model.mechanisms.description.tree import AXES, Tree, build
from parallel_robot_model.mechanisms.mechanism import Mechanism
from parallel_robot_model.robots.described.robot import description_of
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
        self._put(module.posture(robot.parameters, np.asarray(pose)))

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
        return self._data.qpos[self._actuated], self._data.qvel[self._actuated]


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
    description = description_of(module.text)
    root, merged = parsed(module.text, description.source)
    if root.tag != 'mujoco':
        raise InputError(f'only MJCF can be built in MuJoCo, not <{root.tag}>')
    spec, _ = specification(root, description.source, merged)
    as_drawn = compiled(spec, description.source, merged)
    tree = build(description, posture(description, parameters.home))
    bodies = {body.id: body for body in spec.bodies}
    for part in (*spec.actuators, *spec.tendons, *spec.keys):
        spec.delete(part)
    balls = [joint for joint in description.joints if joint.kind == BALL]
    for joint in balls:
        _make_hinges(spec, bodies[joint.body + 1])
    of_file = module.machine(parameters).mechanism
    for i, link in enumerate(tree.links):
        if not _same(mechanism, of_file, i):
            _load(bodies, tree, i, link.body, mechanism)
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = mechanism.gravity
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.option.tolerance, spec.option.iterations = 0.0, ITERATIONS
    spec.option.density = spec.option.viscosity = 0.0
    model = compiled(spec, description.source, merged)
    for joint in balls:
        model.body_quat[joint.body + 1] = _at_home(description, tree, mechanism, joint)
    _bare(model, mechanism, friction_viscous, step)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    model.eq_data[:] = as_drawn.eq_data  # where the file closes a loop, not where home does
    model.dof_armature[:] = mechanism.armature
    held = np.setdiff1d(np.arange(model.nv), [*mechanism.actuated, *mechanism.passive])
    model.dof_armature[held] = HELD * model.stat.meaninertia
    model.body_invweight0[:] *= STIFF
    model.dof_invweight0[:] *= STIFF
    return model, *_tool(mechanism, tree)


def _make_hinges(spec: Any, body: Any) -> None:
    """Replace the ball of a body by three hinges."""
    (ball,) = body.joints  # MuJoCo allows no other beside it
    name, place, armature = ball.name, np.array(ball.pos), ball.armature
    spec.delete(ball)
    for axis, along in zip(AXES, np.eye(3), strict=True):
        body.add_joint(
            name=f'{name}.{axis}',
            type=optional('mujoco').mjtJoint.mjJNT_HINGE,
            axis=along,
            pos=place,
            armature=armature,
            ref=0.0,
        )


def _at_home(description: Description, tree: Tree, mechanism: Mechanism, ball: Joint) -> Array:
    """Quaternion (w, x, y, z) of a body with a ball at home, seen from its parent."""
    link = next(i for i, link in enumerate(tree.links) if link.joint is ball)
    parent = description.bodies[ball.body].parent
    above = np.eye(3) if parent == WORLD else tree.hosts[parent].rotation
    return Rotation.from_matrix(above.T @ mechanism.rotation[link]).as_quat(scalar_first=True)


def _same(one: Mechanism, other: Mechanism, link: int) -> bool:
    """Whether a link has the same masses in both."""
    names = ('mass', 'centre', 'inertia')
    return all(np.array_equal(getattr(one, x)[link], getattr(other, x)[link]) for x in names)


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


def _bare(model: Any, mechanism: Mechanism, viscous: Sequence[float], step: float) -> None:
    """Leave of the joints what the suite's plant has: no springs, ends or friction of the file."""
    model.jnt_limited[:] = False
    model.jnt_stiffness[:] = 0.0
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.dof_damping[mechanism.actuated] = viscous
    model.eq_solref[:] = SLOW * step, 1.0
    model.eq_solimp[:] = 0.9, 0.95, 0.001, 0.5, 2.0  # of MuJoCo


def _tool(mechanism: Mechanism, tree: Tree) -> tuple[int, Array, Array]:
    """The body that carries the tool, and where the tool is on it."""
    body, host = next(
        (i, host) for i, host in enumerate(tree.hosts) if host.body == mechanism.tool
    )
    back = host.rotation.T
    return body + 1, back @ (mechanism.tool_point - host.position), back @ mechanism.tool_rotation
