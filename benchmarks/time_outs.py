"""How far the robot goes astray when commands stay away, without ROS: what time-outs are good for.

Usage: python benchmarks/time_outs.py
"""

from __future__ import annotations

import numpy as np

from parallel_robot_control.configuration import configure
from parallel_robot_control.contract import JointReference
from parallel_robot_control.controller import Controller
from parallel_robot_model.configuration import config
from parallel_robot_sim.configuration import configure_plant
from parallel_robot_sim.plant_run import Simulator
from trajectory_gen.configuration import trajectory_of

PERIOD = 1e-3  # s
START = 10**9  # ns
AFTER = 0.5  # s, simulated after the gap
EARLY = (
    0.01,
    0.03,
    0.06,
    0.1,
    0.2,
    0.3,
)  # s, when the gap begins: the robot is pulled to the path
STEADY = (2.2, 3.1, 4.3, 5.05, 6.7, 8.0)  # s, when it moves along it
TIMEOUTS = (0.05, 0.1, 0.2, 0.5)  # s
ROWS = (  # law, moments, how long the commands stay away [s]
    ('s_fotsmc', STEADY, 0.1),
    ('s_fotsmc', STEADY, 0.2),
    ('s_fotsmc', STEADY, 0.5),
    ('s_fotsmc', EARLY, 1.0),
    ('pid', EARLY, 1.0),
)


def astray(law: str, begin: float, gap: float, timeout: float) -> float:
    """Largest distance of the platform from the circle from the begin of a gap on [m]."""
    values = config.resolve(
        'paper_circle',
        {'law': law, 'plant.command_timeout': timeout, 'safety.reference_timeout': 10.0},
    )
    controller, simulator = Controller(configure(values)), Simulator(configure_plant(values))
    controller.set_start(START)
    first, last = round(begin / PERIOD), round((begin + gap) / PERIOD)
    count = last + round(AFTER / PERIOD)
    motion = trajectory_of(values).sample(np.arange(count + 1) * PERIOD)
    command, worst = np.zeros(3), 0.0
    for k in range(count):
        stamp, joints = START + k * round(PERIOD * 1e9), simulator.measurement()
        rows = (motion.position, motion.velocity, motion.acceleration)
        controller.add_reference(stamp, JointReference(*(row[k] for row in rows)))
        if first <= k < last:
            simulator.advance(command, arrived=False)
        else:
            measured = joints.position, joints.velocity, simulator.state.torque
            if controller.add_state(stamp, measured):
                command = controller.torque
            simulator.advance(command)
        if k >= first:
            distance = np.linalg.norm((simulator.pose - motion.pose[k + 1])[:2])
            worst = max(worst, float(distance))
    return worst


def main() -> None:
    """Print the largest distances by law, gap and time-out."""
    print('largest distance [mm] at plant.command_timeout [s]')
    print(' ' * 24 + ''.join(f'{timeout:8g}' for timeout in TIMEOUTS))
    for law, moments, gap in ROWS:
        row = [max(astray(law, at, gap, timeout) for at in moments) for timeout in TIMEOUTS]
        when = 'start' if moments is EARLY else 'circle'
        head = f'{law}, {when}, {gap:g} s'
        print(f'{head:<24}' + ''.join(f'{worst * 1e3:8.1f}' for worst in row), flush=True)


if __name__ == '__main__':
    main()
