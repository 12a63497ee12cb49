"""What the verdict says of a parameter that the data press onto a bound."""

import numpy as np
import pytest
from scipy.signal import lfilter

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.fitting import fit
from plantfit.trust.verdict.parameters import parameter_sentences


def said(bound, low, value):
    row = {
        "name": "L", "parameter": "L", "recording": None, "index": [], "unit": "s", "value": value,
        "standard_error": 0.1,
        "lower_bound": low, "upper_bound": 5.0, "status": "at bound", "at_bound": bound,
    }  # fmt: skip
    return next(v["sentence"] for v in parameter_sentences({"parameters": [row]}) if v["sentence"].startswith("L "))


def test_a_dead_time_on_zero_cannot_be_told_from_zero():
    text = said("lower", 0.0, 0.0)
    assert text.startswith("L ended on its lower bound, 0 s, and cannot be told from zero")
    assert "pull it further" not in text


@pytest.mark.parametrize(("bound", "low", "value"), [("upper", 0.0, 5.0), ("lower", 0.5, 0.5)])
def test_other_bounds_are_pressed(bound, low, value):
    assert f"L ended on its {bound} bound, {value:g} s: the data pull it further" in said(bound, low, value)


def told(more, findings=None):
    row = {
        "name": "d", "parameter": "d", "recording": None, "index": [], "unit": "s", "value": 0.0,
        "lower_bound": 0.0, "upper_bound": 5.0, "limits": [0.0, None], "status": "at bound",
        "at_bound": "lower", "standard_error": None, **more,
    }  # fmt: skip
    rows = more.get("rows", [row])
    sentences = parameter_sentences({"parameters": rows, **(findings or {})})
    return next(v["sentence"] for v in sentences if v["sentence"].startswith("d"))


def test_what_the_data_pull_below_zero_is_not_to_be_taken_out():
    assert told({"pulled": 0.36}).endswith("something else in the model is missing or wrong. Find that, and keep it.")
    assert "clock_shift = { u = [-T, T] }" in told({"pulled": 0.36, "delays": "u"})
    assert "under [model], in place of d, tells by how much" in told({"pulled": 0.36, "delays": "u"})
    line = "clock_shift = { u = [-0.4, 0.4] }"  # a report has one range
    looks = [{"kind": "feedback", "signal": s, "write": w} for s, w in (("v", line.replace("u", "v")), ("u", line))]
    said = told({"pulled": 0.36, "delays": "u"}, {"data": looks})
    assert line in said
    assert "[-T, T]" not in said
    for calm in ({"pulled": 0.05}, {"pulled": 0.05, "delays": "u"}, {}):
        assert told(calm).endswith("cannot be told from zero: take it out of the model.")


def test_a_model_that_lacks_something_tells_nothing_of_what_may_go():
    whole = [{"recording": "run", "output": "y", "white": True, "first_correlation": 0.0, "p_value": 0.5}]
    assert "take it out" in told({}, {"residual_tests": whole})
    scores = [
        {"recording": "run", "output": "y", "part": part, "n": 200, "rmse": rmse, "fit_percent": fit, "unit": None}
        for part, rmse, fit in (("fit", 1.0, 90.0), ("validation", 6.0, 10.0))
    ]
    assert told({}, {"scores": scores}).endswith("The model lacks something: find that before you take it out.")


@pytest.mark.parametrize("many", [False, True])
def test_a_start_of_one_recording_is_not_taken_out_of_the_model(many):
    names = "abcdefg" if many else "a"
    rows = [
        {
            "name": f"d[{r}]", "parameter": "d", "recording": r, "index": [], "unit": "s", "value": 0.0,
            "lower_bound": 0.0, "upper_bound": 5.0,
            "limits": [0.0, None], "status": "at bound", "at_bound": "lower", "pulled": 0.0,
        } for r in names
    ]  # fmt: skip
    text = told({"rows": rows})
    assert text.endswith("there it may be zero.")
    assert "pull" not in text
    assert "pull it further" in told({"rows": [{**r, "pulled": 0.5} for r in rows]}) or not many


def lag(seed, shift, n=300):
    """A lag whose input was recorded so many samples late."""
    rng, t = np.random.default_rng(seed), np.arange(n) * 1.0
    u = np.repeat(rng.choice([0.0, 1.0], n // 20 + 1), 20)[:n]
    x = lfilter([0.0, 2.0 * (1 - np.exp(-1 / 15.0))], [1.0, -np.exp(-1 / 15.0)], u)
    late = np.r_[np.full(shift, u[0]), u[: n - shift]]
    record = Recording(t, {"u": Signal(late), "y": Signal(x + 0.02 * rng.normal(size=n))}, "run")
    model = equations(
        "x' = (K*delay(u, L) - x)/tau\ny = x", states={"x": {"initial": "y"}}, inputs=["u"], outputs=["y"],
        parameters={"K": None, "tau": "s", "L": "s"}, name="lag",
    )  # fmt: skip
    box = {"K": Parameter((0.0, 5.0)), "tau": Parameter((1.0, 100.0), scale="log"), "L": Parameter((0.0, 10.0))}
    return fit(Problem(model, record, box), seed=1)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_a_plant_that_moves_before_its_input_tells_of_the_clock(seed):
    late = lag(seed, 3)
    (row,) = (r for r in late.findings["parameters"] if r["name"] == "L")
    assert (row["at_bound"], row["delays"]) == ("lower", "u")
    assert row["pulled"] > 0.3
    assert "the plant moves before u does, as it is recorded" in late.verdict
    (row,) = (r for r in lag(seed, 0).findings["parameters"] if r["name"] == "L")
    assert not row["pulled"]
