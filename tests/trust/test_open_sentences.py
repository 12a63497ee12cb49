"""Sentences on what is open: ranges that bounds of the search and limits cut, how many numbers are fixed, and no
advice of a budget."""

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations, fit
from plantfit.trust.verdict.agreement import agreement_sentences
from plantfit.trust.verdict.all_sentences import _combinations, _refused, _steps
from plantfit.trust.verdict.parameters import parameter_sentences

X = np.linspace(0.05, 4.0, 200)


def static(text, y, parameters):
    model = equations(text, inputs=["x"], outputs=["y"], parameters=list(parameters), name="curve")
    return fit(
        Problem(model, Recording(0.1 * np.arange(200), {"x": Signal(X), "y": Signal(y)}, "run"), parameters), seed=1
    )


@pytest.fixture(scope="module")
def total():
    y = 2.5 * X + 1.0 + 0.05 * np.random.default_rng(5).normal(size=200)
    share = Parameter((0.01, 100.0), scale="log")
    return static("y = (a + b)*x + c", y, {"a": share, "b": share, "c": Parameter((-10.0, 10.0))})


def test_a_part_of_a_sum_ends_where_the_other_one_is_nothing(total):
    """b is at least 0 by physics and at least 0.01 by the search: a is at most the sum, whatever its box."""
    rows = {p["name"]: p for p in total.findings["parameters"]}
    (known,) = total.findings["determined"]["combinations"]
    for name in ("a", "b"):
        assert (rows[name]["status"], rows[name]["open"], rows[name]["low"]) == ("weak", None, 0.0)
        assert rows[name]["high"] == pytest.approx(known["high"], rel=2e-3)


def test_numbers_that_are_fixed_are_counted(total):
    text = " ".join(s["sentence"] for s in total.findings["verdict"])
    assert "1 combination of the others is determined: a + b = " in text
    assert "In all, the data fix 2 of 3 numbers. `plantfit combine`" in text
    assert "Near the answer" not in text
    found = {**total.findings["determined"], "directions": 3}
    more = " ".join(s["sentence"] for s in parameter_sentences({**total.findings, "determined": found}))
    assert "Near the answer the data fix 3 of 3 numbers in all; the rest are neither products" in more


def test_combinations_of_all_parameters_are_not_those_of_others(total):
    found = {**total.findings["determined"], "count": 1, "directions": 1, "of": 2}
    text = " ".join(s["sentence"] for s in parameter_sentences({**total.findings, "determined": found}))
    assert "1 combination of the parameters is determined" in text


def test_no_larger_budget_is_asked_for_where_a_parameter_is_flat():
    told = {"runs": 1, "spent": 0, "spent_and_agree": 0, "ended": "cut", "symmetries": [], "answers": []}
    flat, known = (
        {"agreement": told, "parameters": [{"name": "Td", "status": s, "open": None}]} for s in ("flat", "determined")
    )
    assert "Give a larger budget" not in next(agreement_sentences(flat))["sentence"]
    assert "Give a larger budget" in next(agreement_sentences(known))["sentence"]


def test_an_interval_against_the_box_is_told_by_its_ends():
    row = {"name": "Td", "status": "flat", "index": [], "unit": "s", "value": 0.9, "standard_error": 0.23, "low": 0.46,
           "high": 1.0,
           "lower_bound": 0.1, "upper_bound": 1.0, "limits": None, "open": None}  # fmt: skip
    (said,) = parameter_sentences({"parameters": [row]})
    assert said["sentence"] == "Td is not determined: the data allow 0.46 to 1 s, of 0.1 to 1 s that was searched."


def test_many_directions_are_one_sentence():
    def said(n):
        found = [
            {"sentence": f"one {k}", "weights": {f"a{k}": 1.0, "b": -0.5}, "relative_sd": 1.0 + k} for k in range(n)
        ]
        return list(_combinations({"combinations": found}))

    assert [s["sentence"] for s in said(6)] == [f"one {k}" for k in range(6)]
    (one,) = said(7)
    assert one["level"] == "warning"
    assert one["sentence"].startswith("Along 7 directions 8 parameters can move together")
    assert "loosest by a factor of 1.1e+03 " in one["sentence"]


@pytest.mark.parametrize("zero_is_physical", [True, False])
def test_a_value_on_zero_is_not_to_be_made_negative_where_physics_forbids_it(zero_is_physical):
    """y = a x with a = -0.5 in truth and bounds from 0: only a limit of physics makes 0 the end."""
    y = -0.5 * X + 0.05 * np.random.default_rng(2).normal(size=200)
    limits = (0.0, np.inf) if zero_is_physical else (-np.inf, np.inf)
    found = static("y = a*x", y, {"a": Parameter((0.0, 5.0), limits=limits)})
    told = " ".join(s["sentence"] for s in found.findings["verdict"])
    assert "a ended on its lower bound, 0" in told
    assert "cannot be told from zero" not in told
    assert ("the data pull it below zero" in told) == zero_is_physical
    assert ("the data pull it further. Widen the bound if physics allows" in told) != zero_is_physical


@pytest.mark.parametrize("zero_is_physical", [True, False])
def test_a_value_that_noise_puts_on_zero_may_be_taken_out(zero_is_physical):
    """y = b + a x with a = 0 in truth, of which the noise makes a little less."""
    noise = np.random.default_rng(3).normal(size=200)
    y = 1.0 + 0.05 * (noise - 1.5 * (X - X.mean()) * np.abs(np.polyfit(X, noise, 1)[0]))
    limits = (0.0, np.inf) if zero_is_physical else (-np.inf, np.inf)
    found = static("y = b + a*x", y, {"a": Parameter((0.0, 5.0), limits=limits), "b": Parameter((-5.0, 5.0))})
    told = " ".join(s["sentence"] for s in found.findings["verdict"])
    assert "a ended on its lower bound, 0, and cannot be told from zero" in told
    assert "take it out of the model" in told
    assert ("or widen the bound where it may be negative" in told) != zero_is_physical


@pytest.mark.parametrize(("share", "level"), [(0.02, "good"), (0.2, "warning")])
def test_the_error_of_a_simulation_is_told_at_its_worst_and_in_the_rms(share, level):
    output = {"max_error": 0.004, "rms_error": share * 0.01, "rms_residual": 0.01, "unit": "A"}
    simulation = {"outputs": {"i": output, "exact": {**output, "rms_residual": 0.0}}, "checked_with": "scipy LSODA"}
    (said,) = _steps({"simulation": simulation, "recordings": [{"outputs": {}}]})
    assert said["level"] == level
    assert "exact to 0.004 A at worst (scipy LSODA); in the rms it is off by" in said["sentence"]
    assert (
        f"{100 * share:.2g} % of the residual: {'negligible.' if level == 'good' else 'not negligible'}"
        in said["sentence"]
    )


def test_of_a_refused_answer_nothing_is_exact_behind_where_it_could_be_followed():
    output = {"max_error": 0.004, "rms_error": 0.0002, "rms_residual": 0.01, "unit": "A"}
    simulation = {"outputs": {"i": output}, "checked_with": "scipy LSODA", "recording": "run", "refused": "x explodes"}
    found = {"simulation": {**simulation, "checked_samples": 40, "samples": 90}, "recordings": [{"outputs": {}}]}
    refused, said = _steps(found)
    assert (refused["level"], said["level"]) == ("bad", "info")
    assert "at worst over the first 40 of 90 samples, where it could be followed, (scipy LSODA)" in said["sentence"]


def test_an_artefact_of_coarse_steps_is_told_where_one_was_left_out_only(total):
    run = {"failures": 0, "evaluations": 1.0, "extra": {}}
    told = [
        list(_refused({"runs": [run, {**run, "extra": extra}]}, total.best))
        for extra in ({}, {"refused": "The answer is refused: x."})
    ]
    assert told[0] == []
    assert (
        told[1][0]["sentence"] == "A run found an answer that is an artefact of coarse steps, and it was left out: x."
    )


def test_entries_of_tables_are_counted_among_what_is_determined():
    def entry(k, status):
        return {"name": f"k[{k}]", "parameter": "k", "index": [k], "status": status, "value": 1.0,
                "standard_error": 0.1, "unit": None,
                "recording": None, "limits": None, "low": None, "high": None}  # fmt: skip

    for known in (1, 2):
        findings = {"parameters": [entry(k, "determined" if k < known else "flat") for k in range(3)]}
        said = " ".join(s["sentence"] for s in parameter_sentences(findings))
        assert (
            f"The data determine {known} of 3 parameters: {known} {'entry' if known == 1 else 'entries'} of k." in said
        )


def coasting(bounds, text, seed=1, more=0.0):
    """Sentences on what is open of a speed that falls, w' = -c0 - c2/m w^2, whose first sample is `more` too high."""
    rng = np.random.default_rng(seed)
    t, w = np.arange(160) * 0.5, np.empty(160)
    w[0] = 33.0
    for k in range(159):
        x = w[k]
        for _ in range(20):
            x -= 0.025 * (0.108 + 2.6e-4 * x**2)
        w[k + 1] = x
    y = w + rng.normal(0.0, 0.04, 160)
    y[0] += more
    model = equations(
        text, states={"w": {"initial": "w0"}}, outputs={"y": None}, parameters=[*bounds, "w0"], check=False
    )
    parameters = {n: Parameter(b, scale="log" if n == "c2" else "linear") for n, b in bounds.items()}
    problem = Problem(model, Recording(t, {"y": Signal(y)}, "r"), parameters | {"w0": Parameter((20, 50))})
    said = fit(problem, budget=2000, seed=seed).findings["verdict"]
    return [s["sentence"] for s in said if "not determined" in s["sentence"]]


@pytest.mark.parametrize("seed", [1, 2])
def test_no_end_is_said_where_a_plant_without_a_mass_is_none(seed):
    """Only c2/m is known. Refits stuck at m = 0, where the drag is infinite, and "m is at least 13.7 kg" was said."""
    bounds = {"c0": (0.01, 1.0), "c2": (0.05, 2.0), "m": (500.0, 4000.0)}
    said = coasting(bounds, "w' = -c0 - c2/m*w^2\ny = w", seed)
    assert len(said) == 2
    assert all("the data allow any value above 0." in s for s in said)


def test_an_end_that_the_data_set_is_said():
    """Of k only that what it adds has died away before the second sample is known."""
    bounds = {"c0": (0.01, 1.0), "d": (1e-4, 1e-3), "k": (2.0, 40.0)}
    [said] = coasting(bounds, "w' = -c0 - d*w^2\ny = w + 3*exp(-k*t)", seed=2, more=3.0)
    assert said.startswith("k is not determined: it is at least ")
    assert 0.5 < float(said.split("it is at least ")[1].split(",")[0]) < 20.0
