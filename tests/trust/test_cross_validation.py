"""Cross-validation by recordings against a closed form, and simulated windows against the exact solution."""

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError
from plantfit.models import equations
from plantfit.trust.validate.cross_validation import choose, leave_one_out
from plantfit.trust.validate.windows import simulate_windows


def test_left_out_mean_is_the_closed_form():
    data = {f"r{k}": v for k, v in enumerate([1.0, 2.0, 6.0, 11.0])}
    made = leave_one_out(data, lambda kept: float(np.mean(list(kept.values()))), lambda m, held: {"error": held - m})
    n, total = len(data), sum(data.values())
    for name, value in data.items():
        # of a mean, the error left out is n/(n - 1) of the residual
        assert made[name].scores["error"] == pytest.approx(n / (n - 1) * (value - total / n))
    with pytest.raises(RecordingError, match="at least two"):
        leave_one_out({"a": 1.0}, lambda kept: 0.0, lambda m, held: {})


def test_more_terms_than_the_data_carry_lose():
    rng = np.random.default_rng(4)
    data = {f"r{k}": (x, 2 * x + 0.3 * rng.standard_normal(8)) for k, x in enumerate(rng.uniform(-1, 1, (6, 8)))}

    def degree(d):
        made = leave_one_out(
            data,
            lambda kept: np.polyfit(
                np.concatenate([r[0] for r in kept.values()]), np.concatenate([r[1] for r in kept.values()]), d
            ),
            lambda p, held: {"mse": float(np.mean((np.polyval(p, held[0]) - held[1]) ** 2))},
        )
        return [v.scores["mse"] for v in made.values()]

    choice = choose({str(d): degree(d) for d in (0, 1, 9)})
    assert choice.best == "1"
    assert choice.means["9"] > choice.means["1"]
    mean, error = choice.gains["0"]
    assert mean > 3 * error > 0


def test_choice_refuses_scores_of_other_recordings():
    with pytest.raises(RecordingError, match="same recordings"):
        choose({"a": [1.0, 2.0], "b": [1.0]})


def decay():
    return equations(
        "x' = u - k*x",
        inputs={"u": ""},
        states={"x": {"unit": "", "initial": "x"}},
        outputs={"x": ""},
        parameters={"k": {}},
    )


def test_windows_begin_at_the_measured_state_on_uneven_steps():
    k = 0.7
    t = np.cumsum(0.01 * (1 + 0.5 * np.random.default_rng(0).random(1001)))
    x = np.exp(-k * t)
    r = rec.from_arrays(t, signals={"u": np.zeros_like(t), "x": x})
    made = simulate_windows(decay(), {"a": r, "b": rec.cut(r, t[0], t[500])}, {"k": 2 * k}, 0.5)
    a = made["a"]
    assert made["b"].t.shape[0] == a.t.shape[0] // 2
    assert a.t.shape[1] == round(0.5 / np.median(np.diff(t))) + 1
    np.testing.assert_array_equal(a.simulated["x"][:, 0], a.measured["x"][:, 0])
    np.testing.assert_array_equal(a.t[1:, 0], a.t[:-1, -1])
    # a wrong rate decays from the true start of every window
    np.testing.assert_allclose(
        a.simulated["x"], a.measured["x"][:, :1] * np.exp(-2 * k * (a.t - a.t[:, :1])), rtol=1e-6
    )
    assert a.rmse()["x"] == pytest.approx(np.sqrt(np.mean((a.simulated["x"] - a.measured["x"]) ** 2)))


def test_values_of_each_recording():
    t = np.arange(200) * 0.01
    r = rec.from_arrays(t, signals={"u": np.zeros_like(t), "x": np.exp(-0.7 * t)})
    made = simulate_windows(decay(), {"a": r, "b": r}, {"a": {"k": 0.7}, "b": {"k": 1.4}}, 0.5)
    assert made["a"].rmse()["x"] < 1e-7 < 1e-3 < made["b"].rmse()["x"]


@pytest.mark.parametrize("length", [0.001, 100.0, float("nan")])
def test_windows_that_do_not_fit(length):
    t = np.arange(200) * 0.01
    r = rec.from_arrays(t, signals={"u": np.zeros_like(t), "x": np.exp(-0.7 * t)})
    with pytest.raises(RecordingError, match="do not fit"):
        simulate_windows(decay(), {"a": r}, {"k": 0.7}, length)
