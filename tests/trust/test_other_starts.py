"""A record that is not followed because its first measured value says nothing of the start: the verdict names it, and
the lines that it says make a fit that follows."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit as pf

TRUTH = {"beta": 0.5, "gamma": 0.2}
NOISE, START = 0.006, 0.003


def epidemic(seed, first=None, bump=0.0):
    """60 days; `first` in place of the first measured share, `bump` of a second wave that no model has."""
    t = np.arange(60.0)
    rate = lambda _, x: [-0.5 * x[0] * x[1], 0.5 * x[0] * x[1] - 0.2 * x[1]]  # noqa: E731
    y = solve_ivp(rate, (0, 59), [1 - START, START], t_eval=t, rtol=1e-8, atol=1e-10).y[1]
    y = y + bump * np.exp(-(((t - 45.0) / 4.0) ** 2)) + NOISE * np.random.default_rng(seed).standard_normal(60)
    y[0] = y[0] if first is None else first
    return pf.Recording(t, {"y": pf.Signal(y, "1")}, "city")


def fit(record, initial="y", more=()):
    model = pf.equations(
        "S' = -beta*S*I\nI' = beta*S*I - gamma*I\ny = I",
        states={"S": {"unit": "1", "initial": f"1 - {initial}"}, "I": {"unit": "1", "initial": initial}},
        outputs={"y": "1"},
        parameters={"beta": {"unit": "1/s"}, "gamma": {"unit": "1/s"}} | {name: {"unit": "1"} for name, _ in more},
    )
    return pf.fit(pf.Problem(model, record, {"beta": (0.05, 2.0), "gamma": (0.02, 1.0)} | dict(more)))


def said(answer):
    answer.diagnose()
    return [s["sentence"] for s in answer.findings["verdict"] if s["sentence"].startswith("States begin at")]


@pytest.mark.parametrize("first", [0.0, pytest.param(-0.04, marks=pytest.mark.slow)])
@pytest.mark.thorough
def test_a_first_value_that_nothing_can_begin_at_is_named_with_the_lines_that_free_it(first):
    answer = fit(epidemic(1, first))
    [sentence] = said(answer)
    assert f"({first:.3g} of y in city)" in sentence
    assert "y_first = { bounds = [" in sentence
    assert not any("forgets" in s["sentence"] for s in answer.findings["verdict"])
    low, high = (float(v) for v in sentence.split("bounds = [")[1].split("]")[0].split(", "))
    assert low < START < high
    freed = fit(epidemic(1, first), "y_first", (("y_first", (low, high)),))
    rows = {p["name"]: p for p in freed.findings["parameters"]}
    for name, true in TRUTH.items():
        assert abs(rows[name]["value"] - true) < 4 * rows[name]["standard_error"]


@pytest.mark.thorough
def test_it_is_not_named_where_the_start_is_good_or_where_something_else_is_missing():
    assert not said(fit(epidemic(2, 0.004)))
    assert not said(fit(epidemic(3, 0.0, bump=0.3)))
