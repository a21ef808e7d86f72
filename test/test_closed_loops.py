"""Runs side by side against the same runs one by one: every number has the same bits."""

import numpy as np
import pytest

from parallel_robot_base.errors import InputError
from parallel_robot_control.configuration import resolve
from parallel_robot_sim.assembly import assemble
from parallel_robot_sim.closed_loop import run
from parallel_robot_sim.closed_loops import LANES, run_side_by_side
from parallel_robot_sim.configuration import configure

SCENARIOS = {'paper_circle': 's_fotsmc', 'serial_2r_circle': 'smc'}  # smc has no memory
STEPS = 400


def experiments(scenario, count, **values):
    """Experiments whose true robots, friction and motors differ."""
    rng = np.random.default_rng(1)
    made = []
    for k in range(count):
        nominal = resolve(scenario)
        drawn = {'true_robot.m2': nominal['true_robot.m2'] * rng.uniform(0.8, 1.2)}
        drawn['friction.viscous'] = [float(rng.uniform(0.5, 5.0))] * len(nominal['joints'])
        if k == 1:  # one that is thrown out of its workspace, or into a fault
            drawn |= {'disturbance.amplitude': 500.0, 'disturbance.frequency': 1.0}
        if k == 2:  # one whose torque is limited
            drawn |= {'safety.torque_limit': 0.5}
        law = SCENARIOS[scenario]
        made.append(assemble(configure(resolve(scenario, {'law': law, **drawn, **values}))))
    return made


def leaves(value):
    """All numbers and arrays in tuples of them."""
    if isinstance(value, tuple):
        for part in value:
            yield from leaves(part)
    else:
        yield value


@pytest.mark.parametrize('scenario', SCENARIOS)
def test_runs_side_by_side_have_the_bits_of_single_ones(scenario):
    made = experiments(scenario, LANES + 3)  # the last lanes are filled up
    reference = made[0].trajectory.sample(np.arange(STEPS) * 1e-3)
    many = run_side_by_side(made, reference)
    single = [run(each.control, each.plant, reference, 1e-3) for each in made]
    for one, other in zip(single, many, strict=True):
        steps = one.steps
        assert other.steps == steps
        for name, expected in one._asdict().items():
            found = getattr(other, name)
            if type(expected) is np.ndarray:
                assert np.array_equal(found[:steps], expected[:steps], equal_nan=True), name
            elif steps == STEPS:
                for a, b in zip(leaves(expected), leaves(found), strict=True):
                    assert np.array_equal(a, b, equal_nan=True), name
    assert single[1].steps < STEPS or single[1].fault[: single[1].steps].any()
    assert single[2].acted.any() and not single[0].fault.any()


def test_a_short_record_has_the_same_positions():
    made = experiments('paper_circle', LANES)
    reference = made[0].trajectory.sample(np.arange(50) * 1e-3)
    whole = run_side_by_side(made, reference)
    short = run_side_by_side(made, reference, complete=False)
    for one, other in zip(whole, short, strict=True):
        assert np.array_equal(one.position, other.position) and not len(other.velocity)


def test_what_kernels_branch_by_must_be_the_same():
    one, other = (
        experiments('paper_circle', 1),
        experiments('paper_circle', 1, **{'plant.substeps': 2}),
    )
    reference = one[0].trajectory.sample(np.arange(5) * 1e-3)
    with pytest.raises(InputError, match='must agree'):
        run_side_by_side(one + other, reference)
