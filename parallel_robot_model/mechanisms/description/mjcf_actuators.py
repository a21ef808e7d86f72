"""Which joints the actuators of MJCF drive, and how strong they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import optional
from parallel_robot_model.mechanisms.description.parts import Actuator, listed


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
        found.append(Actuator(name, joints[joint], _effort(mujoco, model, i)))
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
