"""The whole way: a simulated motor is found again, and the verdict says what is true of it."""

import functools
import json
from dataclasses import replace

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError, Status
from plantfit.findings import Findings
from plantfit.fitting import Answer, fit
from plantfit.models import dc_motor
from plantfit.models.model import Declared, Model
from plantfit.optimize.contract import RunResult
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.simulate import Simulator

TRUTH = {"Rm": 2.0, "Lm": 2e-3, "Kb": 0.05, "Jm": 2e-5, "Cm": 1e-5, "Tf": 3e-3}
BOX = {"Rm": (0.2, 20.0), "Kb": (0.005, 0.5), "Jm": (1e-6, 1e-3), "Tf": (1e-4, 1e-1)}


def motor_recording(n=600) -> Recording:
    """Speed and current at 200 Hz under random voltage steps, with white noise."""
    rng = np.random.default_rng(0)
    t = 0.005 * np.arange(n)
    voltage = np.repeat(rng.uniform(-6.0, 6.0, n // 30), 30)
    simulator = Simulator.of(dc_motor(tied=True, current_output=True), substeps=32)
    drive = simulator.drive(t, {"V": voltage}, measured={"w": np.zeros(n), "i": np.zeros(n)})
    y = simulator.outputs(TRUTH, drive)
    w, i = (np.asarray(y[k]) + s * rng.normal(size=n) for k, s in (("w", 0.3), ("i", 0.02)))
    w[0] = i[0] = 0.0  # the record begins at rest
    return Recording(t, {"V": Signal(voltage, "V"), "w": Signal(w, "rad/s"), "i": Signal(i, "A")}, "motor")


@functools.cache
def answer():
    held = {"Lm": TRUTH["Lm"], "Cm": TRUTH["Cm"]}
    problem = Problem(dc_motor(tied=True, current_output=True), motor_recording(), {**BOX, **held}, split=0.7)
    return fit(problem, seed=1)


@pytest.mark.thorough
def test_parameters_lie_within_three_standard_errors():
    rows = {p["name"]: p for p in answer().findings["parameters"]}
    for name in BOX:
        p = rows[name]
        assert p["status"] == "determined", p
        assert abs(p["value"] - TRUTH[name]) <= 3.0 * p["standard_error"], p
        assert p["standard_error"] < 0.1 * TRUTH[name]
    assert rows["Lm"]["status"] == "fixed"


def test_residuals_are_the_noise_on_both_parts():
    assert answer().score("fit") == pytest.approx({"w": 0.3, "i": 0.02}, rel=0.1)
    assert answer().score("validation") == pytest.approx({"w": 0.3, "i": 0.02}, rel=0.15)


def test_findings_are_plain_json_and_complete():
    findings = answer().findings
    parsed = json.loads(json.dumps(findings))
    assert set(parsed) == set(Findings.model_fields)
    assert {"verdict", "parameters", "runs", "agreement", "determined"} < set(parsed)
    assert not parsed["combinations"]
    assert all(
        v["sentence"].rstrip().endswith(".") and v["level"] in {"good", "warning", "bad", "info"}
        for v in parsed["verdict"]
    )
    assert not [v for v in parsed["verdict"] if v["level"] == "bad"]


def test_the_same_seed_gives_the_same_bits():
    held = {"Lm": TRUTH["Lm"], "Cm": TRUTH["Cm"], "Tf": TRUTH["Tf"], "Jm": TRUTH["Jm"]}
    box = {k: BOX[k] for k in ("Rm", "Kb")}
    model = dc_motor(tied=True, current_output=True)
    one, two = (fit(Problem(model, motor_recording(150), {**box, **held}, substeps=16), seed=3) for _ in range(2))
    assert one.values == two.values
    assert one.best.cost == two.best.cost


def product() -> Model:
    return Model(
        name="product",
        states={},
        inputs={"u": None},
        outputs={"y": None},
        parameters=tuple(Declared(n, bounds=(0.1, 100.0), scale="log") for n in ("R", "K")),
        output=lambda x, u, p: {"y": p["R"] * p["K"] * u["u"]},
    )


def test_a_product_is_said_to_be_all_that_is_determined():
    rng = np.random.default_rng(0)
    u = rng.normal(size=300)
    recording = Recording(np.arange(300.0), {"u": Signal(u), "y": Signal(6.0 * u + 0.1 * rng.normal(size=300))})
    found = fit(Problem(product(), recording), seed=0)
    assert found.values["R"] * found.values["K"] == pytest.approx(6.0, rel=0.01)
    (direction,) = found.findings["combinations"]
    assert set(direction["weights"]) == {"R", "K"}
    assert direction["weights"]["R"] * direction["weights"]["K"] < 0
    assert any("R*K" in v["sentence"] or "K*R" in v["sentence"] for v in found.findings["verdict"])
    assert {p["status"] for p in found.findings["parameters"]} <= {"weak", "flat"}


def test_nothing_that_can_be_simulated_is_an_error_with_advice():
    broken = replace(product(), output=lambda x, u, p: {"y": u["u"] * p["R"] * p["K"] * np.nan})
    recording = Recording(np.arange(30.0), {"u": Signal(np.ones(30)), "y": Signal(np.ones(30))})
    with pytest.raises(SearchError, match="No candidate of any run could be simulated"):
        fit(Problem(broken, recording), budget=200)


@pytest.mark.parametrize(("position", "edge"), [(0.0, "lower"), (1.0, "upper")])
def test_a_bound_counts_only_where_the_data_press_onto_it(position, edge):
    """`a` is truly 30 % beyond its bound; `idle` has no effect and stands on a bound by chance."""
    low, high = (1.3, 3.0) if edge == "lower" else (0.1, 0.7)
    model = Model(
        name="gain",
        states={},
        inputs={"u": None},
        outputs={"y": None},
        parameters=(Declared("a", bounds=(low, high)), Declared("idle", bounds=(-1.0, 1.0))),
        output=lambda x, u, p: {"y": p["a"] * u["u"] + 1e-9 * p["idle"]},
    )
    rng = np.random.default_rng(1)
    u = rng.normal(size=200)
    recording = Recording(np.arange(200.0), {"u": Signal(u), "y": Signal(u + 0.1 * rng.normal(size=200))})
    problem = Problem(model, recording)
    z = np.full(2, position)
    run = RunResult(
        "given", 0, 0, z, float(problem.costs(z[None])[0]), 1.0, 0.0, Status.converged, np.ones(1), np.ones(1)
    )
    rows = {p["name"]: p for p in Answer(problem, [run], 0).findings["parameters"]}
    assert (rows["a"]["status"], rows["a"]["at_bound"]) == ("at bound", edge)
    assert (rows["idle"]["status"], rows["idle"]["at_bound"]) == ("flat", None)
