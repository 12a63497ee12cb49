"""The sentence on local searches is good only where enough ended at the answer and little of the box is unseen."""

from importlib import import_module

import numpy as np
import pytest

import plantfit as pf
from plantfit.optimize.local.basins import Basins
from plantfit.optimize.local.one_search import Found
from plantfit.trust.verdict.all_sentences import _steps
from plantfit.trust.verdict.residuals import only_noise
from plantfit.trust.verdict.searches import search_sentences


def told(costs, cut=(), dependent=()):
    extra = {}
    basins = Basins(extra)
    for c in costs:
        basins.add(Found(np.zeros(1), c))
    for c in dependent:
        basins.add(Found(np.zeros(1), c), independent=False)
    for c in cut:
        basins.add(Found(np.zeros(1), c, finished=False))
    [sentence] = search_sentences(extra)
    return sentence["level"], sentence["sentence"]


@pytest.mark.parametrize(
    ("costs", "cut", "dependent", "level", "part"),
    [
        ([1.0] * 8, [], [], "good", "8 of 8 local searches from different starts ended in the best optimum."),
        (
            [1.0] * 6 + [2.0] * 6,
            [],
            [],
            "good",
            "6 of 12 local searches from different starts ended in the best optimum, the others",
        ),
        (
            [1.0] * 3 + [2.0, 3.0, 4.0, 5.0, 6.0],
            [],
            [],
            "warning",
            "about 75 % of the box is expected",
        ),
        (
            [1.0] * 6 + [2.0] * 6,
            [3.0] * 9,
            [],
            "warning",
            "no search has seen, as 9 more searches were cut off before their end; give a larger budget.",
        ),
        ([1.0] + [2.0] * 9, [], [], "warning", "1 of 10 local searches"),
        ([1.0, 1.0], [], [], "warning", "a better one may exist"),
        # the answer was cut off, or found by a step away from another answer: no independent search ended there
        ([1.0] * 8, [0.5], [], "warning", "0 of 8 local searches"),
        ([1.0] * 8, [], [0.5], "warning", "0 of 9 local searches"),
        ([], [1.0], [], "warning", "No local search came to its end"),
        ([1.0], [], [], "warning", "1 of 1 local search from"),
    ],
)
def test_sentences(costs, cut, dependent, level, part):
    found = told(costs, cut, dependent)
    assert found[0] == level
    assert part in found[1]


def test_an_affine_problem_needs_no_agreement():
    [sentence] = search_sentences({"linear": True, "basin_hits": 1, "starts": 1})
    assert sentence["level"] == "good"
    assert list(search_sentences({"generations": 4})) == []


@pytest.mark.parametrize(
    ("reached", "refused", "part"),
    [
        (200, "", False),
        (120, "", True),
        (120, "at t = 3 s state x (1e9) grows without bound", True),
        (None, "", False),
    ],
)
def test_a_check_of_a_part_of_a_record_says_which_part(reached, refused, part):
    output = {"unit": "V", "max_error": 1e-6, "rms_error": 1e-7, "rms_residual": 0.1}
    simulation = {"recording": "r", "checked_with": "scipy LSODA, rtol 1e-9", "samples": 200, "outputs": {"y": output}}
    simulation |= {} if reached is None else {"checked_samples": reached}
    said = [
        s["sentence"]
        for s in _steps(
            {"simulation": simulation | ({"refused": refused} if refused else {}), "recordings": [{"outputs": {}}]}
        )
    ]
    assert any("over the first 120 of 200 samples" in s for s in said) == part
    assert not any("evaluations" in s for s in said)
    assert any("is refused: in recording r, at t = 3 s" in s for s in said) == bool(refused)
    assert any("where it could be followed" in s for s in said) == bool(refused)


def test_a_check_that_ends_with_its_evaluations_says_so():
    output = {"unit": "V", "max_error": 1e-6, "rms_error": 1e-7, "rms_residual": 0.1}
    simulation = {"recording": "r", "checked_with": "scipy LSODA, rtol 1e-9", "samples": 3000, "outputs": {"y": output}}
    simulation |= {"checked_samples": 1724, "checked_evaluations": 300_000}
    (said,) = _steps({"simulation": simulation, "recordings": [{"outputs": {}}]})
    why = "as far as the 300,000 evaluations reach that the check may take, ("
    assert f"at worst over the first 1724 of 3000 samples, {why}" in said["sentence"]
    assert said["level"] == "good"


@pytest.mark.parametrize("allowed", [400, 100_000])
def test_the_findings_tell_whether_the_evaluations_ended(monkeypatch, allowed):
    for name in ("assess", "finish.final_problem"):
        monkeypatch.setattr(import_module(f"plantfit.trust.{name}"), "CHECKED", allowed)
    t = np.arange(400) * 0.1
    u = np.where(np.random.default_rng(1).random(400) < 0.5, -1.0, 1.0)
    y = np.zeros(400)
    for k in range(399):
        y[k + 1] = u[k] + (y[k] - u[k]) * np.exp(-0.1)
    y += 0.01 * np.random.default_rng(2).standard_normal(400)
    model = pf.equations(
        "x' = (K*u - x)/tau\ny = x", inputs=["u"], states={"x": {"initial": 0.0}}, outputs=["y"],
        parameters=["K", "tau"], check=False,
    )  # fmt: skip
    record = pf.Recording(t, {"u": pf.Signal(u, "1"), "y": pf.Signal(y, "1")}, "r")
    answer = pf.fit(pf.Problem(model, record, {"K": (0.1, 10.0), "tau": (0.1, 10.0)}), budget=300)
    simulation = answer.findings["simulation"]
    spent = allowed == 400
    assert simulation["checked_evaluations"] == (400 if spent else None)
    assert (simulation["checked_samples"] < 400) is spent
    assert any("as far as the 400 evaluations reach" in v["sentence"] for v in answer.findings["verdict"]) is spent


def test_in_a_flat_valley_no_larger_budget_is_advised():
    extra = {}
    Basins(extra).add(Found(np.zeros(1), 1.0))
    [valley], [point] = search_sentences(extra, flat=True), search_sentences(extra)
    assert "budget" not in valley["sentence"]
    assert "valley of parameters that are not determined" in valley["sentence"]
    assert "give a larger budget" in point["sentence"]


@pytest.mark.parametrize(
    ("costs", "best", "valley"),
    [
        ([1.0, 1.01, 1.05, 1.2], 1.0, True),  # most at about the best cost
        # optima of their own: Osborne's second problem, whose best search was cut off
        ([6.5, 7.0, 9.0, 30.0], 1.0, False),
        ([1.0, 6.5, 7.0, 9.0], 1.0, False),
        ([1e-26, 3e-24, 2e-25], 1e-27, True),  # nothing is left: all are the best
    ],
)
def test_only_searches_that_end_near_the_best_cost_are_in_its_valley(costs, best, valley):
    extra = {
        "basin_hits": 0,
        "starts": len(costs),
        "optima": len(costs),
        "unseen": 1.0,
        "local_costs": costs,
        "basin_cost": best,
    }
    [sentence] = search_sentences(extra, flat=True)
    assert ("valley" in sentence["sentence"]) == valley
    assert sentence["level"] == ("info" if valley else "warning")
    assert ("give a larger budget" in sentence["sentence"]) == (not valley)


def test_where_a_simulation_is_lost_the_sentence_names_shooting():
    extra = {"basin_hits": 0, "starts": 3}
    [plain], [lost] = search_sentences(extra), search_sentences(extra, lost=True)
    assert "give a larger budget." in plain["sentence"]
    assert "`shooting = 100` under [search]" in lost["sentence"]
    [forgets] = search_sentences(extra, lost=True, forgets=True)  # another sentence says what to do
    assert forgets["sentence"].endswith("a better one may exist.")
    # a model that cannot, not a search that did not find
    [repeated] = search_sentences({"basin_hits": 5, "starts": 5}, lost=True)
    assert "shooting" not in repeated["sentence"]


def test_a_single_search_is_told_as_what_was_asked_for():
    """Only where the budget did not end it, and where it ended at the answer."""
    one = {"basin_hits": 1, "starts": 1}
    [asked], [cut_off] = search_sentences(one, ended=True), search_sentences(one)
    assert "as asked" in asked["sentence"]
    assert "budget" not in asked["sentence"]
    assert "give a larger budget" in cut_off["sentence"]
    for extra in ({"basin_hits": 2, "starts": 2}, {"basin_hits": 1, "starts": 3}, {"basin_hits": 0, "starts": 1}):
        [said] = search_sentences(extra, ended=True)
        assert "as asked" not in said["sentence"]


def test_where_only_noise_is_left_a_larger_budget_is_no_advice():
    for extra in ({"basin_hits": 0, "starts": 9}, {"basin_hits": 9, "starts": 20, "optima": 4, "unseen": 0.3}):
        [plain], [said] = search_sentences(extra), search_sentences(extra, noise=True)
        assert (plain["level"], said["level"]) == ("warning", "info")
        assert "larger budget" in plain["sentence"]
        assert "larger budget" not in said["sentence"]
        assert said["sentence"].endswith("another answer may fit as well, but hardly better.")
    [good] = search_sentences({"basin_hits": 9, "starts": 9}, noise=True)
    assert "hardly" not in good["sentence"]


@pytest.mark.thorough
def test_only_noise_is_said_where_no_answer_fits_much_better():
    """One local search in a cost with an optimum for every lost period of a sine, under noise of several sizes: where
    what it leaves passes for noise, the lowest cost of all leaves hardly less."""
    x = np.linspace(0.0, 10.0, 300)
    model = pf.equations("y = a*sin(w*x)", inputs=["x"], outputs=["y"], parameters=["a", "w"])
    told = {True: 0, False: 0}
    for seed in range(12):
        noise = (0.02, 0.1, 0.3, 1.0)[seed % 4]
        y = 1.3 * np.sin(4.0 * x) + noise * np.random.default_rng(seed).normal(size=len(x))
        problem = pf.Problem(model, pf.from_arrays({"t": x, "x": x, "y": y}), {"a": (-5.0, 5.0), "w": (3.0, 5.2)})
        answer = pf.fit(problem, "least_squares", settings={"agree": 1}, seed=seed)
        least = np.sqrt(min(np.mean((y - np.dot(s, y) / np.dot(s, s) * s) ** 2) for s in np.sin(_rates() * x)))
        score = next(s for s in answer.findings["scores"] if s["part"] == "fit")
        said = only_noise(answer.findings)
        told[said] += 1
        assert least > 0.9 * score["rmse"] if said else least < 0.9 * score["rmse"] or not _white(answer.findings)
    assert min(told.values()) >= 3


def _rates() -> np.ndarray:
    return np.linspace(3.0, 5.2, 2000)[:, None]


def _white(findings) -> bool:
    return all(r["white"] for r in findings["residual_tests"])


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({}, True),
        ({"white": False}, False),
        ({"white": False, "shared": "slot"}, True),  # the errors of an encoder's slots come back
        ({"white": False, "shared": "slot", "independent": False}, False),  # beside a response that is missing
        ({"memory": 0.6}, False),  # moves slowly: more than the noise from sample to sample
        ({"samples": 15}, False),  # that four parameters may follow whatever they are
        ({"output": "z"}, False),  # an output without a test
    ],
)
def test_only_noise_needs_tests_with_samples(change, said):
    n = change.get("samples", 200)
    e = np.random.default_rng(0).normal(size=n)
    for k in range(1, n):
        e[k] += change.get("memory", 0.0) * e[k - 1]
    own = {"recording": "run", "output": change.get("output", "y")}
    findings = {
        "scores": [own | {"part": "fit", "n": n, "fit_percent": 90.0}],
        "residual_tests": [
            {
                "recording": "run",
                "output": "y",
                "white": change.get("white", True),
                "shared": change.get("shared"),
                "cross": {"u": {"independent": change.get("independent", True)}},
            }
        ],
        "parameters": [{}] * 4,
        "recordings": [
            {
                "name": "run",
                "outputs": {"y": {"part": ["fit"] * n, "measured": e, "simulated": np.zeros(n), "unit": None}},
            }
        ],
    }
    assert only_noise(findings) == said
