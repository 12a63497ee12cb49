from itertools import pairwise

import numpy as np
import pytest

from plantfit.report.decimate import envelope


@pytest.mark.parametrize("n", [1, 2, 99, 100])
def test_short_signals_keep_every_sample(n):
    assert np.array_equal(envelope(np.zeros(n), 100), np.arange(n))


@pytest.mark.parametrize("n", [101, 1000, 99_991])
def test_every_bin_keeps_its_extremes(n):
    values = np.random.default_rng(n).normal(size=n)
    points = 100
    keep = envelope(values, points)
    assert len(keep) <= points + 2
    assert np.all(np.diff(keep) > 0)
    assert keep[0] == 0
    assert keep[-1] == n - 1
    edges = np.linspace(0, n, points // 2 + 1).astype(int)
    for a, b in pairwise(edges):
        drawn = values[keep[(keep >= a) & (keep < b)]]
        assert drawn.min() == values[a:b].min()
        assert drawn.max() == values[a:b].max()


def test_a_single_spike_survives():
    values = np.zeros(100_000)
    values[54_321] = 7.0
    assert 54_321 in envelope(values, 2000)


def test_gaps_stay_gaps_and_hide_no_extreme():
    values = np.sin(np.linspace(0, 20, 10_000))
    values[3000:5000] = np.nan
    keep = envelope(values, 200)
    assert np.isnan(values[keep]).any()
    assert np.nanmax(values[keep]) == np.nanmax(values)
    assert len(envelope(np.full(1000, np.nan), 100)) <= 102


def test_shift_and_scale_change_nothing():
    values = np.random.default_rng(1).normal(size=5000)
    assert np.array_equal(envelope(values, 300), envelope(8 * values, 300))
    assert np.array_equal(envelope(values, 200), np.sort(4999 - envelope(values[::-1], 200)))
