"""Strengths of smoothing against a direct maximum of the restricted likelihood, brute-force cross-validation and
known truths; and the coverage of intervals beside the smoothing."""

import numpy as np
import pytest
from scipy.optimize import minimize

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpaceError
from plantfit.fitting import fit
from plantfit.models import Declared, Model, Table
from plantfit.problem import Problem
from plantfit.problem.evaluate.second_differences import second_differences
from plantfit.recording.record import Recording, Signal
from plantfit.report import render_html
from plantfit.space import Parameter
from plantfit.trust.finish.smoothed_descent import Rows, descend
from plantfit.trust.finish.smoothing_strength import (
    BENDS,
    FOLDS,
    PIECES,
    by_cross_validation,
    by_reml,
    choose_strengths,
    typical_bends,
)
from plantfit.trust.intervals.linearised import linearise

NODES = tuple(np.linspace(0.0, 10.0, 21).tolist())
BOX = 4.0


def smoothing_of(problem):
    assert problem.smoothing is not None
    return problem.smoothing


def truth(u):
    return np.sin(0.6 * u)


def static(smooth, u, y, *, second=None, v=None, names=("r",)):
    axes = (NODES,) if second is None else (NODES, second)
    signals = ("u", "v")[: len(axes)]
    table = Table("f", signals, axes, "V")
    model = Model(
        name="curve", states={}, inputs=dict.fromkeys(signals), outputs={"y": "V"},
        parameters=(Declared("f", "V", (-0.5 * BOX, 0.5 * BOX), shape=table.shape),),
        output=lambda x, u, p: {"y": table(p["f"], *(u[s] for s in signals))}, tables=(table,),
    )  # fmt: skip
    given = {"u": Signal(u), "y": Signal(y, "V")} | ({} if v is None else {"v": Signal(v)})
    pieces = np.array_split(np.arange(len(u)), len(names))
    records = {
        n: Recording(np.arange(float(len(k))), {s: Signal(g.values[k], g.unit) for s, g in given.items()}, n)
        for n, k in zip(names, pieces, strict=True)
    }
    return Problem(model, records, {"f": Parameter((-0.5 * BOX, 0.5 * BOX), "V", smooth=smooth)})


def noisy(seed=0, n=120, sd=0.3):
    rng = np.random.default_rng(seed)
    u = rng.uniform(0.0, 10.0, n)
    return u, truth(u) + sd * rng.normal(size=n)


def basis(u):
    return BOX * np.stack([np.interp(u, NODES, row) for row in np.eye(len(NODES))], axis=1)


def test_reml_is_where_the_restricted_likelihood_is_largest():
    u, y = noisy(1)  # of residuals without correlation, which would count as more noise
    problem = static("reml", u, y)
    found = by_reml(problem, np.full(21, 0.5))
    x, b, n = basis(u), second_differences(np.array(NODES)), len(u)
    target = y + 0.5 * BOX

    def minus_twice(log_strength):
        """-2 log restricted likelihood with sigma^2 profiled out (Wood 2011, J. R. Statist. Soc. B 73:3, section 2)."""
        s = np.exp(log_strength) * b.T @ b
        z = np.linalg.solve(x.T @ x + s, x.T @ target)
        size = float(np.sum((target - x @ z) ** 2) + z @ s @ z)
        return (n - 2) * np.log(size) + np.linalg.slogdet(x.T @ x + s)[1] - 19 * log_strength

    best = np.exp(
        min(
            (minimize(lambda a: minus_twice(a[0]), [start], method="Nelder-Mead") for start in (0.0, 5.0)),
            key=lambda r: r.fun,
        ).x[0]
    )
    (strength,) = smoothing_of(found.problem).strengths.values()
    assert strength == pytest.approx(best, rel=0.02)
    z = np.linalg.solve(x.T @ x + strength * b.T @ b, x.T @ target)
    np.testing.assert_allclose(found.z, z, atol=1e-6)


def test_cross_validation_is_that_by_hand():
    u, y = noisy(1)
    problem = static("cross-validated", u, y, names=("a", "b"))
    bends = (0.3, 0.03, 0.003)
    found = by_cross_validation(problem, np.full(21, 0.5), bends=bends)
    x, b, target = basis(u), second_differences(np.array(NODES)), y + 0.5 * BOX
    part = np.concatenate([np.arange(60) * FOLDS * PIECES // 60 % FOLDS] * 2)
    variance = float(np.mean((x @ np.full(21, 0.5) - target) ** 2))
    for score, bend in zip(found.scores, bends, strict=True):
        squares = []
        for k in range(FOLDS):
            kept = part != k
            z = np.linalg.solve(x[kept].T @ x[kept] + variance / bend**2 * b.T @ b, x[kept].T @ target[kept])
            squares.append((x[~kept] @ z - target[~kept]) ** 2)
        assert score.score == pytest.approx(np.mean(np.concatenate(squares)), rel=1e-5)
        assert score.standard_error == pytest.approx(
            np.std([s.mean() for s in squares], ddof=1) / np.sqrt(FOLDS), rel=1e-4
        )
    best = min(found.scores, key=lambda s: s.score)
    assert smoothing_of(found.problem).strengths["f", "u"] == pytest.approx(variance / best.bend**2)


@pytest.mark.parametrize("way", ["reml", "cross-validated"])
@pytest.mark.thorough
def test_a_chosen_strength_comes_nearer_to_the_truth_than_none_or_much(way):
    errors = {name: [] for name in ("chosen", "none", "much")}
    for seed in range(8):
        u, y = noisy(10 + seed, n=80)
        found = choose_strengths(static(way, u, y), np.full(21, 0.5))
        for name, smooth in (("none", 1e-9), ("much", 1e9)):
            z = choose_strengths(problem := static(smooth, u, y), np.full(21, 0.5)).z
            z = by_given(problem, z)
            errors[name].append(rmse(problem, z))
        errors["chosen"].append(rmse(found.problem, found.z))
    mean = {n: float(np.mean(e)) for n, e in errors.items()}
    assert mean["chosen"] < 0.75 * mean["none"]
    assert mean["chosen"] < 0.4 * mean["much"]


def by_given(problem, z):
    return descend(Rows(problem), problem.smoothing, z)


def rmse(problem, z):
    return float(np.sqrt(np.mean((np.asarray(problem.space.physical(z)) - truth(np.array(NODES))) ** 2)))


def test_a_straight_line_is_found_to_be_one():
    rng = np.random.default_rng(4)
    u = rng.uniform(0.0, 10.0, 200)
    found = by_reml(static("reml", u, 0.15 * u - 0.5 + 0.2 * rng.normal(size=200)), np.full(21, 0.5))
    local = linearise(found.problem, found.z)
    assert local.effective.sum() < 4.0
    assert typical_bends(found.problem, found.z)["f", "u"] < 3e-3


@pytest.mark.thorough
def test_reml_gives_each_axis_its_own_strength():
    rng = np.random.default_rng(5)
    second = tuple(np.linspace(0.0, 1.0, 6).tolist())
    u, v = rng.uniform(0.0, 10.0, 400), rng.uniform(0.0, 1.0, 400)
    problem = static("reml", u, truth(u) * (0.5 + v) + 0.2 * rng.normal(size=400), second=second, v=v)
    found = by_reml(problem, np.full(126, 0.5))
    strengths = smoothing_of(found.problem).strengths
    assert strengths["f", "v"] > 30.0 * strengths["f", "u"]  # straight along v, a sine along u
    error = np.asarray(found.problem.space.physical(found.z)).reshape(21, 6) - truth(np.array(NODES))[:, None] * (
        0.5 + np.array(second)
    )
    assert np.sqrt(np.mean(error**2)) < 0.1


def test_correlated_noise_is_not_taken_for_a_shape():
    rng = np.random.default_rng(6)
    u = np.linspace(0.0, 10.0, 600)
    e = np.zeros(600)
    for k in range(1, 600):
        e[k] = 0.9 * e[k - 1] + 0.1 * rng.normal()
    plain = static("reml", u, truth(u) + e)
    found = by_reml(plain, np.full(21, 0.5))
    assert linearise(found.problem, found.z).effective.sum() < 16.0


def test_effective_parameters_are_the_trace_of_the_hat_matrix():
    u, y = noisy()
    problem = static(40.0, u, y)
    z = by_given(problem, np.full(21, 0.5))
    x, s = basis(u), 40.0 * second_differences(np.array(NODES)).T @ second_differences(np.array(NODES))
    hat = x @ np.linalg.solve(x.T @ x + s, x.T)
    assert linearise(problem, z).effective.sum() == pytest.approx(np.trace(hat), rel=0.01)


@pytest.mark.slow
def test_intervals_beside_smoothing_cover_the_truth_across_the_table():
    inside = []
    for seed in range(40):
        u, y = noisy(100 + seed, n=150)
        found = by_reml(static("reml", u, y), np.full(21, 0.5))
        local = linearise(found.problem, found.z)
        inside.append(np.abs(local.values - truth(np.array(NODES))) < 1.96 * local.standard_error)
    assert 0.90 <= np.mean(inside) <= 0.99


def test_fit_chooses_and_says_so():
    u, y = noisy(3)
    answer = fit(static("reml", u, y), seed=2)
    strengths = smoothing_of(answer.problem).strengths
    direct = smoothing_of(by_reml(static("reml", u, y), np.full(21, 0.5)).problem).strengths
    assert strengths["f", "u"] == pytest.approx(direct["f", "u"], rel=0.05)
    (row,) = answer.findings["smoothing"]
    assert (row["chosen"], row["entries"], row["over"]) == ("reml", 21, ["u"])
    assert 4.0 < row["effective"] < 14.0
    (said,) = [v["sentence"] for v in answer.findings["verdict"] if "smoothed" in v["sentence"]]
    assert "estimated by restricted maximum likelihood" in said
    assert f"the data then fix {row['effective']:.3g} of 21 entries" in said
    assert said in render_html(answer.findings)


def test_nothing_smoothed_is_refused():
    with pytest.raises(SpaceError, match="No parameter of this problem is smoothed"):
        by_reml(static(None, *noisy()), np.full(21, 0.5))
    assert len(BENDS) == 9
