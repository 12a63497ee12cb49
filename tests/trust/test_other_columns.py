"""Columns with a wrong sign, in a wrong unit or exchanged are told by their names, and nothing is told of a model that
lacks something, nor of records that are as they say."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit as pf
from plantfit.spec import load
from plantfit.trust.diagnosis.phase import misrecorded
from plantfit.trust.finish.other_columns import Change, other_columns

DT = 0.5
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))]


def driven(seed, n=300):
    """A car on a hilly road: grade (1), force (N) and speed (m/s) with noise of 0.05 m/s."""
    rng = np.random.default_rng(seed)
    t, force = np.arange(n) * DT, np.repeat(rng.choice([200.0, 700.0, 1200.0, 2000.0], size=-(-n // 20)), 20)[:n]
    grade = 0.03 * np.sin(2 * np.pi * t / 70.0 + rng.uniform(0, 6)) * 1.5 * (0.6 + 0.4 * np.sin(2 * np.pi * t / 31.0))
    v, kept = 15.0, []
    for k in range(n):
        kept.append(v)
        rate = lambda _, y, k=k: [force[k] / 1500 - 9.81 * grade[k] - 0.12 - 3e-4 * y[0] ** 2]  # noqa: E731
        v = solve_ivp(rate, (0, DT), [v], rtol=1e-8, atol=1e-10).y[0, -1]
    return {"t": t, "F": force, "grade": grade, "v": np.array(kept) + 0.05 * rng.normal(size=n)}


def fitted(data, drag="c*abs(x)*x", clock=0, **signs):
    model = pf.equations(
        f"x' = F/m - g*grade - r - {drag}; v = x", states={"x": {"unit": "m/s", "initial": "v"}},
        inputs={"F": "N", "grade": ""}, outputs={"v": "m/s"}, constants={"g": "9.81 m/s^2"},
        parameters={"m": "kg", "r": "m/s^2"} | ({"c": "1/m"} if "c*" in drag else {}),
    )  # fmt: skip
    late = np.concatenate([np.full(clock, data["F"][0]), data["F"][: len(data["F"]) - clock]])
    seen = {k: signs.get(k, 1.0) * v for k, v in {**data, "F": late}.items() if k != "t"}
    units = {"F": "N", "grade": "", "v": "m/s"}
    record = pf.Recording(data["t"], {k: pf.Signal(v, units[k]) for k, v in seen.items()}, "road")
    bounds = {"m": (500.0, 5000.0), "r": (0.0, 1.0)} | ({"c": (0.0, 5e-3)} if "c*" in drag else {})
    return pf.fit(pf.Problem(model, record, bounds), seed=1)


def said(answer):
    answer.diagnose()
    return [s["sentence"] for s in answer.findings["verdict"] if "the model follows the record" in s["sentence"]]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("wrong", "cause", "factor"),
    [
        ({"grade": -1.0}, "With the other sign of grade the model follows", -1.0),
        ({"v": 3.6}, "With v taken as km/h in place of m/s the model follows", 1 / 3.6),
    ],
)
@pytest.mark.thorough
def test_a_wrong_sign_and_a_wrong_unit_are_told_by_name_and_the_line_mends_them(seed, wrong, cause, factor):
    data = driven(seed)
    answer = fitted(data, **wrong)
    [sentence] = said(answer)
    assert sentence.startswith(cause)
    [name] = wrong
    assert f'clean = [{{ step = "scale", signal = "{name}", factor = {factor:.10g}' in sentence
    assert "under [recording.road]" in sentence
    assert answer.findings["diagnosis"]["next"] == ""
    assert not any("else take it out" in s["sentence"] for s in answer.findings["verdict"])


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.thorough
def test_nothing_is_told_of_what_the_model_lacks_nor_of_a_late_clock_nor_of_a_good_record(seed):
    data = driven(seed)
    assert said(fitted(data)) == []
    assert said(fitted(data, drag="0")) == []
    assert said(fitted(data, clock=6)) == []


def tanks(seed, n=300):
    """Two tanks in a row under an inflow, levels in m."""
    rng = np.random.default_rng(seed)
    t, q = np.arange(n) * 2.0, np.repeat(rng.uniform(0.2, 1.0, size=-(-n // 25)), 25)[:n]
    h, kept = np.array([0.5, 1.4]), []
    for k in range(n):
        kept.append(h)
        rate = lambda _, y, k=k: [q[k] / 40 - y[0] / 60, (y[0] / 60 * 40 - y[1] * 0.2) / 25]  # noqa: E731
        h = solve_ivp(rate, (0, 2.0), h, rtol=1e-8, atol=1e-10).y[:, -1]
    return t, q, np.array(kept) + 0.01 * rng.normal(size=(n, 2))


@pytest.mark.parametrize("seed", SEEDS[:2])
@pytest.mark.thorough
def test_two_columns_that_are_exchanged_are_told(seed):
    t, q, h = tanks(seed)
    model = pf.equations(
        "h1' = q/A1 - k1*h1/A1; h2' = (k1*h1 - k2*h2)/A2; a = h1; b = h2",
        states={"h1": {"unit": "m", "initial": "a"}, "h2": {"unit": "m", "initial": "b"}}, inputs={"q": "m^3/s"},
        outputs={"a": "m", "b": "m"}, parameters={"A1": "m^2", "A2": "m^2", "k1": "m^2/s", "k2": "m^2/s"},
    )  # fmt: skip
    bounds = {"A1": (20.0, 80.0), "A2": (10.0, 60.0), "k1": (0.3, 1.5), "k2": (0.05, 0.5)}
    for swapped in (True, False):
        a, b = (1, 0) if swapped else (0, 1)
        signals = {"q": pf.Signal(q, "m^3/s"), "a": pf.Signal(h[:, a], "m"), "b": pf.Signal(h[:, b], "m")}
        told = said(pf.fit(pf.Problem(model, pf.Recording(t, signals, "rig"), bounds), seed=1))
        assert [s.startswith("With a and b exchanged the model follows the record") for s in told] == [True] * swapped


@pytest.mark.parametrize("factor", [1000.0, 1.0])
@pytest.mark.thorough
def test_a_published_reference_in_mm_is_told(factor):
    """The drive of the EMPS benchmark in its loop: 24 841 samples."""
    whole = load(Path(pf.__file__).parent / "cases" / "emps" / "closed_loop.toml").problem
    change = Change(("reference",), factor)
    answer = pf.fit(
        whole.with_recordings({n: change.of(e.recording) for n, e in whole.experiments.items()}), budget=300, seed=1
    )
    z = min(answer.runs, key=lambda r: r.cost).x
    told = [s["sentence"] for s in misrecorded(answer.problem, z)]
    if factor == 1.0:
        assert told == []
        assert other_columns(answer.problem, z) is None
        return
    [sentence] = told
    assert sentence.startswith("With reference taken as mm in place of m the model follows the record")
    assert 'clean = [{ step = "scale", signal = "reference", factor = 0.001 }] under [recording.emps]' in sentence


def test_what_is_tried_is_shown_and_can_be_stopped():
    answer = fitted(driven(0), grade=-1.0)
    best = min(answer.runs, key=lambda r: r.cost)
    heard = []
    assert other_columns(answer.problem, best.x, heard.append) is not None
    assert heard[0] == "trying columns: F"
    assert "trying columns: grade" in heard
    assert other_columns(answer.problem, best.x, stop=lambda: True) is None
