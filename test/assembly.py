"""How the tests put a closed loop together: as the suite does, with some parts changed."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from vectors import on_vectors

from parallel_robot_control import assembly as control
from parallel_robot_control.configuration import configure as configure_control
from parallel_robot_control.configuration import resolve
from parallel_robot_control.cycle import initial_state
from parallel_robot_control.prepared_law import PreparedLaw
from parallel_robot_control.safety import faults
from parallel_robot_model.robots import planar_3rrr
from parallel_robot_sim import simulation
from parallel_robot_sim.closed_loop import ClosedLoopRun, run
from parallel_robot_sim.configuration import Plant, assemble_plant, configure, configure_plant
from parallel_robot_sim.plant import PlantState, step
from trajectory_gen.trajectory import Reference

FAULTS = faults.of(planar_3rrr)


class Simulation(NamedTuple):
    """A finished run beside what it should have done."""

    out: ClosedLoopRun
    reference: Reference

    def steady_rms(self) -> float:
        """End-effector error of the second half of the run, x and y together [m]."""
        error = (self.out.pose - self.reference.pose)[len(self.out.pose) // 2 :, :2]
        return float(np.sqrt((error**2).sum(axis=1).mean()))


def make_plant(values: Mapping[str, Any]) -> Plant:
    """Plant of a configuration, at its state 0."""
    return assemble_plant(configure_plant(values))


def prepare(law: str, values: Mapping[str, Any]) -> PreparedLaw:
    """A law with the gains of a configuration."""
    return control.assemble(configure_control(values), law).law


def simulate(
    scenario: str = 'paper_circle',
    duration: float = 12.0,
    overrides: Mapping[str, Any] | None = None,
    guess: Any = None,
) -> Simulation:
    """Closed loop of a scenario over `duration` [s], its motion not checked beforehand."""
    values = resolve(scenario, {'duration': duration, **(overrides or {})})
    configuration = configure(values)
    controller = control.assemble(configuration)
    if guess is not None:
        state = initial_state(np.array(guess, dtype=float), configuration.joints)
        controller = controller._replace(state=state)
    period = configuration.loop.period
    times = np.arange(round(duration / period) + 1) * period
    reference = configuration.trajectory.sample(times)
    return Simulation(run(controller, make_plant(values), reference, period), reference)


def simulated(values: Mapping[str, Any]) -> simulation.Simulation:
    """Simulation of a resolved configuration."""
    return simulation.simulate(configure(values))


def open_loop(values: Mapping[str, Any], torques: Any) -> list[PlantState]:
    """States of the plant under torques held over each period, shape (N, n)."""
    setup, state, *_ = make_plant(values)
    states = [state]
    for torque in torques:
        state = on_vectors(step)(setup, state, torque, values['period'])
        states.append(state)
    return states
