"""Placing records of unequal length into rows of chunks."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.simulate.records.schedule import PADDING, Track, make_schedule
from plantfit.simulate.simulator import Drive
from plantfit.simulate.steps.grid import delayed_pieces, sampled_pieces


def track(n, key, delays=(), dense=False, linear=False):
    """A record whose measurements are numbers of their own, with one delayed channel for each range in `delays`."""
    rng = np.random.default_rng(key)
    t = 5.0 + np.cumsum(rng.uniform(0.5, 1.5, n))
    u = rng.normal(size=n) if dense else np.where(np.arange(n) < n // 2, 0.0, 1.0)
    hold = "linear" if linear else "previous"
    value, slope = sampled_pieces(t, u, hold)
    delayed = tuple(delayed_pieces(t, u, hold, u[0]) for _ in delays)
    drive = Drive(t, (value,), (slope,), delayed, (), ())
    return Track(drive, (1e6 * (key + 1) + np.arange(n),), (rng.random(n) < 0.7,), tuple(delays))


def lengths(seed):
    rng = np.random.default_rng(seed)
    kind = seed % 4
    count = int(rng.integers(1, 40))
    if kind == 0:
        return rng.integers(1, 500, count)
    if kind == 1:
        return np.r_[5000, rng.integers(1, 80, count)]
    if kind == 2:
        return np.ceil(np.exp(rng.uniform(0.0, 8.5, count))).astype(int)
    return np.full(count, rng.integers(1, 700))


@pytest.mark.parametrize("seed", range(24))
def test_every_sample_is_placed_once_and_rows_never_mix_records(seed):
    tracks = [track(int(n), k) for k, n in enumerate(lengths(seed))]
    s = make_schedule(tracks, (False,))
    c = s.chunks
    place = np.concatenate(s.place)
    assert len(np.unique(place)) == len(place) == sum(len(k.drive.t) for k in tracks)
    # where a sample is said to be stand its measurement, its score and its time
    m, i, r = np.unravel_index(place, c.scored[0].shape)
    scored = np.concatenate([k.scored[0] for k in tracks])
    np.testing.assert_array_equal(
        c.measured[0][m, i, r], np.where(scored, np.concatenate([k.measured[0] for k in tracks]), 0.0)
    )
    np.testing.assert_array_equal(c.scored[0][m, i, r], scored)
    np.testing.assert_array_equal(c.t[m, i + 1, r], np.concatenate([k.drive.t for k in tracks]))
    assert np.sum(c.scored[0]) == np.sum(scored)
    np.testing.assert_array_equal(c.lane[m, r], np.repeat(np.arange(len(tracks)), [len(k.drive.t) for k in tracks]))


@pytest.mark.parametrize("seed", range(24))
def test_a_record_runs_through_one_row_without_a_break(seed):
    tracks = [track(int(n), k) for k, n in enumerate(lengths(seed))]
    s = make_schedule(tracks, (False,))
    for k, place in zip(tracks, s.place, strict=True):
        m, i, r = np.unravel_index(place, s.chunks.scored[0].shape)
        assert len(set(r)) == 1
        np.testing.assert_array_equal(np.diff(m * s.size + i), 1)
        assert i[0] == 0
        assert s.chunks.first[m[0], r[0]]
        assert not np.any(s.chunks.first[m[0] + 1 : m[-1] + 1, r[0]])
        # its intervals join: each begins where the one before ended, the first has length 0
        own = s.chunks.t[m[0] : m[-1] + 1, :, r[0]]
        np.testing.assert_array_equal(own[1:, 0], own[:-1, -1])
        assert own[0, 0] == own[0, 1] == k.drive.t[0]
    assert np.all(np.diff(s.chunks.t, axis=1) >= 0.0)


@pytest.mark.parametrize("seed", range(24))
def test_rows_are_filled_to_four_fifths(seed):
    n = lengths(seed)
    s = make_schedule([track(int(k), i) for i, k in enumerate(n)], (False,))
    chunks = s.rows * s.chunks.lane.shape[0]
    needed = int(np.sum(-(-n // s.size)))
    assert needed >= (1 - PADDING) * chunks
    if s.rows > 1 and len(n) > s.rows:  # one more row would waste more
        wider = make_schedule([track(int(k), i) for i, k in enumerate(n)], (False,), rows=s.rows + 1)
        assert needed < (1 - PADDING) * (s.rows + 1) * wider.chunks.lane.shape[0]


@pytest.mark.parametrize("seed", range(8))
def test_steps_of_long_records_are_filled_to_seven_tenths(seed):
    n = np.random.default_rng(seed).integers(600, 6000, 3 + seed)
    s = make_schedule([track(int(k), i) for i, k in enumerate(n)], (False,))
    assert np.sum(n) >= 0.7 * s.chunks.scored[0].size


def test_equal_records_lie_side_by_side_and_one_row_takes_all():
    tracks = [track(128, k) for k in range(6)]
    assert make_schedule(tracks, (False,)).rows == 6
    single = make_schedule(tracks, (False,), rows=1)
    assert single.rows == 1
    assert single.chunks.lane.shape == (12, 1)
    np.testing.assert_array_equal(single.chunks.lane[:, 0], np.repeat(np.arange(6), 2))


@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_windows_hold_every_late_edge_and_its_pieces(seed, dense, linear):
    rng = np.random.default_rng(seed)
    ranges = ((0.0, 12.0), (30.0, 30.0))
    tracks = [track(int(n), k, ranges, dense, linear) for k, n in enumerate(rng.integers(1, 400, 4))]
    s = make_schedule(tracks, (linear, linear, linear))
    for k, place in zip(tracks, s.place, strict=True):
        t = k.drive.t
        m, _, r = np.unravel_index(place, s.chunks.scored[0].shape)
        for channel, (low, high) in enumerate(ranges):
            pieces = k.drive.delayed[channel]
            for delay in np.unique((low, rng.uniform(low, high), high)):
                index = np.searchsorted(pieces.knots + delay, t, side="right")
                expected = pieces.value[index] + pieces.slope[index] * (t - delay - pieces.origin[index])
                own = s.chunks.knots[channel]
                for j in range(len(t)):
                    there = own.knots[m[j], :, r[j]]
                    e = int(np.searchsorted(there + delay, t[j], side="right"))
                    value, slope, origin = (a[m[j], e, r[j]] for a in (own.value, own.slope, own.origin))
                    assert value + slope * (t[j] - delay - origin) == pytest.approx(expected[j], abs=1e-12)
                    if len(there) and np.any(np.isfinite(there)):
                        assert s.chunks.window[m[j]]
    live = s.chunks.window
    assert s.windows == ("all" if live.all() else "some" if live.any() else "none")
