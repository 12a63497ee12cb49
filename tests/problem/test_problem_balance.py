"""`balance = "recordings"`: long recordings count as short ones, in every way a cost is made."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError, SpecError
from plantfit.models import equations
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Declared
from plantfit.problem import Experiment, Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.spec import parse
from plantfit.spec.tables import validated

PARAMETERS = {"K": {"bounds": (0.5, 5.0)}, "tau": {"bounds": (0.1, 10.0), "scale": "log"}}
Z = np.array([0.3, 0.6])


def model():
    return equations(
        "x' = (K*u - x)/tau", inputs=["u"], states={"x": {"initial": 0.0}}, outputs=["x"], parameters=PARAMETERS
    )


def step(n: int, height: float, name: str) -> Recording:
    rng = np.random.default_rng(n)
    return Recording(0.1 * np.arange(n), {"u": Signal(np.full(n, height)), "x": Signal(rng.normal(size=n))}, name)


def mean_of_means(problem: Problem) -> float:
    """By the predictions alone."""
    values = problem.space.physical(Z)
    return float(
        np.mean(
            [np.mean((problem.predict(values, n)["x"] - e.recording["x"]) ** 2) for n, e in problem.experiments.items()]
        )
    )


@pytest.mark.parametrize("steady", [False, True])
@pytest.mark.further(1)
def test_cost_is_the_mean_of_the_recordings_mean_squares(steady):
    records = {
        "long": step(400, 2.0, "long"),
        "short": Experiment(step(30, -1.0, "short"), steady=steady),
        "mid": step(100, 0.5, "mid"),
    }
    problem = Problem(model(), records, balance="recordings", substeps=1)
    r, jacobian = problem.residuals_and_jacobian(Z)
    value, gradient = problem.value_and_gradient(Z)
    assert float(problem.cost(Z)) == pytest.approx(mean_of_means(problem), rel=1e-12)
    assert np.mean(r**2) == pytest.approx(mean_of_means(problem), rel=1e-12)
    assert value == pytest.approx(mean_of_means(problem), rel=1e-12)
    np.testing.assert_allclose(gradient, 2 * jacobian.T @ r / len(r), rtol=1e-9)
    numeric = [(float(problem.cost(Z + d)) - float(problem.cost(Z - d))) / 2e-6 for d in 1e-6 * np.eye(2)]
    np.testing.assert_allclose(gradient, numeric, rtol=1e-5)
    compressed = problem.compressed(Z)
    assert np.mean(compressed[0] ** 2) == pytest.approx(value, rel=1e-10)


def test_separate_recordings_keep_their_shares():
    records = {"long": step(400, 2.0, "long"), "short": step(30, -1.0, "short")}
    own = {n: Parameter(per_recording=True) for n in ("K", "tau")}
    problem = Problem(model(), records, own, balance="recordings", substeps=1)
    z = np.array([0.3, 0.6, 0.2, 0.7])
    shares = [float(r @ r) for r, _ in problem.separable_blocks(z)]
    values = problem.space.physical(z)
    means = [np.mean((problem.predict(values, n)["x"] - e.recording["x"]) ** 2) for n, e in problem.experiments.items()]
    np.testing.assert_allclose(shares, np.array(means) / 2, rtol=1e-10)
    short = problem.separable_blocks(z, np.array([False, True]))[1]
    assert [a.tobytes() for a in short] == [a.tobytes() for a in problem.separable_blocks(z)[1]]


def test_a_regression_equals_weighted_least_squares():
    rng, columns, targets = np.random.default_rng(3), [], []
    records = {}
    for name, n in (("long", 500), ("short", 20)):
        u, y = rng.normal(size=n), rng.normal(size=n)
        records[name] = Recording(0.1 * np.arange(n), {"u": Signal(u), "y": Signal(y)}, name)
        columns.append(np.c_[u, np.ones(n)] / np.sqrt(n))
        targets.append(y / np.sqrt(n))
    declared = tuple(Declared(n, None, (-9.0, 9.0)) for n in ("a", "b"))
    line = LinearModel("line", {"y": None}, declared, lambda s: np.c_[s["u"], np.ones(len(s["u"]))], {"u": None})
    problem = Problem(line, records, balance="recordings")
    best = np.linalg.lstsq(np.vstack(columns), np.concatenate(targets), rcond=None)[0]
    value, gradient = problem.value_and_gradient(problem.space.cube(best))
    expected = sum(np.sum((c @ best - t) ** 2) for c, t in zip(columns, targets, strict=True)) / 2
    assert value == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(gradient, 0.0, atol=1e-12)


def test_one_recording_is_as_without():
    plain, balanced = (
        Problem(model(), step(100, 1.0, "one"), balance=b, substeps=1) for b in ("samples", "recordings")
    )
    assert float(plain.cost(Z)) == pytest.approx(float(balanced.cost(Z)), rel=1e-14)


def test_unknown_words_are_refused():
    with pytest.raises(SpaceError, match="'samples' or 'recordings'"):
        Problem(model(), step(100, 1.0, "one"), balance="equal")  # pyrefly: ignore[bad-argument-type]


def test_the_study_file_knows_the_key(tmp_path):
    np.savetxt(
        tmp_path / "a.csv",
        np.c_[0.1 * np.arange(50), np.ones(50), np.ones(50)],
        delimiter=",",
        header="t,u,x",
        comments="",
    )
    text = """
name = "two"
balance = "recordings"
[recording.a]
file = "a.csv"
[recording.b]
file = "a.csv"
fit = [0.0, 2.0]
[model]
equations = "x' = (K*u - x)/tau"
inputs = ["u"]
states = { x = "" }
outputs = ["x"]
[parameters.K]
bounds = [0.5, 5]
[parameters.tau]
bounds = [0.1, 10]
""".replace('{ x = "" }', "{ x = { initial = 0.0 } }")
    problem = parse(text, tmp_path / "two.toml").problem
    assert problem.weights == pytest.approx({"a": 70 / 100, "b": 70 / 40})
    with pytest.raises(SpecError, match="balance"):
        validated(text.replace('"recordings"', '"openings"'), tmp_path / "two.toml")
