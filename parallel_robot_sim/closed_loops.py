"""Many closed loops at once: runs side by side in one compiled loop, the same to the bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from parallel_robot_compiler import Boxed, FirstClass, lane_of, side_by_side, vector
from parallel_robot_control import kalman
from parallel_robot_control.contract import Feedback, JointReference
from parallel_robot_control.cycle import ControlSetup, cycle_of
from parallel_robot_model.contract import Model
from parallel_robot_sim.assembly import Experiment
from parallel_robot_sim.closed_loop import ClosedLoopRun, LoopState, compiled_loop
from parallel_robot_sim.plant import PlantSetup, step
from trajectory_gen.trajectory import Reference

LANES = 8  # runs in one loop: registers of 512 bits, or two of 256


def run_side_by_side(
    experiments: Sequence[Experiment], reference: Reference, complete: bool = True
) -> list[ClosedLoopRun]:
    """Run loops with the same law, robot and reference, LANES at a time.

    Gains, parameters of the robots, loads and initial states may differ, but nothing by which the
    kernels branch: no integers, no texts.

    Args:
        experiments: The loops before their first sample.
        reference: Desired motion of all of them, one sample per period.
        complete: Whether the records are to be complete; else they have the positions, efforts,
            faults and limits.

    Raises:
        InputError: they differ in what must be the same.
    """
    runs: list[ClosedLoopRun] = []
    for first in range(0, len(experiments), LANES):
        part = list(experiments[first : first + LANES])
        filled = part + [part[-1]] * (LANES - len(part))
        result = _run(filled, reference, complete)
        runs.extend(_lane(result, i) for i in range(len(part)))
    return runs


def _run(experiments: Sequence[Experiment], reference: Reference, complete: bool) -> ClosedLoopRun:
    """Run exactly LANES loops; the lanes are the last axis of each array."""
    period = experiments[0].loop.period
    controls = [experiment.control for experiment in experiments]
    plants = [experiment.plant for experiment in experiments]
    begin = LoopState(
        side_by_side([plant.state._replace(time=0) for plant in plants])._replace(time=0.0),
        side_by_side([control.state for control in controls], integers=True),
        side_by_side([control.law.memory for control in controls], integers=True),
    )
    row, pose = begin.plant.torque, begin.cycle.pose
    target = vector(reference.position[0])  # the same in all lanes
    motion, known = JointReference(target, target, target), JointReference(row, row, row)
    # 1. The controllers: law and estimate, compiled for lanes.
    gains = side_by_side([control.setup.gains for control in controls])
    robot = side_by_side([control.setup.robot for control in controls])
    limits = side_by_side([control.setup.limits for control in controls])
    setup = controls[0].setup
    estimate = FirstClass(setup.estimate.function, robot, limits.margins, row, row, pose)
    matrix = side_by_side([vector(np.eye(len(target)))] * LANES)
    feedback = Feedback(row, row, row, row)
    model = Model(matrix, matrix, row)
    update = FirstClass(setup.update.function, gains, model, known, feedback, begin.memory, period)
    estimators = [control.setup.estimator.value for control in controls]
    alike = [each._replace(kalman=each.kalman._replace(memory=0)) for each in estimators]
    estimator = side_by_side(alike)
    filter_ = estimator.kalman._replace(memory=kalman.memory(row))
    approach = side_by_side([control.setup.approach for control in controls])
    control = ControlSetup(
        update, estimate, gains, robot, limits, Boxed(estimator._replace(kalman=filter_)), approach
    )
    # 2. The plants.
    setup_of = [plant.setup for plant in plants]
    true = side_by_side([each.robot for each in setup_of])
    load = side_by_side([each.load for each in setup_of])
    differing = [each.imperfections.value for each in setup_of]
    on, depth = any(each.on for each in differing), max(each.depth for each in differing)
    ideal = [each._replace(on=on, depth=depth, memory=0, draws=0) for each in differing]
    imperfections = side_by_side(ideal).with_memory(row)
    coordinates, rate = begin.plant.coordinates, begin.plant.rate
    plant = PlantSetup(
        FirstClass(setup_of[0].acceleration.function, true, load, coordinates, rate, row, period),
        FirstClass(setup_of[0].measure.function, true, coordinates, rate),
        side_by_side([each.stepping for each in setup_of]),
        true,
        load,
        Boxed(imperfections),
    )
    # 3. The loop.
    result: ClosedLoopRun = compiled_loop(
        cycle_of(control, begin.cycle, begin.memory, motion, imperfections.age),
        FirstClass(step, plant, begin.plant, row, period),
        control,
        plant,
        reference,
        begin,
        target,
        complete,
        period,
    )
    return result


def _lane(result: ClosedLoopRun, lane: int) -> ClosedLoopRun:
    """One run of the lanes."""
    rows = {
        name: np.ascontiguousarray(values[..., lane])
        for name, values in result._asdict().items()
        if type(values) is np.ndarray and values.shape[-1] == LANES
    }
    return result._replace(
        **rows,
        steps=lane_of(result.steps, lane),
        plant=lane_of(result.plant, lane),
        cycle=lane_of(result.cycle, lane),
        memory=lane_of(result.memory, lane),
    )
