"""Descriptions read and machines made of them, and what MuJoCo says of the same text."""

import mujoco
import numpy as np

from parallel_robot_model.mechanisms.closure_solver import FOUND, close
from parallel_robot_model.mechanisms.description.machine import machine, read
from parallel_robot_model.mechanisms.dynamics import model
from parallel_robot_model.mechanisms.tool import tool_pose
from parallel_robot_model.mechanisms.workspace import boxed


def made(text, **options):
    return machine(read(text, 'robot.xml'), **options)


class Evaluated:
    """A machine at positions of its actuated joints, home if none are given."""

    def __init__(self, machine, q=None, velocity=None):
        m, work = boxed(machine.mechanism)
        n = len(m.actuated)
        q = m.home[m.actuated] if q is None else np.asarray(q, dtype=float)
        assert close(m, work, q + 1e-6) == FOUND  # from home: it must be closed
        assert close(m, work, q) == FOUND
        self.M, self.Q = np.zeros((n, n)), np.zeros((n, n))
        self.gravity, self.pose = np.zeros(n), np.zeros(len(m.coordinate) or n)
        velocity = np.zeros(n) if velocity is None else np.asarray(velocity, dtype=float)
        model(m, work, velocity, self.M, self.Q, self.gravity)
        tool_pose(m, work, self.pose)
        self.all, self.W = work.all.copy(), work.W.copy()
        self.force = self.Q @ velocity + self.gravity


class InMujoco:
    """The tree of a text in MuJoCo, in a posture [rad or m], with rates."""

    def __init__(self, xml, qpos, qvel=None):
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self.model.dof_frictionloss[:] = 0.0  # else rows of the constraints
        self.data, nv = mujoco.MjData(self.model), self.model.nv
        self.data.qpos, self.data.qvel = qpos, np.zeros(nv) if qvel is None else qvel
        mujoco.mj_forward(self.model, self.data)
        self.M, self.force = np.zeros((nv, nv)), self.data.qfrc_bias.copy()
        for k, unit in enumerate(np.eye(nv)):
            mujoco.mj_mulM(self.model, self.data, self.M[k], unit)
        self.closures = self.data.efc_J.reshape(-1, nv).copy()

    def follow(self, actuated, held=()):
        """Rates of all joints by those of the actuated ones."""
        passive = [i for i in range(self.model.nv) if i not in {*actuated, *held}]
        W = np.zeros((self.model.nv, len(actuated)))
        W[list(actuated)] = np.eye(len(actuated))
        A = self.closures
        W[passive] = -np.linalg.lstsq(A[:, passive], A[:, list(actuated)], rcond=1e-9)[0]
        return W

    def site(self, name):
        return self.data.site(name).xpos.copy()
