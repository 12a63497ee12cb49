"""All moves of the input together: those by the sensor's noise count, against loops with noise in plain numpy."""

from dataclasses import replace

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.control.tune import OneLoop, Wishes, tuned_loop
from plantfit.control.tune.loop_scores import expected_size
from plantfit.control.tune.told import verdict
from plantfit.models.text.equations import equations

pytestmark = pytest.mark.thorough

LAG = equations(
    "y' = (K*delay(u, L) - y)/tau\nz = y", inputs={"u": "V"}, states={"y": "K"}, outputs={"z": "K"},
    parameters={"K": "K/V", "tau": "s", "L": "s"}, name="lag",
)  # fmt: skip
TRUE = {"K": 2.0, "tau": 10.0, "L": 2.0}
# without the noise's share these controllers move the input by 2.4 V, and the limit takes no part
WISHES = Wishes(5.0, 2.0, 0.2, 0.5, -10.0, 10.0, noise=0.02, travel=8.0)


def family(n, seed):
    rng = np.random.default_rng(seed)
    return OneLoop(LAG, "z", "u", {}, {k: v * np.r_[1.0, np.exp(0.03 * rng.normal(size=n))] for k, v in TRUE.items()})


@pytest.fixture(scope="module")
def design():
    return tuned_loop(family(10, 1), family(40, 2), WISHES, budget=150, seed=1)


def travel(design, gains, noise, seed):
    """Of the best fit's loop in plain numpy: PID of control.pid with all its limits far away, dead time of 4 samples,
    exact lag."""
    w, h, ahead = design.wishes, design.wishes.period, round(TRUE["L"] / design.wishes.period)
    rng, decay = np.random.default_rng(seed), np.exp(-h / TRUE["tau"])
    start, n = w.set_point - w.step, design.course.samples
    y, rest = start, start / TRUE["K"]
    past, derivative, last_e, last_y, found = [rest] * ahead, 0.0, 0.0, None, 0.0
    integral, last_u = rest - gains.Kp * (gains.b - 1) * start, rest
    for k in range(n):
        seen = y + noise * rng.normal()
        last_y = seen if last_y is None else last_y
        e = w.set_point - seen
        integral += 0.5 * h * gains.Ki * (e + last_e)
        derivative = (gains.filter_time * derivative - gains.Kd * (seen - last_y)) / (gains.filter_time + h)
        u = gains.Kp * (gains.b * w.set_point - seen) + integral + derivative
        found, last_u, last_e, last_y = found + abs(u - last_u), u, e, seen
        past.append(u)
        goal = TRUE["K"] * (past[-1 - ahead] + (w.load if k >= design.course.begin else 0.0))
        y = goal + (y - goal) * decay
    return found


def test_the_expected_size_of_a_move_with_noise():
    rng = np.random.default_rng(1)
    for move in (0.0, 0.3, -2.0):
        drawn = np.abs(move + 0.5 * rng.normal(size=400_000))
        assert float(expected_size(move, 0.5)) == pytest.approx(np.mean(drawn), rel=5e-3)
        assert float(expected_size(move, 0.0)) == pytest.approx(abs(move))


def test_travel_is_that_of_loops_with_noise(design):
    rows = [design.best, *(r for r in design.rows if r.name in ("SIMC", "AMIGO"))]
    for row in rows:
        drawn = [travel(design, row.gains, WISHES.noise, seed) for seed in range(30)]
        assert row.scores.travel == pytest.approx(np.mean(drawn), rel=0.03)
        assert row.scores.travel > 2.0 * travel(design, row.gains, 0.0, 0)


def test_the_limit_of_travel_holds_with_noise_and_is_told_with_its_unit(design):
    drawn = [travel(design, design.best.gains, WISHES.noise, seed) for seed in range(30)]
    assert design.promised
    assert np.mean(drawn) <= WISHES.travel
    told = verdict(design, {})[0].sentence
    assert "move the input by 8 V at most over step and load, with the sensor's noise" in told


def test_without_noise_travel_is_what_it_was(design):
    quiet = tuned_loop(family(4, 1), family(10, 2), replace(WISHES, noise=0.0), budget=40, seed=1)
    assert quiet.best.scores.travel == pytest.approx(travel(quiet, quiet.best.gains, 0.0, 0), rel=1e-3)
    assert "by 8 V at most over step and load;" in verdict(quiet, {})[0].sentence
    assert quiet.best.scores.iae < 0.9 * design.best.scores.iae
