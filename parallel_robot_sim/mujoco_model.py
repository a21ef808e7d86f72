"""The robots of the suite in MuJoCo, made from the same parameters: an independent plant."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError, optional
from parallel_robot_model.common.units import Array
from parallel_robot_model.robots.registry import RobotModel

# Bodies that MuJoCo moves under torques.

STEP = 1e-4  # s, of the integration


class MujocoBodies:
    """A compiled model whose actuated joints are moved by torques."""

    def __init__(self, model: Any, actuated: Any) -> None:
        """Take the model.

        Args:
            model: It has a hinge or a slide for each of its freedoms.
            actuated: Indices of the actuated joints.
        """
        self._engine = optional('mujoco')
        self._model, self._actuated = model, actuated
        self._data = self._engine.MjData(model)

    def advance(self, torque: Array, period: float) -> None:
        """Hold torques [N m], shape (n,), over a period [s], a multiple of the step."""
        self._data.qfrc_applied[self._actuated] = torque
        self._step(period)

    def advance_under(self, load: Callable[[Array, float], Array], period: float) -> None:
        """Advance by a period [s], a multiple of the step, under torques that change within it.

        Args:
            load: Function of the rates of the actuated joints [rad/s], shape (n,), and the time
                since the start [s] that returns their torques [N m], shape (n,).
            period: How long.
        """

        def control(_: Any, data: Any) -> None:
            velocity = data.qvel[self._actuated]
            data.qfrc_applied[self._actuated] = load(velocity, data.time)

        self._engine.set_mjcb_control(control)  # called by the integrator at each of its stages
        try:
            self._step(period)
        finally:
            self._engine.set_mjcb_control(None)

    def _put(self, positions: Any) -> None:
        """Put all joints somewhere [rad or m]."""
        self._data.qpos = np.asarray(positions)
        self._engine.mj_forward(self._model, self._data)

    def _step(self, period: float) -> None:
        steps = round(period / self._model.opt.timestep)
        self._engine.mj_step(self._model, self._data, steps)
        self._engine.mj_kinematics(self._model, self._data)


class MujocoRobot(MujocoBodies):
    """A robot at rest, moved by torques."""

    def __init__(
        self, robot: RobotModel, pose: Array, friction_viscous: Sequence[float], step: float = STEP
    ) -> None:
        """Build the robot.

        Args:
            robot: The robot.
            pose: Pose at the start, shape (m,).
            friction_viscous: Viscous friction of the actuated joints [N m s/rad].
            step: Integration step [s].

        Raises:
            InputError: MuJoCo is not installed, or the robot is a custom one.
        """
        optional('mujoco')
        if robot.name not in BUILT:
            names = ', '.join(BUILT)
            raise InputError(f'only {names} can be built in MuJoCo, not {robot.name}')
        closed = robot.name == 'planar_3rrr'
        model = BUILT[robot.name](robot.parameters, friction_viscous, step)
        super().__init__(model, slice(3, None, 2) if closed else slice(None))
        self._tip = robot.name == 'serial_2r'
        start = robot.module.start(robot.parameters, np.asarray(pose))
        self._shown = slice(3) if closed else slice(None)
        self._put(coordinates_of(robot.parameters, pose) if closed else start)

    @property
    def pose(self) -> Array:
        """The present pose, shape (m,)."""
        if self._tip:
            return np.array(self._data.body('payload').xpos[:2])
        return np.array(self._data.qpos[self._shown])

    @property
    def motion(self) -> tuple[Array, Array]:
        """The present coordinates of the suite's plant and their derivative, each shape (c,)."""
        return self._data.qpos[self._shown], self._data.qvel[self._shown]


def planar_3rrr(robot: Any, friction_viscous: Sequence[float], step: float) -> Any:
    """The 3-RRR: three two-link legs and a platform that move in the x-y plane.

    MuJoCo knows only trees, so a stiff `connect` constraint holds the tip of each leg at its
    corner. Every link lies along +x at qpos = 0, so no frame is rotated.
    qpos = (x, y, phi, theta_1, psi_1, theta_2, psi_2, theta_3, psi_3) [m, rad].

    Args:
        robot: Parameters of the robot.
        friction_viscous: Viscous friction of the actuated joints [N m s/rad].
        step: Integration step [s].
    """
    mujoco = optional('mujoco')
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = (0, 0, 0)

    platform = _add_body(spec.worldbody, (0, 0), robot.mp, 0, robot.Ip)
    platform.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(1, 0, 0))
    platform.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 1, 0))
    platform.add_joint()  # MuJoCo's default joint: a hinge along z

    for leg, angle in enumerate(robot.platform_angle):
        base = robot.base_x[leg], robot.base_y[leg]
        proximal = _add_body(spec.worldbody, base, robot.m1, robot.lc1, robot.I1)
        proximal.add_joint(damping=friction_viscous[leg])
        distal = _add_body(proximal, (robot.l1, 0), robot.m2, robot.lc2, robot.I2)
        distal.add_joint()

        corner = robot.l3 * math.cos(angle), robot.l3 * math.sin(angle), 0
        distal.add_site(name=f'tip{leg}', pos=(robot.l2, 0, 0))
        platform.add_site(name=f'corner{leg}', pos=corner)
        spec.add_equality(
            type=mujoco.mjtEq.mjEQ_CONNECT,
            objtype=mujoco.mjtObj.mjOBJ_SITE,
            name1=f'tip{leg}',
            name2=f'corner{leg}',
            solref=(10 * step, 1),  # time constant [s], slow enough for RK4; critical damping
        )

    model: Any = spec.compile()
    model.body_invweight0[:] *= 1e-6  # constraints yield in proportion: harder than solimp allows
    return model


def _add_body(
    parent: Any, origin: tuple[float, float], mass: float, centre: float, inertia: float
) -> Any:
    """Add a body whose centre of mass lies on its own x axis [m, kg, m, kg m^2]."""
    return parent.add_body(
        pos=(*origin, 0),
        mass=mass,
        ipos=(centre, 0, 0),
        inertia=(inertia, inertia, inertia),
        explicitinertial=True,
    )


def coordinates_of(robot: Any, pose: Array) -> list[float]:
    """Return qpos of the robot at a pose."""
    return [*pose, *(angle for leg in range(3) for angle in _leg_angles(robot, pose, leg))]


def _leg_angles(robot: Any, pose: Array, leg: int) -> tuple[float, float]:
    """Return the actuated and the passive angle (theta, psi) of a leg [rad]."""
    x, y, phi = pose
    corner = phi + robot.platform_angle[leg]
    rx = x + robot.l3 * math.cos(corner) - robot.base_x[leg]
    ry = y + robot.l3 * math.sin(corner) - robot.base_y[leg]
    reach = math.hypot(rx, ry)
    cosine = (robot.l1**2 - robot.l2**2 + reach**2) / (2 * robot.l1 * reach)
    theta = math.atan2(ry, rx) + robot.working_mode[leg] * math.acos(cosine)
    beta = math.atan2(ry - robot.l1 * math.sin(theta), rx - robot.l1 * math.cos(theta))
    return theta, beta - theta


def serial_2r(robot: Any, friction_viscous: Sequence[float], step: float) -> Any:
    """The arm: hinges about z, gravity against y, the payload a body of its own."""
    first, second = friction_viscous
    xml = f"""
    <mujoco>
      <option gravity="0 {-robot.gravity} 0" timestep="{step}" integrator="RK4"/>
      <worldbody>
        <body>
          <joint axis="0 0 1" damping="{first}"/>
          <inertial pos="{robot.lc1} 0 0" mass="{robot.m1}" diaginertia="{(f'{robot.I1} ' * 3)}"/>
          <body pos="{robot.l1} 0 0">
            <joint axis="0 0 1" damping="{second}"/>
            <inertial pos="{robot.lc2} 0 0" mass="{robot.m2}"
                      diaginertia="{(f'{robot.I2} ' * 3)}"/>
            <body name="payload" pos="{robot.l2} 0 0">
              <inertial pos="0 0 0" mass="{robot.mp}" diaginertia="0 0 0"/>
            </body>
          </body>
        </body>
      </worldbody>
    </mujoco>
    """
    return optional('mujoco').MjModel.from_xml_string(xml)


def axes(robot: Any, friction_viscous: Sequence[float], step: float) -> Any:
    """The axes: hinges about z beside each other, each with its inertia."""
    mujoco = optional('mujoco')
    spec = mujoco.MjSpec()
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.gravity = (0, 0, 0)
    for number, (inertia, viscous) in enumerate(zip(robot.inertia, friction_viscous, strict=True)):
        _add_body(spec.worldbody, (number, 0), 1.0, 0.0, inertia).add_joint(damping=viscous)
    return spec.compile()


BUILT = {'planar_3rrr': planar_3rrr, 'serial_2r': serial_2r, 'axes': axes}
