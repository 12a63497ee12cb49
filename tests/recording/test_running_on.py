"""Counters of boards that run over, and clocks that begin anew."""

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import ClockError, RecordingError


def _file(tmp_path, times, header="t"):
    path = tmp_path / "board.csv"
    path.write_text(f"{header},u,y\n" + "".join(f"{t},{k % 7},{k}.5\n" for k, t in enumerate(times)))
    return path


@pytest.mark.parametrize(
    ("header", "unit", "span", "signed"),
    [
        ("millis", 1e-3, 2**32, False),
        ("millis", 1e-3, 2**32, True),
        ("t_ms", 1e-3, 2**16, False),
        ("micros", 1e-6, 2**32, False),
        ("micros", 1e-6, 2**32, True),
        ("t_us", 1e-6, 2**16, False),
    ],
)
@pytest.mark.parametrize("begin", [0.4, 0.99])
def test_a_counter_of_16_or_32_bits_runs_on(tmp_path, header, unit, span, signed, begin):
    step = span // 100 if span == 2**16 else 20_000
    rng = np.random.default_rng(1)
    true = int(span - begin * 60 * step) + step * np.arange(120) + rng.integers(0, step // 10, 120)
    true = np.delete(true, [70, 90])  # a row is lost here and there
    seen = (true + (span // 2 if signed else 0)) % span - (span // 2 if signed else 0)
    if not np.any(np.diff(seen) < 0):
        seen, true = (true - true[40]) % span, true
    r = rec.read_csv(_file(tmp_path, seen, header))
    np.testing.assert_allclose(np.diff(r.t), np.diff(true) * unit, rtol=1e-9, atol=1e-9)
    assert any("counter ran over" in line for line in r.log)


def test_seconds_of_a_day_run_on(tmp_path):
    r = rec.read_csv(_file(tmp_path, [(86000 + 10 * k) % 86400 for k in range(100)]))
    np.testing.assert_allclose(np.diff(r.t), 10.0)


@pytest.mark.parametrize(
    "times",
    [
        [0.02 * k for k in range(60)] + [0.5 + 0.02 * k for k in range(60)],  # two runs of one clock
        [90.0 + 0.02 * k for k in range(60)] + [0.02 * k for k in range(60)],  # the first was seen from 90 s on
        [0.02 * k for k in range(60)] * 3,
    ],
)
def test_runs_one_after_the_other_are_not_to_be_sorted(tmp_path, times):
    with pytest.raises(ClockError, match=r"line 62: time goes back .* begins anew .* Cut the file") as caught:
        rec.read_csv(_file(tmp_path, [f"{t:.2f}" for t in times]))
    assert caught.value.treatment == ""
    if len(times) > 150:
        assert "and at line 122" in str(caught.value)


def test_rows_out_of_order_may_be_sorted(tmp_path):
    t = np.round(0.02 * np.arange(200), 2)
    rng = np.random.default_rng(2)
    orders = {
        "newest first": t[::-1],
        "pieces in the wrong order": np.r_[t[100:], t[:100]],
        "two rows exchanged": t[np.r_[:50, 51, 50, 52:200]],
        "late rows": t[np.argsort(np.arange(200) + rng.uniform(0, 3, 200))],
        "days with a night between": np.r_[1.7e9 + 3000 + t, 1.7e9 + t],
    }
    for name, times in orders.items():
        with pytest.raises(ClockError) as caught:
            rec.read_csv(_file(tmp_path, [f"{s:.2f}" for s in times]))
        assert caught.value.treatment == "sort = true", name


def test_tables_of_two_sensors_one_below_the_other_may_be_sorted(tmp_path):
    path = tmp_path / "two.csv"
    rows = [f"{0.1 * k:.1f},{k % 5}," for k in range(40)] + [f"{0.1 * k + 0.05:.2f},,{k}" for k in range(40)]
    path.write_text("t,u,y\n" + "\n".join(rows) + "\n")
    with pytest.raises(ClockError) as caught:
        rec.read_csv(path)
    assert caught.value.treatment == "sort = true"


def test_all_lines_that_a_restart_left_are_named(tmp_path):
    path = tmp_path / "log.csv"
    body = [f"{k},{k % 3},{k}" for k in range(40)]
    path.write_text("t,u,y\n" + "\n".join([*body[:20], "Motor test", "ready", *body[20:30], "boot", *body[30:]]) + "\n")
    with pytest.raises(RecordingError, match=r"line 22: 1 cells .*\. Lines 23, 34 are so, too\.$"):
        rec.read_csv(path)
