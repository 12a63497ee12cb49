"""Where local searches over whole records end elsewhere than the plant, multiple shooting finds the answer."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit as pf
from plantfit.errors import Status
from plantfit.optimize.contract import RunResult
from plantfit.problem.shooting import missed
from plantfit.problem.shooting.missed import missed_answer
from plantfit.trust.finish import final_problem
from plantfit.trust.finish.final_problem import finish
from plantfit.trust.verdict.searches import search_sentences

WELL = {"d": 0.3, "a": -1.0, "b": 1.0, "g": 0.4}  # Duffing's oscillator, which falls from one well into the other
BOX = {"d": (0.0, 2.0), "a": (-3.0, 3.0), "b": (0.0, 3.0), "g": (0.0, 2.0)}


def well(seed: int, *, force: str = "a*x + b*x^3", box=BOX, noise: float = 0.05, size: float = 1.0) -> pf.Problem:
    """A record of the oscillator under a cosine, of `size` (the equations scale with it), fitted with the force."""
    t = np.arange(500) * 0.05
    u = np.cos(1.2 * t)
    p = WELL | {"b": WELL["b"] / size**2, "g": WELL["g"] * size}

    def rate(s, x):
        held = u[min(int(s / 0.05 + 1e-9), len(u) - 1)]
        return [x[1], p["g"] * held - p["d"] * x[1] - p["a"] * x[0] - p["b"] * x[0] ** 3]

    y = solve_ivp(rate, (0, t[-1]), [size, 0.0], t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.05).y[0]
    y = y + noise * size * np.random.default_rng(seed).normal(size=len(t))
    model = pf.equations(
        f"x' = v\nv' = g*u - d*v - ({force})\ny = x",
        inputs=["u"], outputs=["y"], parameters=list(box), states={"x": {"initial": size}, "v": {"initial": 0.0}},
    )  # fmt: skip
    return pf.Problem(model, pf.from_arrays({"t": t, "u": u, "y": y}), box)


@pytest.mark.thorough
def test_the_answer_is_found_and_said():
    """Of a motion half as large, so that the truth is elsewhere in the box."""
    problem = well(2, box=BOX | {"b": (0.0, 6.0)}, size=0.5)
    answer = pf.fit(problem, "least_squares", settings={"agree": 2}, seed=1)
    rows = {p["name"]: p for p in answer.findings["parameters"]}
    for name, truth in (WELL | {"b": 4.0, "g": 0.2}).items():
        assert rows[name]["status"] == "determined"
        assert abs(rows[name]["value"] - truth) < 4 * rows[name]["standard_error"]
    said = " ".join(v["sentence"] for v in answer.findings["verdict"])
    assert "Multiple shooting with 100 segments found this answer" in said
    assert "different starts" not in said
    assert "local search from where it stood" not in said
    assert answer.findings["runs"][0]["ended"] == "segments"


@pytest.mark.thorough
def test_every_run_keeps_its_own_end_but_the_best():
    problem = well(5)
    runs = [_run(k, problem, [0.017, 0.506, 0.0, 0.148], 0.18 + 1e-9 * k) for k in range(2)]
    runs[1] = replace(runs[1], x=np.array([0.999, 0.5245, 0.3178, 0.4713]))
    final, found = finish(problem, runs)
    best, other = sorted(found, key=lambda r: r.cost)
    assert best.extra["ended"] == "segments"
    assert other.extra["ended"] == "searched"
    assert best.extra["missed"] == pytest.approx(np.sqrt(other.cost / best.cost), rel=0.2)
    truth = final.space.cube(final.space.vector(WELL))
    assert best.cost < float(final.costs(truth[None])[0])


def test_an_answer_that_no_solver_can_follow_leaves_the_one_before(monkeypatch):
    """The tight solver is asked for the answer of the search, and then for that of the segments."""
    problem, confirmed, asked = well(5), final_problem._confirmed, []

    def stopped_at_the_second(made, own):
        asked.append(own.cost)
        return confirmed(made, own) if len(asked) == 1 else (made, own, "", "it ends there")

    monkeypatch.setattr(final_problem, "_confirmed", stopped_at_the_second)
    [run] = finish(problem, [_run(0, problem, [0.017, 0.506, 0.0, 0.148], 0.18)])[1]
    assert asked[1] < 0.1 * asked[0]
    assert (run.cost, run.extra["ended"]) == (pytest.approx(asked[0]), "searched")
    assert not {"refused", "missed", "segments"} & set(run.extra)


@pytest.mark.parametrize("method", ["pso", "cmaes"])
def test_populations_keep_their_own_answer(method):
    problem = well(5)
    [run] = finish(problem, [replace(_run(0, problem, [0.017, 0.506, 0.0, 0.148], 0.18), method=method)])[1]
    assert run.extra["ended"] == "searched"


@pytest.mark.thorough
def test_nothing_is_said_of_a_wrong_model():
    """Its best answer follows no better from segments."""
    problem = well(2, force="a*x", box={n: BOX[n] for n in ("d", "a", "g")})
    [run] = finish(problem, [_run(0, problem, [0.017, 0.506, 0.148], 0.18)])[1]
    assert run.extra["ended"] == "searched"
    assert "missed" not in run.extra


def test_an_answer_that_follows_is_left(monkeypatch):
    """Noise as large as the motion, and a residual that is only noise, cost no compilation."""
    monkeypatch.setattr(missed, "in_segments", None)  # not asked
    for noise in (0.05, 0.8):
        problem = well(4, noise=noise)
        assert missed_answer(problem, problem.space.cube(problem.space.vector(WELL))) is None


def test_a_linear_model_that_settles_is_not_cut(monkeypatch):
    t = np.arange(100) * 0.1
    u = np.where(np.sin(t) > 0, 1.0, -1.0)
    model = pf.equations(
        "x' = (K*u - x)/tau\ny = x", inputs=["u"], outputs=["y"], parameters=["K", "tau"], states=["x"]
    )
    problem = pf.Problem(
        model, pf.from_arrays({"t": t, "u": u, "y": np.cumsum(u)}), {"K": (0.1, 5.0), "tau": (0.1, 5.0)}
    )
    monkeypatch.setattr(missed, "in_segments", None)
    assert missed_answer(problem, np.array([0.5, 0.5])) is None


def test_the_sentence():
    [said] = search_sentences({"segments": 50, "missed": 8.84, "basin_hits": 13, "starts": 14})
    assert said["level"] == "info"
    assert said["sentence"] == (
        "Local searches over whole records ended at an RMSE 8.8 times as large. Multiple shooting with 50 segments "
        "found this answer; `shooting = 50` under [search] begins with it (docs/long-records.md)."
    )


def _run(k: int, problem: pf.Problem, z, cost: float) -> RunResult:
    return RunResult("auto", k, k, np.array(z), cost, 1e6, 0.1, Status.converged, np.array([1e6]), np.array([cost]))
