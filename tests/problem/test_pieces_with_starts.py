"""Pieces with starts of their own: against scipy, and on a chaotic record that no simulation follows from end to
end."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import plantfit as pf
from plantfit import spec
from plantfit.errors import RecordingError
from plantfit.fitting import estimate_at
from plantfit.models.extensions import with_extensions
from plantfit.optimize import minimise
from plantfit.recording import pieces
from plantfit.study import objective_of

DECAY = pf.equations(
    "x' = -a*x + u",
    inputs=["u"],
    states={"x": {"initial": 2.0}},
    outputs=["x"],
    parameters={"a": {"bounds": (0.1, 5.0)}},
    name="decay",
)


def decay_record(n=241, a=0.8):
    t = np.linspace(0.0, 6.0, n)
    y = 3.0 * np.exp(-a * t) + 0.02 * np.random.default_rng(0).normal(size=n)
    return pf.from_arrays(t, signals={"u": np.zeros(n), "x": y})


def test_pieces_part_the_samples():
    record = decay_record()
    parts = pieces(record, 2.0)
    assert [p.name for p in parts] == [f"{record.name}-{k}" for k in (1, 2, 3)]
    assert [len(p) for p in parts] == [80, 80, 81]
    assert np.array_equal(np.concatenate([p["x"] for p in parts]), record["x"])
    assert len(pieces(record, 70.0)) == 1
    for seconds in (0.02, 0.0, -1.0, np.nan):
        with pytest.raises(RecordingError, match="give a longer time"):
            pieces(record, seconds)


def test_a_gap_leaves_no_piece_without_samples():
    t = np.r_[np.linspace(0, 1, 50), np.linspace(9, 10, 50)]
    with pytest.raises(RecordingError, match="piece 2 of 10, up to 2 s, has 1 of the 2 samples"):
        pieces(pf.from_arrays(t, signals={"x": t}), 1.0)


def test_values_and_errors_with_free_starts_are_those_of_scipy():
    parts = pieces(decay_record(), 2.0)
    model = with_extensions(DECAY, {"start": {"x": (-5.0, 5.0)}})
    start = {"start_x": pf.Parameter((-5.0, 5.0), per_recording=True)}
    problem = pf.Problem(model, {p.name: p for p in parts}, start, stepper="rk4", substeps=4)
    best = minimise(
        objective_of(problem, np.full((1, 4), 0.4)), "least_squares", runs=1, budget=500, seed=0, settings={"agree": 1}
    )[0]
    estimate = estimate_at(problem, best.x, ["a"])

    def residuals(v):
        return np.concatenate(
            [x0 * np.exp(-v[0] * (p.t - p.t[0])) - p["x"] for x0, p in zip(v[1:], parts, strict=True)]
        )

    other = least_squares(residuals, np.ones(4))
    covariance = np.linalg.inv(other.jac.T @ other.jac) * 2 * other.cost / (241 - 4)
    assert estimate.values[0] == pytest.approx(other.x[0], rel=1e-5)
    assert estimate.standard_error[0] == pytest.approx(np.sqrt(covariance[0, 0]), rel=0.15)


WELL = """name = "well"
[recording.run]
file = "run.csv"
{pieces}
[model]
equations = "x' = v\\nv' = b*x - c*x^3 - d*v + u\\ny = x"
inputs = ["u"]
states = ["x", "v"]
outputs = ["y"]
{starts}
[parameters.b]
bounds = [0.1, 10]
[parameters.c]
bounds = [0.1, 10]
[parameters.d]
bounds = [0.01, 1]
{search}
"""
STARTS = """[model.extensions]
start = { x = [-3, 3], v = [-3, 3] }
[parameters]
start_x = { per_recording = true }
start_v = { per_recording = true }
"""
TRUTH = {"b": 1.0, "c": 1.0, "d": 0.3}


@pytest.fixture(scope="module")
def well(tmp_path_factory):
    """A double well driven into chaos (Holmes, Phil. Trans. R. Soc. A 292 (1979) 419), with noise; v is not
    measured."""
    folder, t, noise = tmp_path_factory.mktemp("well"), np.arange(0, 80, 0.1), 0.01
    u = np.round(0.5 * np.cos(1.2 * t), 4)
    x, rows = np.array([1.0, 0.0]), []
    for now in u:
        rows.append(x[0])
        x = solve_ivp(
            lambda s, x, now=now: [x[1], x[0] - x[0] ** 3 - 0.3 * x[1] + now], (0, 0.1), x, rtol=1e-10, atol=1e-12
        ).y[:, -1]
    y = np.array(rows) + noise * np.random.default_rng(2).normal(size=len(t))
    np.savetxt(folder / "run.csv", np.c_[t, u, y], delimiter=",", header="t [s],u,y", comments="")

    def study(**parts):
        file = folder / f"{'-'.join(parts) or 'whole'}.toml"
        file.write_text(WELL.format(**{"pieces": "", "starts": "", "search": ""} | parts), "utf-8")
        return file

    return study


@pytest.mark.slow
def test_a_chaotic_record_is_fitted_in_pieces(well):
    study = spec.load(well(pieces="pieces = 10", starts=STARTS, search="[search]\nshooting = 5"))
    assert study.plan.methods == ("least_squares",)
    answer = pf.fit(study.problem, shooting=5, seed=1)
    rows = {p["name"]: p for p in answer.findings["parameters"] if p["name"] in TRUTH}
    for name, truth in TRUTH.items():
        assert rows[name]["status"] == "determined"
        assert abs(rows[name]["value"] - truth) < 4 * rows[name]["standard_error"]
        assert rows[name]["standard_error"] < 0.02 * truth
    assert not answer.findings["simulation"]["forgets"]
    assert all("forgets" not in s["sentence"] for s in answer.findings["verdict"])


@pytest.mark.thorough
def test_in_one_piece_it_is_told_with_the_lines_to_write_and_not_diagnosed(well):
    answer = pf.fit(spec.load(well()).problem, budget=400, seed=1)
    said = [s["sentence"] for s in answer.findings["verdict"]]
    assert any("forgets its start" in s and "under [recording.run]" in s for s in said)
    useless = (
        "`shooting = 100`",
        "give a larger",
        "Give a larger",
        "first add what",
        "systematic",
        "sample noise",
        "in the valley",
    )
    assert not [s for s in said if any(words in s for words in useless)]
    assert (answer.diagnose() or {})["state"] == "left"
    assert any("not tried, as the simulation forgets its start" in s["sentence"] for s in answer.findings["verdict"])


def test_a_bad_fit_of_a_plant_that_settles_is_not_told_so():
    """A lag fitted to what it cannot follow: a resonance."""
    t = np.linspace(0, 60, 1200)
    u = np.where(np.sin(0.4 * t) > 0, 1.0, -1.0)
    x, rows = np.zeros(2), []
    for now in u:
        rows.append(x[0])
        x = solve_ivp(lambda s, x, now=now: [x[1], 9 * (now - x[0]) - 0.1 * x[1]], (0, t[1]), x, rtol=1e-8).y[:, -1]
    model = pf.equations(
        "x' = (u - x)/tau\ny = x", inputs=["u"], states=["x"], outputs=["y"], parameters={"tau": {"bounds": (0.01, 10)}}
    )
    answer = pf.fit(pf.Problem(model, pf.from_arrays(t, signals={"u": u, "y": np.array(rows)})), budget=300, seed=1)
    assert answer.findings["scores"][0]["fit_percent"] < 50
    assert answer.findings["simulation"]["forgets"] == []
    assert not any("forgets" in s["sentence"] for s in answer.findings["verdict"])
