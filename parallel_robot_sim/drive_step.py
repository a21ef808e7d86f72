"""A period of a plant whose gears are springs and whose joints stick.

With the angle a of a rotor referred to its joint q, stiffness K, damping D and play b of the gear,

    s = K (c - clip(c, -b/2, b/2)) + D dc/dt,  c = a - q;  with play, 0 in it, and it never pulls
    J d2a/dt2 = torque - s;  the robot moves as ever, with s in place of the torque.

Dry friction is that of bristles with the deflection z, which in steady motion is the one of
:mod:`parallel_robot_model.robots.joint_load`, with g = coulomb + stribeck exp(-(v / v_s)^2):

    dz/dt = v - stiffness |v| / g z,  friction = stiffness z + damping dz/dt

Rotor, robot and gear are integrated by RK4, the bristles before and after each of its steps by
half of it with the velocity at hand, exactly: of order 2 as a whole, however fast they yield.
The angle of rotors, their rates and the bristles are kept in the memory of the plant.

Source:
    Spong (1987), Modeling and Control of Elastic Joint Robots, J. Dyn. Syst. Meas. Control 109(4),
    eq. (12), (13); Nordin, Gutman (2002), Controlling mechanical systems with backlash - a survey,
    Automatica 38(10), section 2, the dead zone; Canudas de Wit, Olsson, Astrom, Lischinsky (1995),
    A new model for control of systems with friction, IEEE Trans. Autom. Control 40(3), bristles.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from parallel_robot_model.common.errors import InputError
from parallel_robot_model.common.units import Array
from parallel_robot_model.compiler import clip, internal, kernel, read_row, select, write_row
from parallel_robot_model.robots.contract import Measurement
from parallel_robot_sim.imperfections import Drive
from parallel_robot_sim.noise_and_delay import (
    BRISTLES,
    ROTOR,
    ROTOR_RATE,
    recall,
    record,
    sample_at,
)

STEP = 0.1  # rad of the fastest oscillation in an integration step: its phase is right to 1e-6
MOST = 1000  # integration steps in a period
SHORT = 1e-3  # below this exponent its series is nearer than its difference from 1


@internal
def rotors(setup: Any, joints: Measurement, sample: int) -> tuple[Array, Array]:
    """Angles of the rotors [rad] and their rates [rad/s] at a sample, each shape (n,)."""
    if sample == 0:
        return joints.position, joints.velocity
    angle = recall(setup, ROTOR, sample, joints.position)
    return angle, recall(setup, ROTOR_RATE, sample, joints.position)


@internal
def _bristles(setup: Any, joints: Measurement, sample: int) -> Array:
    """Deflection of the bristles at a sample [rad], shape (n,)."""
    if sample == 0:
        return np.zeros_like(joints.position)
    return recall(setup, BRISTLES, sample, joints.position)


@internal
def _spring(drive: Any, twist: Array, rate: Array) -> Array:
    """Torque of the gears [N m], shape (n,), at their twist [rad] and its rate [rad/s]."""
    half = 0.5 * drive.gear.backlash
    pressed = twist - clip(twist, -half, half)
    torque = drive.gear.stiffness * pressed + drive.gear.damping * rate
    pushing = select(pressed * torque > 0.0, torque, 0.0)
    return select(half > 0.0, pushing, torque)


@internal
def _slip(drive: Any, velocity: Array) -> Array:
    """Rate at which bristles yield, stiffness |v| / g [1/s], shape (n,)."""
    friction = drive.friction
    share = velocity / friction.stribeck_velocity
    held = friction.coulomb + friction.stribeck * np.exp(-share * share)
    stiffness = drive.bristles.stiffness
    return select(stiffness > 0.0, stiffness * np.abs(velocity) / held, 0.0)


@internal
def _bent(drive: Any, bristles: Array, velocity: Array, time: float) -> Array:
    """Bristles after a time [s] at a velocity, exactly: z + (v - s z) (1 - exp(-s t)) / s."""
    slip = _slip(drive, velocity)
    x = slip * time
    share = select(x > SHORT, (1.0 - np.exp(-x)) / x, 1.0 - x / 2.0 + x * x / 6.0)
    bent = bristles + share * time * (velocity - slip * bristles)
    return select(drive.bristles.stiffness > 0.0, bent, 0.0)


@kernel
def flexed(
    setup: Any,
    coordinates: Array,
    rate: Array,
    motor: Array,
    load: Array,
    time: float,
    period: float,
) -> tuple[Array, Array]:
    """Coordinates of the plant and their rates after a period, each shape (c,).

    Args:
        setup: PlantSetup with gears or bristles.
        coordinates: At the start, shape (c,).
        rate: Their derivative, shape (c,).
        motor: Torque at the rotors over the period [N m], shape (n,).
        load: Torque that opposes the joints over the period [N m], shape (n,).
        time: Start of the period, since the start of the run [s].
        period: Its length [s].
    """
    drive, sample = setup.imperfections.drive, sample_at(time, period)
    flexible = drive.gear.stiffness > 0.0
    inertia = drive.gear.rotor_inertia
    stiff, damped = drive.bristles.stiffness, drive.bristles.damping
    q, v, t, h = coordinates, rate, time, period / drive.substeps
    joints = setup.measure(setup.robot, q, v)
    angle, speed = rotors(setup, joints, sample)
    bristles = _bent(drive, _bristles(setup, joints, sample), joints.velocity, 0.5 * h)
    for k in range(drive.substeps):
        # RK4: stage by stage, with the slopes at the last one, and their weighted sum.
        slopes = v, np.zeros_like(v), speed, np.zeros_like(speed)
        q_end, v_end, angle_end, speed_end = q, v, angle, speed
        for stage in range(4):
            ahead = h * select(stage == 0, 0.0, select(stage == 3, 1.0, 0.5))
            weight = h / 6.0 * select((stage == 0) | (stage == 3), 1.0, 2.0)
            q_now, v_now = q + ahead * slopes[0], v + ahead * slopes[1]
            speed_now = speed + ahead * slopes[3]
            joints = setup.measure(setup.robot, q_now, v_now)
            twist = angle + ahead * slopes[2] - joints.position
            spring = _spring(drive, twist, speed_now - joints.velocity)
            yields = joints.velocity - _slip(drive, joints.velocity) * bristles
            given = select(flexible, spring, motor) - load - stiff * bristles - damped * yields
            a = setup.acceleration(setup.robot, setup.load, q_now, v_now, given, t + ahead)
            slopes = v_now, a, speed_now, select(flexible, (motor - spring) / inertia, 0.0)
            q_end, v_end = q_end + weight * slopes[0], v_end + weight * slopes[1]
            angle_end, speed_end = angle_end + weight * slopes[2], speed_end + weight * slopes[3]
        q, v, angle, speed, t = q_end, v_end, angle_end, speed_end, t + h
        joints = setup.measure(setup.robot, q, v)
        last = k == drive.substeps - 1
        bristles = _bent(drive, bristles, joints.velocity, select(last, 0.5, 1.0) * h)
    record(setup, ROTOR, sample + 1, select(flexible, angle, joints.position))
    record(setup, ROTOR_RATE, sample + 1, select(flexible, speed, joints.velocity))
    record(setup, BRISTLES, sample + 1, bristles)
    return q, v


@kernel
def record_braked(setup: Any, joints: Measurement, time: float, period: float) -> None:
    """Remember rotors and bristles after a period in which brakes held joints and rotors."""
    sample = sample_at(time, period)
    angle, _ = rotors(setup, joints, sample)
    record(setup, ROTOR, sample + 1, angle)
    record(setup, ROTOR_RATE, sample + 1, np.zeros_like(angle))
    record(setup, BRISTLES, sample + 1, _bristles(setup, joints, sample))


@kernel
def _mobility(setup: Any, coordinates: Array, still: Array, torque: Array) -> Array:
    """Acceleration of the joints by torques of 1 N m at rest [1/(kg m^2)], shape (n, n)."""
    joints = len(torque)
    found, pushed = np.empty((joints, joints)), np.eye(joints)
    free = setup.acceleration(setup.robot, setup.load, coordinates, still, torque, 0.0)
    for i in range(joints):
        one = torque + read_row(pushed, i, torque)
        moved = setup.acceleration(setup.robot, setup.load, coordinates, still, one, 0.0)
        write_row(found, i, setup.measure(setup.robot, coordinates, moved - free).velocity)
    return found


def with_steps(drive: Drive, setup: Any, state: Any, period: float, least: int) -> Drive:
    """A drive with as many integration steps as its oscillations need.

    Args:
        drive: The drive.
        setup: Its plant.
        state: State of the plant at the start, at rest.
        period: Of the samples [s].
        least: Requested number of steps.

    Raises:
        InputError: they are too fast.
    """
    mobility = _mobility(setup, state.coordinates, state.rate, state.torque)
    fastest = _fastest(drive, mobility)
    needed = fastest * period / STEP
    if not needed <= MOST:
        raise InputError(
            f'compliance or stiction is too stiff: {fastest:.3g} rad/s need {needed:.4g} '
            f'integration steps in a period, at most {MOST}; take less stiffness or damping, or '
            'a shorter period',
            'compliance.stiffness' if any(drive.gear.stiffness) else 'stiction.stiffness',
        )
    return drive._replace(substeps=max(least, math.ceil(needed)))


@np.errstate(over='ignore', divide='ignore', invalid='ignore')
def _fastest(drive: Drive, mobility: Array) -> float:
    """Largest eigenvalue of gears and sticking joints, linear about rest [rad/s]."""
    K, D, J = (
        np.array(each)
        for each in (drive.gear.stiffness, drive.gear.damping, drive.gear.rotor_inertia)
    )
    own, damped = np.array(drive.bristles.stiffness), np.array(drive.bristles.damping)
    zero = np.zeros_like(mobility)
    back = np.diag(np.divide(1.0, J, out=np.zeros_like(J), where=K > 0.0))
    spring, damper = (
        np.block([[np.diag(x), -np.diag(x)], [-np.diag(x), np.diag(x)]]) for x in (K, D)
    )
    n = len(K)
    spring[:n, :n] += np.diag(own)
    damper[:n, :n] += np.diag(damped)
    inverse = np.block([[mobility, zero], [zero, back]])
    motion = np.block(
        [[np.zeros((2 * n, 2 * n)), np.eye(2 * n)], [-inverse @ spring, -inverse @ damper]]
    )
    if not np.isfinite(motion).all():
        return math.inf
    return float(np.abs(np.linalg.eigvals(motion)).max())
