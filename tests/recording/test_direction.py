"""A duty without sign beside the direction of its bridge."""

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError
from plantfit.recording import guess_roles


def _levels(rng, n, values, hold):
    return np.repeat(rng.choice(values, n // hold + 1), rng.permutation(np.full(n // hold + 1, hold)))[:n]


def _lag(u, tau, noise, rng):
    y, x = [], 0.0
    for value in u:
        y.append(x)
        x += (value - x) / tau
    return np.array(y) + noise * rng.standard_normal(len(u))


def _told(tmp_path, names, *columns):
    path = tmp_path / "board.csv"
    table = np.column_stack([0.02 * np.arange(len(columns[0])), *columns])
    np.savetxt(path, table, "%.6g", ",", header=",".join(("t", *names)), comments="")
    return {r.name: r for r in guess_roles(path).columns}


@pytest.mark.parametrize(("low", "high"), [(0, 1), (-1, 1), (1, 2)])
def test_the_sign_of_a_duty_is_found_in_another_column(tmp_path, low, high):
    for seed in range(12):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(300, 1500))
        duty = _levels(rng, n, np.arange(0, 256), int(rng.integers(10, 60)))
        up = _levels(rng, n, [0, 1], int(rng.integers(15, 70)))
        y = _lag(np.where(up == 1, duty, -duty), rng.uniform(2, 20), rng.uniform(0, 5), rng) * rng.choice([-1, 1])
        found = _told(tmp_path, ("pwm", "dir", "rpm"), duty, np.where(up == 1, high, low), y)
        assert found["pwm"].direction == "dir", seed
        assert found["dir"].kind == "input"
        assert found["rpm"].kind == "output"


def test_a_switch_that_adds_gates_or_does_nothing_is_no_direction(tmp_path):
    for seed in range(40):
        rng = np.random.default_rng(1000 + seed)
        n = int(rng.integers(300, 1500))
        duty = _levels(rng, n, np.arange(0, 256), int(rng.integers(10, 60)))
        on = _levels(rng, n, [0, 1], int(rng.integers(15, 70)))
        acts = [duty + rng.uniform(20, 300) * on, duty * on, duty * (1.0 - on), 1.0 * duty][seed % 4]
        y = _lag(acts, rng.uniform(2, 20), rng.uniform(0, 5), rng)
        found = _told(tmp_path, ("u", "switch", "y"), duty, on, y)
        assert not any(r.direction for r in found.values()), seed


def test_of_many_columns_switches_are_looked_at_by_name(tmp_path):
    rng = np.random.default_rng(1)
    n = 600
    two = [_levels(rng, n, [0, 1], 40) for _ in range(8)]
    other = [np.abs(np.cumsum(rng.normal(size=n))) for _ in range(8)]
    duty = _levels(rng, n, np.arange(0, 256), 30)
    y = _lag(np.where(two[3] == 1, duty, -duty), 8, 2, rng)
    for name in ("direction", "b3"):
        names = [name if k == 3 else f"b{k}" for k in range(8)] + [f"c{k}" for k in range(8)] + ["pwm", "y"]
        found = _told(tmp_path, names, *two, *other, duty, y)
        signed = {r.name: r.direction for r in found.values() if r.direction}
        assert signed == ({"pwm": "direction"} if name == "direction" else {})


def test_a_record_that_runs_one_way_alone_needs_both_levels():
    def made(way):
        return rec.from_arrays({"t": np.arange(4.0), "pwm": np.arange(4.0), "dir": np.array(way, dtype=float)})

    def signs(way, **given):
        return rec.signed(made(way), "pwm", "dir", "u", **given)["u"].tolist()

    assert signs([1, 1, 1, 1], forward=1, backward=0) == [0, 1, 2, 3]
    assert signs([0, 0, 0, 0], forward=1, backward=0) == [0, -1, -2, -3]
    assert signs([2, 1, 2, 1], backward=1) == [0, -1, 2, -3]
    assert signs([2, 1, 2, 1], backward=2) == [0, 1, -2, 3]
    with pytest.raises(RecordingError, match=r"has 1 level.*write both levels, as in forward = 1, backward = 0"):
        signs([1, 1, 1, 1])
    with pytest.raises(RecordingError, match="has 1 level"):
        signs([1, 1, 1, 1], forward=1)
    with pytest.raises(RecordingError, match="forward is 1 and backward 0, but 'dir' is 0 or 2"):
        signs([0, 2, 0, 2], forward=1, backward=0)
    with pytest.raises(RecordingError, match=r"has 3 levels.*name another signal"):
        signs([0, 1, 2, 2])
    with pytest.raises(RecordingError, match="forward and backward are both 1"):
        signs([0, 1, 1, 1], forward=1, backward=1)
