"""Outliers of a calibration: named however many they are; without them its intervals hold."""

from dataclasses import replace

import numpy as np
import pytest
from test_calibration import Case

from parallel_robot.studies.calibration import least_squares
from parallel_robot.studies.calibration.least_squares import Sifted
from parallel_robot.studies.calibration.likely_cause import likely_cause
from parallel_robot_model.common.errors import BagError


@pytest.fixture(scope='module')
def arm():
    return Case('serial_2r_circle', 200)


@pytest.fixture(scope='module')
def parallel():
    return Case('paper_circle', 40)


def far(rng, pose, rows, noise):
    """Twenty standard deviations of a tracker, either way."""
    pose[rows] += 20.0 * noise * rng.choice([-1.0, 1.0], (len(rows), len(noise)))


def aside(rng, pose, rows, noise):
    """All in the same direction, as of another target."""
    pose[rows] += 200.0 * noise


def flying(rng, pose, rows, noise):
    pose[rows, :2] += 10.0 * rng.normal(size=(len(rows), 2))


def lost(rng, pose, rows, noise):
    pose[rows] = 0.0


def held(rng, pose, rows, noise):
    pose[rows] = pose[rows - 1]


def swapped(rng, pose, rows, noise):
    pose[rows] = pose[np.roll(rows, 1)]


def spoiled(case, pose, share, spoil, seed=0):
    """Poses with a share of outliers, which are not next to each other, and their rows."""
    rng, pose = np.random.default_rng(seed), pose.copy()
    rows = 2 * rng.choice(len(pose) // 2, round(share * len(pose)), replace=False) + 1
    spoil(rng, pose, rows, case.noise)
    return pose, {*rows.tolist()}


def named(found):
    """Rows of what is named, by the times that the case gives them."""
    return {round((each.time - 0.5) / 10.0) for each in found.outliers}


@pytest.mark.parametrize('share', [0.01, 0.05, 0.2])
@pytest.mark.parametrize('spoil', [far, aside, lost, held, swapped])
def test_outliers_are_named_and_no_other_pose_is(arm, spoil, share):
    for seed in range(3):
        truth, pose = arm.measured(seed, 1e-3, 2e-3)
        pose, rows = spoiled(arm, pose, share, spoil, seed)
        found, tried = least_squares.search(arm.model(pose))
        assert named(found) == rows and tried.agreeing == tried.tried == 1
        assert len(found.used.nominal) == len(pose) - len(rows)
        off = np.abs(found.found.values[:-1] - truth)
        assert (off < 2.0 * found.found.half_widths[:-1]).all()
        for each in found.outliers:  # by how much, beside the true robot
            assert np.abs(each.off / arm.noise).max() == pytest.approx(each.share.max(), rel=0.3)


@pytest.mark.parametrize('spoil', [far, lost, swapped])
def test_outliers_of_a_parallel_robot_are_named(parallel, spoil):
    truth, pose = parallel.measured(3, 1e-3, 2e-3)
    pose, rows = spoiled(parallel, pose, 0.2, spoil)
    found, _ = least_squares.search(parallel.model(pose))
    assert named(found) == rows
    off = np.abs(found.found.values[:-1] - truth)
    assert (off < 2.0 * found.found.half_widths[:-1]).all()


@pytest.mark.parametrize('free', [('frame',), ('frame', 'target')])
@pytest.mark.parametrize('spoil', [flying, lost, held])
def test_a_tracker_somewhere_is_found_beside_outliers(parallel, free, spoil):
    """Its place is estimated first, which they must not move."""
    _, pose = parallel.measured(1, 1e-3, 2e-3)
    seen = np.exp(2.5j) * (pose[:, 0] + 1j * pose[:, 1]) + 0.4 - 0.3j
    pose = np.column_stack([seen.real, seen.imag, pose[:, 2] + 2.5])
    pose, rows = spoiled(parallel, pose, 0.2, spoil)
    model = parallel.model(pose, free=free)
    found, _ = least_squares.search(model)
    assert likely_cause(model, free) is None
    assert named(found) == rows and found.found.noise[0] < 1.5e-5


@pytest.mark.parametrize(
    ('change', 'cause'),
    [
        (lambda pose: pose * [1e3, 1e3, 1.0], 'lengths in mm'),
        (lambda pose: np.add(pose, [5.0, 0.0, 0.0]), 'another frame (--free frame)'),
        (lambda pose: pose * [1.0, -1.0, 1.0], 'y with the other sign (mirrored?)'),
    ],
)
def test_a_cause_of_most_poses_is_named_beside_outliers_and_that_of_a_few_is_not(
    parallel, change, cause
):
    pose, _ = spoiled(parallel, change(parallel.pose), 0.2, lost)
    assert likely_cause(parallel.model(pose), ()) == (cause, True)
    few, rows = parallel.pose.copy(), np.arange(0, 40, 5)
    few[rows] = change(few)[rows]
    assert likely_cause(parallel.model(few), ()) is None
    assert named(least_squares.search(parallel.model(few))[0]) == {*rows.tolist()}


def test_clean_poses_are_hardly_ever_named_and_the_estimate_is_that_of_least_squares(arm):
    alarms = 0
    for seed in range(60):
        _, pose = arm.measured(seed, 1e-3, 2e-3)
        found, _ = least_squares.search(arm.model(pose))
        alarms += bool(found.outliers)
        if not found.outliers:
            plain = least_squares.fit(arm.model(pose))
            np.testing.assert_allclose(found.found.values, plain.values, rtol=0.0, atol=1e-9)
            np.testing.assert_allclose(found.found.half_widths, plain.half_widths, rtol=1e-5)
    assert alarms <= 2


def test_intervals_hold_with_outliers_and_are_hardly_wider(arm):
    inside, wider = [], []
    for seed in range(100):
        truth, pose = arm.measured(seed, 1e-3, 2e-3)
        clean = least_squares.fit(arm.model(pose))
        pose, _ = spoiled(arm, pose, 0.05, far, seed)
        found = least_squares.search(arm.model(pose))[0].found
        inside += (np.abs(found.values - np.append(truth, 0.0)) <= found.half_widths)[:-1].tolist()
        wider.append(found.half_widths[:-1] / clean.half_widths[:-1])
    assert 0.92 <= np.mean(inside) <= 0.98
    assert np.mean(wider) < 1.05


def test_few_poses_are_not_called_outliers(parallel):
    """Fourteen of three numbers, for sixteen unknown: the noise is hardly known."""
    few = Case('paper_circle', 14)
    for seed in range(5):
        _, pose = few.measured(seed, 1e-3, 2e-3)
        assert not least_squares.search(few.model(pose))[0].outliers


def test_where_much_is_left_more_starts_are_tried_and_agree(arm):
    """A bad tracker, of 3 mm of noise: twice the same."""
    _, pose = arm.measured(1, noise=300.0)
    found, tried = least_squares.search(arm.model(pose))
    assert not found.outliers and tried == (least_squares.STARTS, least_squares.STARTS, 0)
    again, _ = least_squares.search(arm.model(pose))
    assert np.array_equal(again.found.values, found.found.values)


def test_one_answer_of_several_starts_is_the_best(arm, monkeypatch):
    """One does not end, two are where the robot is, one is near it and as good, one is not."""
    _, pose = arm.measured(1, 1e-3, 2e-3)
    model = arm.model(pose)
    best, longer = least_squares.fit(model), np.eye(5)[0]
    others = [best.values + far * longer for far in (1e-9, 3e-6, 1e-3)]
    ends, begun = iter([None, others[0], best.values, *others[1:]]), []

    def sifted(model, start):
        begun.append(start)
        values = next(ends)
        if values is None:
            raise BagError('least squares do not end')
        return Sifted(model, replace(best, values=values), ())

    monkeypatch.setattr(least_squares, 'sifted', sifted)
    found, tried = least_squares.search(model)
    np.testing.assert_allclose(found.found.values, best.values, atol=2e-9)
    assert tried == (5, 2, 1)
    assert np.array_equal(begun[0], model.start)
    apart = np.abs(np.array(begun[1:]) - model.start)
    assert 0.0 < apart[:, :4].max() < 0.05  # of lengths in m and zero angles in rad
