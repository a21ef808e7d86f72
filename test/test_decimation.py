"""Decimated curves keep their spikes."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from parallel_robot.analysis.thinned import INTERVALS, Curves, envelope, extremes

CURVES = arrays(float, st.integers(1, 200), elements=st.floats(-1e3, 1e3))


@given(CURVES, st.integers(1, 20))
def test_extremes_of_every_stretch_are_kept(values, intervals):
    chosen = extremes(values, intervals)
    assert (np.diff(chosen) >= 0).all() and len(chosen) == min(len(values), 2 * intervals)
    assert values[chosen].max() == values.max() and values[chosen].min() == values.min()


def test_a_spike_of_one_sample_stays():
    values = np.zeros(12_001)
    values[7_777] = -3.0
    chosen = extremes(values)
    assert 7_777 in chosen and len(chosen) == 3000


@given(CURVES)
def test_the_envelope_is_the_larger_of_two_neighbours(values):
    found = envelope(values)
    assert len(found) == len(values) and (found >= np.abs(values)).all()
    for i in range(len(values)):
        pair = np.abs(values[i - i % 2 : i - i % 2 + 2])
        assert found[i] == pair.max()


def test_the_begin_of_a_curve_that_grows_stays():
    values = np.random.default_rng(5).normal(size=(400_000, 1))
    curve = Curves()
    for k, part in enumerate(np.split(values, 40)):
        curve.add(10_000.0 * k + np.arange(10_000), part)
    assert np.histogram(curve.time, 8, (0.0, 4e5))[0].min() > INTERVALS // 8
    assert curve.values.max() == values.max() and curve.values.min() == values.min()
