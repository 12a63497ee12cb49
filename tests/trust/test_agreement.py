"""Runs are counted after each one's own search came to its end on the final problem."""

from functools import cache

import numpy as np
import pytest
from scipy.optimize import least_squares

import plantfit.runtime  # noqa: F401
from plantfit.errors import Status
from plantfit.findings import read_findings
from plantfit.fitting import Answer, fit
from plantfit.models import equations
from plantfit.optimize.contract import RunResult
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.finish import final_problem as finishing
from plantfit.trust.finish.final_problem import finish
from plantfit.trust.verdict.agreement import _answers

TRUTH = {"K": 2.0, "tau": 0.7, "c": 0.3}
BOUNDS = {"K": (0.1, 10.0), "tau": (0.05, 5.0), "c": (-5.0, 5.0)}


def two_outputs(scales=None, noise=(0.05, 0.4), seed=0) -> Problem:
    """A first-order plant seen twice, once squared and with an offset; noise of different size."""
    return _two_outputs(tuple(dict(scales or {}).items()), tuple(noise), seed)


@cache
def _two_outputs(scales, noise, seed) -> Problem:
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 10.0, 200)
    u = np.repeat(rng.normal(size=20), 10)
    declared = {n: {"bounds": b} for n, b in BOUNDS.items()}
    model = equations(
        "x' = (K*u - x)/tau\ny = x\nw = x**2 + c", inputs=["u"], states=["x"], outputs=["y", "w"], parameters=declared
    )
    empty = Recording(t, {n: Signal(u) for n in ("u", "y", "w")})
    y = Problem(model, empty, substeps=8).predict(np.array(list(TRUTH.values())))
    noisy = {n: Signal(y[n] + s * rng.normal(size=len(t))) for n, s in zip(("y", "w"), noise, strict=True)}
    return Problem(model, Recording(t, {"u": Signal(u), **noisy}), scales=dict(scales) or None)


def run(z, cost, k=0, status=Status.converged, spent=500.0) -> RunResult:
    z = np.asarray(z, dtype=float)
    return RunResult("auto", k, 1, z, float(cost), spent, 0.1, status, np.array([spent]), np.array([float(cost)]))


def runs_at(problem, points, **more):
    return [run(z, problem.cost(np.asarray(z)), k, **more) for k, z in enumerate(points)]


def told(findings, word):
    return [v["sentence"] for v in findings["verdict"] if word in v["sentence"]]


def truly_reach(problem, results, best) -> int:
    """How many points lead to the cost `best` by scipy's least squares on this problem, from where each run had
    ended."""
    hits = 0
    for r in results:
        end = least_squares(
            lambda z: np.asarray(problem.residuals(z)),
            np.clip(r.x, 1e-9, 1 - 1e-9),
            bounds=(0, 1),
            x_scale="jac",
            xtol=1e-12,
            ftol=1e-12,
        )
        hits += float(np.mean(end.fun**2)) <= best * (1 + 1e-6)
    return hits


@pytest.mark.parametrize(("method", "runs", "budget"), [("auto", 3, None), ("pso", 4, 300), ("random", 5, 60)])
@pytest.mark.further(1)
def test_after_reweighting_all_runs_that_reach_the_answer_agree(method, runs, budget):
    found = fit(two_outputs(), method, runs=runs, budget=budget, seed=1)
    findings = found.findings
    agreement = findings["agreement"]
    assert agreement["agree"] == agreement["runs"] == runs
    assert np.ptp([r.cost for r in found.runs]) <= 1e-9 * found.best.cost
    assert f"{runs} of {runs} runs agree on the best cost, 1." in told(findings, "runs agree")
    assert found.values == pytest.approx(TRUTH, abs=0.1)
    # histories keep the costs that the search saw
    assert all(r.history_cost[-1] != r.cost for r in found.runs)


def test_the_count_is_true_for_runs_that_were_cut_anywhere():
    problem = two_outputs()
    rng = np.random.default_rng(3)
    before = runs_at(problem, rng.random((12, 3)), status=Status.budget)
    final, results = finish(problem, before)
    findings = Answer(final, results, 0).findings
    best = min(r.cost for r in results)
    assert findings["agreement"]["agree"] == truly_reach(final, before, best)
    assert findings["agreement"]["spent"] == 12
    assert told(findings, "cut by their budget")
    read = read_findings(findings).agreement
    assert read is not None
    assert read.agree == findings["agreement"]["agree"]


@cache
def two_wells(noise=0.1) -> Problem:
    """p near -1 follows y best, p near 1 follows w: with the spreads as weights the first is the better one, by
    likelihood the second."""
    rng = np.random.default_rng(0)
    t = np.linspace(0.0, 1.0, 400)
    s = np.sqrt(2) * np.sin(2 * np.pi * 5 * t)
    text = "y = 5*(1 - p**2) + 0.046*0.5*(1 + p)*s\nw = 6*u + 0.387*0.5*(1 - p)*s"
    model = equations(text, inputs=["u", "s"], outputs=["y", "w"], parameters={"p": {"bounds": (-2.0, 2.0)}})
    measured = {"y": Signal(noise * rng.normal(size=400)), "w": Signal(6 * t + noise * rng.normal(size=400))}
    return Problem(model, Recording(t, {"u": Signal(t), "s": Signal(s), **measured}))


def test_the_final_problem_is_made_at_the_basin_that_is_best_on_it():
    problem = two_wells()
    lower, upper = (
        least_squares(lambda z: np.asarray(problem.residuals(z)), z, bounds=(0, 1)).x for z in ([0.25], [0.75])
    )
    before = runs_at(problem, [lower, upper, upper + 1e-3])
    assert before[0].cost < 0.9 * before[1].cost
    final, results = finish(problem, before)
    answer = Answer(final, results, 0)
    assert answer.values["p"] == pytest.approx(1.0, abs=0.02)
    # the noise and what this basin leaves, not that of the other
    assert final.scales == pytest.approx({"y": 0.11, "w": 0.1}, rel=0.15)
    assert answer.best.cost == pytest.approx(1.0, abs=1e-3)
    assert answer.findings["agreement"]["agree"] == 2
    assert results[0].cost > 2.0  # the other basin, on this problem
    assert results[0].extra["ended"] == "searched"


def test_two_basins_that_are_each_better_than_the_other_by_their_own_spreads_do_not_go_round_in_circles():
    problem = two_wells()
    for points in ([[0.25], [0.75]], [[0.75], [0.25]]):
        final, results = finish(problem, runs_at(problem, points))
        assert min(results, key=lambda r: r.cost).x == pytest.approx([0.75], abs=0.01)
        assert final.scale_sources["y"].settled


def test_finer_steps_at_the_answer_move_every_run():
    """An oscillation with one step a sample: the answer is known after the steps were halved."""
    t = np.linspace(0.0, 20.0, 120)
    declared = {"k": {"bounds": (1.0, 9.0)}, "d": {"bounds": (0.05, 2.0)}}
    model = equations(
        "x' = v\nv' = -k*x - d*v + u", inputs=["u"], states=["x", "v"], outputs=["x"], parameters=declared
    )
    u = np.where(t > 1.0, 1.0, 0.0)
    blank = Recording(t, {"u": Signal(u), "x": Signal(u)})
    clean = Problem(model, blank, substeps=64).predict(np.array([4.0, 0.3]))["x"]
    noisy = clean + 1e-4 * np.random.default_rng(0).normal(size=120)
    problem = Problem(model, Recording(t, {"u": Signal(u), "x": Signal(noisy)}), stepper="rk4")
    before = [run(o, c, k) for k, (o, c) in enumerate(_ends(problem, [[0.3, 0.1], [0.4, 0.2], [0.45, 0.12]]))]
    final, results = finish(problem, before)
    assert final.predictor.stepping().substeps > problem.predictor.stepping().substeps
    findings = Answer(final, results, 0).findings
    assert findings["agreement"]["agree"] == truly_reach(final, before, min(r.cost for r in results)) == 3


def _ends(problem, starts):
    for z in starts:
        end = least_squares(
            lambda x: np.asarray(problem.residuals(x)), z, bounds=(0, 1), xtol=1e-14, ftol=1e-14, gtol=1e-14
        )
        yield end.x + 2e-6 * np.random.default_rng(0).normal(size=2), float(np.mean(end.fun**2))


def test_what_was_not_searched_on_is_not_counted_and_told(monkeypatch):
    problem = two_outputs()
    points = np.random.default_rng(5).random((9, 3)) * 0.2 + 0.15
    before = runs_at(problem, [*points, points[0], points[0] + 1e-9])
    monkeypatch.setattr(finishing, "SEARCHES", 3)
    final, results = finish(problem, before)
    ended = [r.extra["ended"] for r in results]
    assert ended.count("left") == 5  # of nine points the best and three others were searched
    lowest = min(range(11), key=lambda k: before[k].cost)
    assert ended[lowest] in ("searched", "same point")
    findings = Answer(final, results, 0).findings
    counted = [r for r in results if r.extra["ended"] in ("searched", "same point")]
    assert findings["agreement"]["agree"] <= len(counted)
    assert findings["agreement"]["left"] == ended.count("left")
    agree = findings["agreement"]["agree"]
    [sentence] = told(findings, "runs were left where the search had ended")
    assert sentence.startswith(f"{agree} of the 6 runs that were searched on agree on the best cost")
    assert "The other 5 of 11 runs were left" in sentence
    # runs at one point share a search
    if ended[0] != "left":
        assert results[0].x.tolist() == results[9].x.tolist() == results[10].x.tolist()


def test_a_search_that_is_cut_is_not_called_an_optimum(monkeypatch):
    monkeypatch.setattr(finishing, "STEPS", 2)
    monkeypatch.setattr("plantfit.trust.finish.descent.STEPS", 2)
    monkeypatch.setattr("plantfit.trust.finish.descent.POLISH", 0)
    problem = two_outputs((("y", 0.05), ("w", 0.4)))
    final, results = finish(
        problem, runs_at(problem, [[0.9, 0.9, 0.9], [0.1, 0.1, 0.1]], status=Status.budget, spent=1.0)
    )
    findings = Answer(final, results, 0).findings
    assert told(findings, "is not the end of a search")
    assert findings["agreement"]["agree"] == 0


def test_a_single_run_that_was_cut_is_said_to_be_cut():
    for budget, cut in ((40, True), (5000, False)):
        found = fit(two_outputs(), "auto", budget=budget, seed=0)
        assert (found.best.status is Status.budget) == cut
        assert bool(told(found.findings, "The run was cut by its budget")) == cut


@cache
def terms(n: int, seed=0, runs=6, extra="", **more) -> Answer:
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 3.0, 60)
    rates, sizes = [4.0, 0.7, 20.0][:n], [3.0, 1.0, 2.0][:n]
    text = "y = " + " + ".join(f"a{k}*exp(-b{k}*u)" for k in range(n)) + extra
    y = sum(a * np.exp(-b * t) for a, b in zip(sizes, rates, strict=True))
    declared = {f"{v}{k}": {"bounds": (0.0, 5.0) if v == "a" else (0.01, 30.0)} for k in range(n) for v in "ab"}
    model = equations(text, inputs=["u"], outputs=["y"], parameters=declared)
    return fit(
        Problem(model, Recording(t, {"u": Signal(t), "y": Signal(y + 0.002 * rng.normal(size=60))})),
        runs=runs,
        seed=seed,
        **more,
    )


def test_terms_that_change_places_are_one_answer():
    findings = terms(2).findings
    assert findings["agreement"]["agree"] == 6
    assert len(findings["agreement"]["answers"]) == 1
    assert findings["agreement"]["symmetries"][0]["source"] == {"a0": "a1", "b0": "b1", "a1": "a0", "b1": "b0"}
    assert told(findings, "a0, b0 and a1, b1 can be exchanged: same model")
    assert not told(findings, "different answers")


@pytest.mark.parametrize("seed", range(3))
def test_an_exchange_is_named_from_one_run_too_and_not_where_there_is_none(seed):
    assert told(terms(2, runs=1, seed=seed).findings, "a0, b0 and a1, b1 can be exchanged: same model")
    findings = terms(2, runs=2, seed=seed, extra=" + 1e-3*b0*u").findings
    assert not findings["agreement"]["symmetries"]
    assert not told(findings, "can be exchanged")


def shared(extra="", unit="1", whole=1.0, seed=3, low=0.0) -> Answer:
    """f exp(-a t) + (1 - f) exp(-b t) with f = 0.3, a = 4, b = 0.7."""
    t = np.linspace(0.0, 3.0, 80)
    y = 0.3 * np.exp(-4.0 * t) + 0.7 * np.exp(-0.7 * t) + 0.002 * np.random.default_rng(seed).normal(size=80)
    rate = {"bounds": (0.01, 30.0)}
    declared = {"f": {"bounds": (low * whole, whole), "unit": unit}, "a": rate, "b": rate}
    share = f"f/{whole:g}"
    text = f"y = {share}*exp(-a*u) + (1 - {share})*exp(-b*u){extra}"
    model = equations(text, inputs=["u"], outputs=["y"], parameters=declared, check=False)
    return fit(Problem(model, Recording(t, {"u": Signal(t), "y": Signal(y)})), runs=6, seed=seed)


@pytest.mark.parametrize(("unit", "whole"), [("1", 1.0), (None, 1.0), ("%", 100.0)])
def test_a_share_that_becomes_the_rest_is_one_answer(unit, whole):
    findings = shared(unit=unit, whole=whole).findings
    assert told(findings, f"a and b can be exchanged while f becomes {whole:g} - f: same model")
    assert len(findings["agreement"]["answers"]) == 1
    assert findings["agreement"]["agree"] == 6
    [same] = findings["agreement"]["symmetries"]
    assert same["whole"] == [whole, 0.0, 0.0]
    assert same["sign"] == [-1, 1, 1]
    assert not told(findings, "different answers")


def test_a_share_whose_terms_are_not_alike_is_no_exchange():
    """Only a acts on the other term too: exchanged it is another model."""
    findings = shared(extra=" + 0.001*a*u").findings
    assert not findings["agreement"]["symmetries"]
    assert not told(findings, "becomes")


def test_answers_that_are_different_models_are_told_apart():
    """y = |p|: two answers of the same cost, and no map of the model: the other output of the same shape sees the
    sign."""
    t = np.linspace(0.0, 1.0, 50)
    model = equations("y = p**2*u + 1e-30*p", inputs=["u"], outputs=["y"], parameters={"p": {"bounds": (-2.0, 2.5)}})
    same = Problem(model, Recording(t, {"u": Signal(t), "y": Signal(t + 0.01 * np.sin(40 * t))}))
    findings = Answer(*finish(same, runs_at(same, [same.space.cube([-1.0]), same.space.cube([1.0])])), 0).findings
    assert told(findings, "the sign of p does not matter: same model")
    hump = equations(
        "y = (p**2 + 0.2*p**3 - 0.2*p)*u", inputs=["u"], outputs=["y"], parameters={"p": {"bounds": (-2.0, 2.0)}}
    )
    other = Problem(hump, Recording(t, {"u": Signal(t), "y": Signal(t + 0.01 * np.sin(40 * t))}))
    findings = Answer(*finish(other, runs_at(other, [other.space.cube([-1.0]), other.space.cube([1.0])])), 0).findings
    assert findings["agreement"]["agree"] == 2
    assert told(findings, "2 different answers fit equally well: p = ")
    assert not findings["agreement"]["symmetries"]


def absorbed(noise: float, seed: int, runs: int) -> Answer:
    """A dose that is absorbed and eliminated: with the rates exchanged another volume gives the same curve
    ("flip-flop" kinetics)."""
    t = np.linspace(0.0, 10.0, 40)
    text = "y = ka/(V*(ka - k + 1e-9))*(exp(-k*u) - exp(-ka*u))"
    declared = {n: {"bounds": b} for n, b in {"ka": (0.05, 5.0), "k": (0.05, 5.0), "V": (0.05, 5.0)}.items()}
    model = equations(text, inputs=["u"], outputs=["y"], parameters=declared)
    y = 1.5 * (np.exp(-0.5 * t) - np.exp(-1.5 * t)) + noise * np.random.default_rng(seed).normal(size=len(t))
    return fit(Problem(model, Recording(t, {"u": Signal(t), "y": Signal(y)})), runs=runs, seed=seed)


@pytest.mark.parametrize("seed", range(4))
def test_another_answer_that_one_run_met_is_told(seed):
    """Two optima far apart in the box, both sharp; a range from one to the other says nothing of the gap between
    them."""
    findings = absorbed(0.003, seed, 1).findings
    (sentence,) = told(findings, "2 different answers fit equally well")
    assert "run" not in sentence
    one, other = (a["parameters"] for a in findings["agreement"]["answers"])
    assert other["ka"] == pytest.approx(one["k"], rel=0.01)
    assert other["V"] == pytest.approx(one["V"] * one["k"] / one["ka"], rel=0.01)
    assert told(findings, "ended at the best cost")
    assert not told(findings, "worse one")


def test_another_answer_that_no_run_reports_is_told_as_that():
    answer, met = ({"runs": n, "parameters": {"ka": v}} for n, v in ((3, 1.5), (0, 0.5)))
    (told,) = _answers({"symmetries": [], "answers": [answer, met], "runs": 3})
    assert "ka = 1.5 (3 runs); ka = 0.5 (local searches within the runs)" in told["sentence"]


@pytest.mark.parametrize("seed", range(2))
def test_a_valley_that_searches_of_one_run_met_is_no_other_answer(seed):
    findings = fit(product(known=False, seed=seed), seed=seed).findings
    assert len(findings["agreement"]["answers"]) == 1
    assert not told(findings, "different answers")


def test_a_perfect_fit_is_agreed_on_to_rounding():
    t = np.linspace(0.0, 3.0, 40)
    model = equations(
        "y = a*exp(-b*u)", inputs=["u"], outputs=["y"], parameters={n: {"bounds": (0.1, 9.0)} for n in "ab"}
    )
    found = fit(
        Problem(model, Recording(t, {"u": Signal(t), "y": Signal(2 * np.exp(-0.7 * t))})),
        "pso",
        runs=3,
        budget=400,
        seed=0,
    )
    assert found.best.cost < 1e-20
    assert found.findings["agreement"]["agree"] == 3


def test_the_report_compares_what_the_search_found_and_writes_one_model_in_one_way():
    """Sentences of the section on runs: exchanged terms are one answer there too, and costs are those of the search."""
    from plantfit.report.drawings import Drawings
    from plantfit.report.sections import comparison as comparison_section

    def told_of(record):
        section = comparison_section.of_findings(record, Drawings())
        assert section is not None
        return section["says"]

    answer = terms(2, runs=6, method="lbfgsb", budget=3000)  # one start a run; `auto` would meet both ways in each
    record = read_findings(answer.findings)
    assert record.agreement is not None
    places = {tuple(f"{v:.1f}" for v in r.parameters.values()) for r in record.runs}
    assert len(places) == 2  # both ways to write it are there
    said = [s["sentence"] for s in told_of(record)]
    assert any("agree on one answer" in s for s in said), said
    without = record.model_copy(update={"agreement": record.agreement.model_copy(update={"symmetries": []})})
    assert any("2 distinct answers" in s["sentence"] for s in told_of(without))
    for r, before in zip(record.runs, answer.runs, strict=True):
        z = answer.problem.space.cube(np.array(list((r.searched or {}).values())))
        assert float(answer.problem.cost(z)) == pytest.approx(before.history_cost[-1], rel=1e-6)


def product(known: bool, seed=0) -> Problem:
    """A first-order plant whose gain is a product; with the second output one of its factors is measured alone."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 12.0, 150)
    u = np.repeat(rng.normal(size=15), 10)
    declared = {"a": {"bounds": (0.1, 10.0)}, "b": {"bounds": (0.1, 10.0)}, "tau": {"bounds": (0.05, 5.0)}}
    text, outputs = (
        ("x' = (a*b*u - x)/tau\ny = x\nw = a*u", ["y", "w"]) if known else ("x' = (a*b*u - x)/tau\ny = x", ["y"])
    )
    model = equations(text, inputs=["u"], states=["x"], outputs=outputs, parameters=declared)
    empty = Recording(t, {n: Signal(u) for n in ("u", *outputs)})
    y = Problem(model, empty, substeps=4).predict(np.array([1.7, 1.2, 0.6]))
    noisy = {n: Signal(y[n] + 0.05 * rng.normal(size=len(t))) for n in outputs}
    return Problem(model, Recording(t, {"u": Signal(u), **noisy}), substeps=4)


@pytest.mark.parametrize("seed", range(4))
def test_a_parameter_that_equal_runs_contradict_is_not_determined(seed):
    findings = fit(product(known=False, seed=seed), runs=4, seed=seed).findings
    rows = {p["name"]: p for p in findings["parameters"]}
    assert "determined" not in (rows["a"]["status"], rows["b"]["status"])
    assert rows["tau"]["status"] == "determined"
    assert not any("a = " in s or "b = " in s for s in told(findings, "The data determine"))
    for name in ("a", "b"):
        low, high = findings["agreement"]["ranges"][name]
        assert rows[name]["low"] <= low < high <= rows[name]["high"]
    assert read_findings(findings) is not None


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.further(3)
def test_runs_that_agree_and_exchanged_terms_open_nothing(seed):
    findings = fit(product(known=True, seed=seed), runs=4, seed=seed).findings
    assert [p["status"] for p in findings["parameters"]] == ["determined"] * 3
    exchanged = terms(2).findings
    assert exchanged["agreement"]["symmetries"]
    assert not any(p.get("equal_answers") for p in exchanged["parameters"])
