"""Compile the kernels of all laws for all robots into the cache, before the tests.

The workers of the tests then load them. A worker that had compiled all of them would hold 2 GB.
Where it was done before, nothing is done: a note lies beside the kernels of these sources.

Usage: python test/warm.py
"""

import hashlib
import multiprocessing
from pathlib import Path

from parallel_robot.studies.calm import least_error
from parallel_robot_control.configuration import resolve
from parallel_robot_control.controller import Controller
from parallel_robot_control.laws import LAWS
from parallel_robot_model.processes import cache_directory
from parallel_robot_sim.configuration import configure
from parallel_robot_sim.ideal_torque import torque_of
from parallel_robot_sim.plant_run import Simulator
from parallel_robot_sim.simulation import simulate
from trajectory_gen.configuration import motions_of

NOTE = 'warm_for_tests'
SCENARIOS = ('paper_circle', 'axes_step', 'serial_2r_circle')  # one of each robot
MACHINE = 'five_bar_circle'  # of all machines that are described
MACHINES = ('hexapod_circle', 'delta_circle')  # of those with as many joints


def of_nodes(scenario):
    """The kernels of the nodes for a robot."""
    values = resolve(scenario)
    whole = configure(values)
    Controller(whole)
    Simulator(whole).warm()
    motions_of(values).load_kernels()


def of_the_analysis(scenario):
    """The kernels of the limit and of the ideal torque of a robot."""
    whole = configure(resolve(scenario, {'duration': 0.1}))
    least_error(whole)
    torque_of(whole)


def of_simulations(scenario, law):
    """The kernels of simulations of a law on a robot."""
    simulate(configure(resolve(scenario, {'law': law, 'duration': 0.01})))


def of_a_machine(scenario):
    """All kernels of a machine, one after the other: two processes would compile the same."""
    of_nodes(scenario)
    of_simulations(scenario, 's_fotsmc')
    of_the_analysis(scenario)


def main():
    """Compile with two processes, which are replaced before they grow."""
    version = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    if cache_directory.marked(NOTE) == version:
        return
    with multiprocessing.get_context('spawn').Pool(2, maxtasksperchild=8) as pool:
        jobs = [pool.apply_async(of_a_machine, (MACHINE,))]
        jobs += [pool.apply_async(of_nodes, (scenario,)) for scenario in SCENARIOS]
        jobs += [pool.apply_async(of_the_analysis, (scenario,)) for scenario in SCENARIOS]
        for scenario in SCENARIOS:
            jobs += [pool.apply_async(of_simulations, (scenario, law)) for law in LAWS]
        jobs[0].get()
        jobs += [pool.apply_async(of_a_machine, (scenario,)) for scenario in MACHINES]
        for job in jobs:
            job.get()
    cache_directory.mark(NOTE, version)


if __name__ == '__main__':
    main()
