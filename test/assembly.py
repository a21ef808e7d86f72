"""How the tests put a closed loop together; the only place that knows."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from parallel_robot_base import config
from parallel_robot_control import laws
from parallel_robot_control.cycle import initial_state
from parallel_robot_control.safety import SafetyParameters, limits_of
from parallel_robot_model.planar_3rrr.parameters import RobotParameters
from parallel_robot_sim import plant
from parallel_robot_sim.closed_loop import ClosedLoopRun, run
from parallel_robot_sim.disturbance import DisturbanceParameters
from parallel_robot_sim.friction import FrictionParameters
from trajectory_gen.trajectory import Reference, Trajectory


class Simulation(NamedTuple):
    """A finished run beside what it should have done."""

    out: ClosedLoopRun
    reference: Reference

    def steady_rms(self) -> float:
        """End-effector error of the second half of the run, x and y together [m]."""
        error = (self.out.pose - self.reference.pose)[len(self.out.pose) // 2 :, :2]
        return float(np.sqrt((error**2).sum(axis=1).mean()))


class Plant(NamedTuple):
    """What a step of the plant takes, in order, before state, torque and period."""

    stepping: plant.Stepping
    robot: RobotParameters
    friction: FrictionParameters
    disturbance: DisturbanceParameters


def make_plant(values: Mapping[str, Any]) -> tuple[Plant, plant.PlantState]:
    """Plant of a configuration and its state 0."""
    parameters = config.group(values, plant.PlantParameters, 'plant')
    robot = config.group(values, RobotParameters, 'true_robot')
    friction = config.group(values, FrictionParameters, 'friction')
    stepping = plant.stepping(parameters)
    disturbance = config.group(values, DisturbanceParameters, 'disturbance')
    return Plant(stepping, robot, friction, disturbance), plant.initial_state(parameters, robot)


def simulate(
    scenario: str = 'paper_circle',
    duration: float = 12.0,
    overrides: Mapping[str, Any] | None = None,
    guess: Any = None,
) -> Simulation:
    """Closed loop of a scenario over `duration` [s]."""
    values = config.resolve(scenario, overrides)
    period = values['period']
    law = laws.prepare(values['law'], values)
    reference = Trajectory.of(values).sample(np.arange(round(duration / period) + 1) * period)
    nominal = config.group(values, RobotParameters, 'robot')
    start = reference.pose[0] if guess is None else np.array(guess, dtype=float)
    parts, state = make_plant(values)
    limits = limits_of(config.group(values, SafetyParameters, 'safety'))
    out = run(
        law.update, law.gains, nominal, limits, reference,
        *parts, state, initial_state(start), law.memory, period,
    )  # fmt: skip
    return Simulation(out, reference)


def open_loop(values: Mapping[str, Any], torques: Any) -> list[plant.PlantState]:
    """States of the plant under torques held over each period, shape (N, 3)."""
    parts, state = make_plant(values)
    states = [state]
    for torque in torques:
        state = plant.step(*parts, state, torque, values['period'])
        states.append(state)
    return states
