"""Thresholds where other parameters stand on their physical limits: against a closed form, and how often intervals
hold."""

import numpy as np
import pytest
from scipy.optimize import brentq, lsq_linear
from scipy.stats import chi2, norm

from plantfit import Parameter, Problem, Recording, Signal, equations, fit
from plantfit.trust.finish.descent import descent
from plantfit.trust.intervals.at_limits import limit_factors
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.intervals.ranges import linear_range

NORMAL = 1.959964
FAR = np.full(4, np.inf)


def factors(c, room, upper=False):
    """Of the thresholds, limits so far below (or above) each value."""
    room = np.asarray(room, dtype=float)
    least, most = (-FAR[: len(room)], room) if upper else (-room, FAR[: len(room)])
    return limit_factors(np.asarray(c), least, most, NORMAL, 1e3)


def test_nothing_near_a_limit_changes_nothing():
    c = np.array([[1.0, -0.9], [-0.9, 1.0]])
    np.testing.assert_array_equal(factors(c, [10.0, 2.0]), 1.0)
    np.testing.assert_array_equal(factors(1e8 * c, [10.0, 0.0]), 1.0)  # known to nothing, no limit is near
    np.testing.assert_array_equal(factors([[1.0, 0.0], [0.0, 1.0]], [10.0, 0.0]), 1.0)  # nothing goes along


def test_two_that_are_known_as_a_sum_have_the_mixture_of_the_closed_form():
    """In the limit of correlation -1 the ratio is chi-squared of 2 in a quarter of all cases, of 1 in two, and 0 in
    the last."""
    mixed = brentq(lambda c: 0.25 * np.exp(-c / 2) + 0.5 * chi2.sf(c, 1) - 0.05, 3.0, 6.0)
    c = np.array([[1.0, -0.99999], [-0.99999, 1.0]])
    found = factors(c, [10.0, 0.0])
    assert found[0] == pytest.approx(mixed / chi2.ppf(0.95, 1), rel=0.03)
    np.testing.assert_array_equal(found[1], 1.0)  # its partner's limit is far
    flipped = factors(c * np.array([[1, -1], [-1, 1]]), [10.0, 0.0], upper=True)
    assert flipped[0] == pytest.approx(found[0], rel=0.03)
    scaled = factors(c * np.outer([3.0, 0.01], [3.0, 0.01]), [30.0, 0.0])
    np.testing.assert_allclose(scaled, found, rtol=1e-9)


def test_the_threshold_holds_where_three_lean_on_their_limits():
    """The ratio by bounded least squares, on draws of its own: 93 % or fewer pass 3.84, 95 % the threshold."""
    c = np.full((4, 4), 0.9) + 0.1 * np.eye(4)
    c[0, 1:] *= -1
    c[1:, 0] *= -1
    w = np.linalg.inv(np.linalg.cholesky(c))
    rng, ratios = np.random.default_rng(7), []
    for y in rng.standard_normal((1500, 4)) @ np.linalg.cholesky(c).T:
        whole = lsq_linear(w, w @ y, ([-np.inf, 0, 0, 0], np.inf), method="bvls").cost
        ratios.append(2 * (lsq_linear(w[:, 1:], w @ y, (0, np.inf), method="bvls").cost - whole))
    passed = chi2.ppf(0.95, 1)
    assert np.mean(np.array(ratios) <= passed) < 0.93
    assert np.mean(np.array(ratios) <= passed * factors(c, [50.0, 0.0, 0.0, 0.0])[0]) == pytest.approx(0.95, abs=0.018)


def test_intervals_beside_a_partner_at_zero_hold():
    """y = a x + b x^2 with b = 0, which may not be negative: both ends by exact bounded least squares over many
    records."""
    x = np.linspace(0.05, 4.0, 60)
    model = equations("y = a*x + b*x^2", inputs=["x"], outputs=["y"], parameters=["a", "b"], name="curve")
    base = Problem(
        model,
        Recording(np.arange(60.0), {"x": Signal(x), "y": Signal(x)}, "run"),
        {n: Parameter((0.0, 10.0)) for n in "ab"},
    )
    held, on = 0, 0
    for seed in range(150):
        y = 2.0 * x + 0.05 * np.random.default_rng(seed).normal(size=60)
        problem = base.with_recordings({"run": Recording(np.arange(60.0), {"x": Signal(x), "y": Signal(y)}, "run")})
        local = linearise(problem, descent(problem, np.array([0.35, 0.02])).z)
        assert local.linear is not None
        found = linear_range(local.linear, 0)
        held, on = held + (found.low <= 2.0 <= found.high), on + (local.values[1] < 1e-6)
    assert 50 < on < 100
    assert held >= 150 * 0.95 - 3 * norm.isf(0.16) * np.sqrt(150 * 0.95 * 0.05)


def warmed(first: float, seed: int, unit: str, zero: float = 0.0):
    """A body that warms up from `first` (degC), told in `unit`, searched from 0 degC on."""
    t = np.arange(30.0)
    degrees = 12.0 + (first - 12.0) * np.exp(-t / 3.0) + 0.6 * np.random.default_rng(seed).normal(size=30)
    model = equations(
        "x' = (Ta - x)/tau; T = x",
        states={"x": {"unit": unit, "initial": "T0"}}, outputs={"T": unit},
        parameters={
            "T0": {"unit": unit, "bounds": (zero, zero + 30)}, "Ta": {"unit": unit, "bounds": (zero, zero + 40)},
            "tau": {"unit": "s", "bounds": (0.1, 30)},
        },
    )  # fmt: skip
    answer = fit(Problem(model, Recording(t, {"T": Signal(degrees + zero, unit)})), seed=1)
    row = next(p for p in answer.findings["parameters"] if p["name"] == "T0")
    return row, " ".join(s["sentence"] for s in answer.findings["verdict"] if "T0" in s["sentence"])


@pytest.mark.parametrize("first", [-1.0, 0.3])
@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_special_about_zero_degrees(first, seed):
    row, said = warmed(first, seed, "degC")
    assert row["low"] < first < row["high"]
    assert row["low"] < 0.0
    assert "told from zero" not in said
    assert row["limits"] == [pytest.approx(-273.15), None]


def test_the_same_in_kelvin_and_a_rise_of_temperature():
    found, told = warmed(0.3, 0, "K", 273.15)
    row, _ = warmed(0.3, 0, "degC")
    assert found["low"] - 273.15 == pytest.approx(row["low"], abs=0.05)
    assert found["limits"] == [0.0, None]
    assert "told from zero" not in told
    rise, said = warmed(0.3, 0, "delta_degC")  # nothing is less than no rise, unless the user says so
    assert rise["low"] == 0.0
    assert "told from zero" in said
