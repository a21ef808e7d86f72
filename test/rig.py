"""Controller and simulated robot in lockstep without ROS, for the tests of both together."""

from typing import NamedTuple

import numpy as np

from parallel_robot_control.configuration import configure, resolve
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_control.messages import Status, Telemetry
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator
from trajectory_gen.configuration import trajectory_of

MS = 10**6  # ns
START = 10**9  # ns
SAMPLES = 1500


class JointSample(NamedTuple):
    """Measured joints at one time."""

    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


class Answer(NamedTuple):
    """What a controller made of a state."""

    torque: np.ndarray
    telemetry: Telemetry
    status: Status


def answer_of(controller, answered):
    """The answer that a controller has just given, if it has."""
    if not answered:
        return None
    return Answer(controller.torque, controller.telemetry, controller.status)


class Rig:
    """A loop that is stepped by hand; states and references may be spoilt on their way."""

    def __init__(self, mode='wall', scenario='paper_circle', **overrides):
        keys = {key.replace('__', '.'): value for key, value in overrides.items()}
        self.values = resolve(scenario, {'time_mode': mode, **keys})
        self.controller = Controller(configure(self.values))
        self.controller.set_start(START)
        self.simulator = Simulator(configure_plant(self.values))
        self.samples = trajectory_of(self.values).sample(np.arange(SAMPLES) * 1e-3)
        self.k = 0  # index of the state that is next
        self.torques = []

    @property
    def stamp(self):
        return START + self.k * MS

    def measured(self):
        joints = self.simulator.measurement()
        return JointSample(joints.position, joints.velocity, self.simulator.state.torque)

    def reference(self, k=None):
        rows = (self.samples.position, self.samples.velocity, self.samples.acceleration)
        return JointReference(*(row[self.k if k is None else k] for row in rows))

    def ask(self, state=None, reference=None):
        """Answer of the controller to the state of now."""
        wanted = self.reference() if reference is None else reference
        self.controller.add_reference(self.stamp, wanted)
        state = self.measured() if state is None else state
        return answer_of(self.controller, self.controller.add_state(self.stamp, state))

    def step(self, state=None, reference=None):
        """One period; returns the answer to the state at its start."""
        sample = self.ask(state, reference)
        assert sample is not None and np.isfinite(sample.torque).all()
        self.torques.append(sample.torque)
        self.simulator.advance(sample.torque)
        self.k += 1
        return sample

    def run(self, steps):
        """Many periods; returns the last answer."""
        for _ in range(steps):
            sample = self.step()
        return sample

    def change(self, **changes):
        """Change parameters of the controller, as the node does."""
        keys = {key.replace('__', '.'): value for key, value in changes.items()}
        self.controller.apply(self.controller.prepare_change(keys))
