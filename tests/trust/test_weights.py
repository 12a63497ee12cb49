"""Scales that a user gave are held, the others are estimated, and everyone is told who chose them."""

import json

import numpy as np
import pytest
from test_agreement import two_outputs

from plantfit.errors import SpaceError, SpecError
from plantfit.experiment_design import design
from plantfit.findings import read_findings
from plantfit.fitting import fit
from plantfit.intervals_compared import compare_intervals
from plantfit.models import equations
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.measure.scale_source import GIVEN, SPREAD, UNIT, ScaleSource
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.report import summary_text, write_report
from plantfit.trust.verdict.all_sentences import _steps
from plantfit.trust.verdict.weights import weight_sentences


@pytest.mark.parametrize(
    ("given", "held", "estimated"),
    [
        ({"y": 0.2, "w": 3.0}, {"y": 0.2, "w": 3.0}, {}),
        ({"w": 3.0}, {"w": 3.0}, {"y": 0.05}),
        (None, {}, {"y": 0.05, "w": 0.4}),
    ],
)
def test_given_scales_are_held_and_missing_ones_estimated(given, held, estimated, tmp_path):
    problem = two_outputs(given)
    assert {o: s for o, s in problem.scale_sources.items()} == {o: GIVEN if o in held else SPREAD for o in ("y", "w")}
    found = fit(problem, seed=1)
    assert {o: found.problem.scales[o] for o in held} == held  # to the bit
    assert {o: found.problem.scales[o] for o in estimated} == pytest.approx(estimated, rel=0.15)
    rows = {row["output"]: row for row in found.findings["weights"]}
    for o in ("y", "w"):
        assert rows[o]["scale"] == found.problem.scales[o]
        assert rows[o]["who"] == (
            "given" if o in held else f"estimated from the residuals in {rows[o]['rounds']} rounds"
        )
    # with the scales in force the residuals of each output are what the scores say
    rmse = found.score("fit")
    expected = np.mean([(rmse[o] / found.problem.scales[o]) ** 2 for o in ("y", "w")])
    assert found.best.cost == pytest.approx(expected, rel=1e-6)
    [sentence] = [v["sentence"] for v in found.findings["verdict"] if "count as 1" in v["sentence"]]
    text, page = summary_text(found.findings), write_report(found.findings, tmp_path / "r.html").read_text()
    for o in ("y", "w"):
        assert f"{o} {found.problem.scales[o]:.3g} ({rows[o]['who']})" in sentence
        assert rows[o]["who"] in text
        assert rows[o]["who"] in page


def test_given_scales_change_the_answer():
    """Squares of the state weigh nothing in one fit, and almost all in the other."""
    light, heavy = (fit(two_outputs({"y": 0.05, "w": w}), seed=1) for w in (100.0, 0.001))
    assert light.score("fit")["y"] < heavy.score("fit")["y"]
    assert heavy.score("fit")["w"] < light.score("fit")["w"]


def test_estimated_scales_are_stable_and_do_not_depend_on_the_units():
    found = fit(two_outputs(), seed=1)
    assert all(source.settled and source.kind == "residuals" for source in found.problem.scale_sources.values())
    assert {o: found.score("fit")[o] for o in ("y", "w")} == pytest.approx(dict(found.problem.scales), rel=1e-4)


def test_one_output_and_variants_keep_who_chose():
    problem = two_outputs({"w": 3.0})
    assert problem.with_scales({"y": 1.0}).scale_sources == {"y": GIVEN, "w": GIVEN}
    estimated = ScaleSource("residuals", 3)
    assert problem.with_scales({"y": 1.0}, estimated).scale_sources == {"y": estimated, "w": GIVEN}
    assert problem.scale_sources == {"y": SPREAD, "w": GIVEN}
    assert problem.with_simulator(problem.predictor.stepping().refined(2)).scale_sources == problem.scale_sources
    with pytest.raises(SpaceError, match="scales names 'z'"):
        two_outputs({"z": 1.0})
    assert UNIT.kind == "unit"


def test_findings_made_before_there_were_weights_still_load():
    record = json.loads(json.dumps(fit(two_outputs(), seed=1).findings))
    for row in record["runs"]:
        del row["ended"]
    del record["weights"], record["agreement"]
    old = read_findings(record)
    assert old.weights == []
    assert old.agreement is None
    assert "count as 1" not in summary_text({**record, "verdict": []})


def seen_rarely(samples, noise, seed=0):
    """A first-order plant, y at all samples and w, whose gain nobody knows, at few: two of them can be followed
    exactly."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 10.0, 200)
    u = np.repeat(rng.normal(size=20), 10)
    declared = {
        "K": {"bounds": (0.1, 10.0)},
        "tau": {"bounds": (0.05, 5.0)},
        "b": {"bounds": (-5.0, 5.0)},
        "c": {"bounds": (-50.0, 50.0)},
    }
    model = equations(
        "x' = (K*u - x)/tau\ny = x\nw = b*x + c", inputs=["u"], states=["x"], outputs=["y", "w"], parameters=declared
    )
    clean = Problem(model, Recording(t, {n: Signal(u) for n in ("u", "y", "w")}), substeps=8).predict(
        np.array([2.0, 0.7, 1.5, 20.0])
    )
    y, w = (clean[n] + s * rng.normal(size=len(t)) for n, s in (("y", 0.05), ("w", noise)))
    w = np.where(np.isin(np.arange(len(t)), samples), w, np.nan)
    return Problem(model, Recording(t, {"u": Signal(u), "y": Signal(y), "w": Signal(w)}))


@pytest.mark.parametrize("seed", range(3))
def test_a_scale_does_not_go_to_zero_where_few_samples_are_followed_exactly(seed):
    problem = seen_rarely([60, 150], noise=0.4, seed=seed)
    found = fit(problem, seed=1)
    assert found.values["K"] == pytest.approx(2.0, abs=0.06)
    assert found.values["tau"] == pytest.approx(0.7, abs=0.06)
    source = found.problem.scale_sources["w"]
    assert (source.kind, source.settled) == ("few samples", True)
    assert found.problem.scales["w"] == pytest.approx(0.01 * np.nanstd(problem.experiments["recording"].recording["w"]))
    assert found.problem.scales["y"] == pytest.approx(0.05, rel=0.2)
    [said] = [v for v in found.findings["verdict"] if "count as 1" in v["sentence"]]
    assert said["level"] == "warning"
    assert said["sentence"].endswith(
        "so that it fixes no parameter. Give a scale for w if you know the size of the errors."
    )
    rows = {row["name"]: row for row in found.findings["parameters"]}
    assert {n: rows[n]["status"] for n in ("K", "tau")} == {"K": "determined", "tau": "determined"}
    assert {"b", "c"}.isdisjoint(n for n, row in rows.items() if row["status"] == "determined" or row["standard_error"])
    [exact] = [v["sentence"] for v in found.findings["verdict"] if "simulation of w" in v["sentence"]]
    assert exact.endswith("% of the spread of the samples, beside which the residual is nothing: negligible.")
    assert "it has no more samples than there are free parameters" in said["sentence"]


def test_few_samples_whose_errors_show_have_the_scale_of_their_errors():
    found = fit(seen_rarely([20, 60, 110, 150], noise=0.4), seed=1)
    assert found.problem.scale_sources["w"].kind == "residuals"
    assert 0.1 < found.problem.scales["w"] < 0.8


@pytest.mark.thorough
def test_bootstrap_and_profile_have_no_interval_of_what_rests_on_unknown_noise():
    said = "so the bootstrap has no interval of {}."
    for given in (False, True):
        problem = seen_rarely([60, 150], noise=0.4)
        found = fit(problem.with_scales({"y": 0.05, "w": 0.4}) if given else problem, seed=1)
        compared = compare_intervals(found, kinds=("profile", "bootstrap"), replicates=50).typed
        told = " ".join(v.sentence for v in compared.verdict)
        for row in compared.parameters:
            kinds = {k.kind: k for k in row.kinds}
            rests = row.name in ("b", "c") and not given
            assert (said.format(row.name) in told) is rests
            assert (kinds["bootstrap"].low is None) is rests
            assert kinds["profile"].open_low is rests
            if row.name == "b" and given:
                low, high = kinds["profile"].low, kinds["profile"].high
                assert row.standard_error is not None
                assert low is not None
                assert high is not None
                assert high - low == pytest.approx(2 * 1.96 * row.standard_error, rel=0.1)


def test_a_next_experiment_asks_for_a_noise_that_nothing_shows():
    problem = seen_rarely([60, 150], noise=0.4)
    found = fit(problem, seed=1)
    with pytest.raises(
        SpecError, match=r"Nothing shows how large the errors of w are: .* Give its noise, as in --noise w=0.1"
    ):
        design(found, inputs={"u": (-2.0, 2.0)}, duration=5.0, budget=200)
    told = design(found, inputs={"u": (-2.0, 2.0)}, duration=5.0, noise={"w": 0.4}, draws=1, budget=200)
    assert told.typed.parameters


@pytest.mark.parametrize(
    ("residual", "error", "said", "level"),
    [
        (0.0, 2e-5, "beside which the residual is nothing: negligible.", "good"),
        (1e-9, 1e-3, "beside which the residual is nothing: not negligible: ask for more substeps.", "warning"),
        (1e-2, 1e-4, "off by 1 % of the residual: negligible.", "good"),
        (1e-2, 1e-3, "off by 10 % of the residual: not negligible: ask for more substeps.", "warning"),
    ],
)
def test_errors_of_the_simulation_are_held_to_what_says_something(residual, error, said, level):
    outputs = {"y": {"measured": [0.0, 2.0, None, 9.0], "part": ["fit", "fit", "fit", "validation"]}}
    row = {"unit": None, "max_error": error, "rms_error": error, "rms_residual": residual}
    findings = {
        "recordings": [{"name": "a", "outputs": outputs}],
        "simulation": {"checked_with": "LSODA", "outputs": {"y": row}},
    }
    (told,) = _steps(findings)
    assert told["sentence"].endswith(said)
    assert told["level"] == level
    outputs["y"]["measured"][1] = 0.0  # a constant that is followed exactly: nothing can be said
    assert (
        list(
            _steps(
                {**findings, "simulation": {"checked_with": "LSODA", "outputs": {"y": {**row, "rms_residual": 0.0}}}}
            )
        )
        == []
    )


def test_a_scale_that_is_given_tells_the_errors_of_what_is_followed_exactly():
    found = fit(seen_rarely([60, 150], noise=0.4).with_scales({"y": 0.05, "w": 0.4}), seed=1)
    x = found.simulated["recording"]["y"][[60, 150]]
    error = {row["name"]: row["standard_error"] for row in found.findings["parameters"]}
    assert error["b"] == pytest.approx(0.4 * np.sqrt(2.0) / abs(x[1] - x[0]), rel=0.15)
    assert error["c"] == pytest.approx(0.4 * np.hypot(x[0], x[1]) / abs(x[1] - x[0]), rel=0.15)


@pytest.mark.parametrize(
    ("few", "said"),
    [
        ((), ""),
        (("a",), "it fixes no parameter. Give a scale for a"),
        (("a", "b"), "they fix no parameter. Give scales for a, b"),
    ],
)
def test_scales_are_asked_for_where_few_samples_cannot_show_them(few, said):
    row = {"unit": None, "scale": 1.0, "chosen": "residuals", "who": "w", "settled": True}
    (told,) = weight_sentences({"weights": [{**row, "output": o, "few": o in few} for o in ("a", "b", "c")]})
    assert (said or "w).") in told["sentence"]
    assert ("Give" in told["sentence"]) is bool(few)
    assert told["level"] == ("warning" if few else "info")


def praised(found, output):
    """What the verdict says in favour of an output, but of the steps of its simulation."""
    said = [
        v for v in found.findings["verdict"] if "simulation" not in v["sentence"] and "count as 1" not in v["sentence"]
    ]
    return [v["sentence"] for v in said if v["level"] == "good" and f" {output} " in v["sentence"]]


@pytest.mark.parametrize(
    ("samples", "given"),
    [([60, 150], False), ([60, 150], True), ([20, 60, 110, 150], False), (range(5, 200, 9), False)],
)
def test_what_could_not_fail_is_not_praised(samples, given):
    problem = seen_rarely(samples, noise=0.4)
    found = fit(problem.with_scales({"y": 0.05, "w": 0.4}) if given else problem, seed=1)
    (score,) = [s for s in found.findings["scores"] if s["output"] == "w"]
    (told,) = [v for v in found.findings["verdict"] if v["sentence"].startswith("The model follows w")]
    if len(samples) == 2:
        assert score["spare"] == pytest.approx(0.0, abs=0.01)
        assert told["level"] == "warning"
        assert told["sentence"].endswith(
            "these 2 are no more than the free parameters that follow "
            "them, so that this shows nothing: give more samples of w."
        )
        assert praised(found, "w") == []
    else:
        assert "spare" not in score or score["spare"] == pytest.approx(2.0, abs=0.1)
        assert told["level"] != "warning" or score["fit_percent"] < 80
        assert "shows nothing" not in told["sentence"]
    assert any("follows y" in s for s in praised(found, "y"))


def test_unseen_samples_are_compared_with_nothing_where_fitted_ones_could_not_miss():
    for samples, compared in (([60, 110, 150, 170, 190], False), (range(5, 200, 9), True)):
        problem = seen_rarely(samples, noise=0.4)
        record = problem.experiments["recording"].recording
        own = Problem(
            problem.model,
            Experiment(record, fit=(0.0, 7.0 if compared else 5.6), validate=(7.0 if compared else 5.6, 10.0)),
        )
        found = fit(own, seed=1)
        (told,) = [
            v
            for v in found.findings["verdict"]
            if v["sentence"].startswith("On samples it has not seen, the RMSE of w")
        ]
        assert ("times that of the fitted samples" in told["sentence"]) is compared
        assert told["sentence"].endswith("do not tell how large it may be.") is not compared
        assert compared or told["level"] == "info"


def line(u, noise, seed, given=None, free=("a", "b")):
    """A straight line without time through as many points as there are `u`."""
    rng = np.random.default_rng(seed)
    declared = {n: {"bounds": (-10.0, 10.0)} for n in free}
    model = equations(f"y = a*u + {'b' if 'b' in free else '1'}", inputs=["u"], outputs=["y"], parameters=declared)
    u = np.asarray(u, dtype=float)
    record = Recording(
        np.arange(len(u), dtype=float), {"u": Signal(u), "y": Signal(1.5 * u + 1.0 + noise * rng.normal(size=len(u)))}
    )
    return Problem(model, record, scales=given)


@pytest.mark.parametrize("seed", range(5))
def test_two_points_of_a_line_fix_nothing_unless_their_errors_are_known(seed):
    """The only output, no time: classical errors of a residual of nothing were those of rounding."""
    found = fit(line([1.0, 4.0], 0.3, seed), seed=1)
    rows = {row["name"]: row for row in found.findings["parameters"]}
    assert {row["status"] for row in rows.values()} == {"flat"}
    said = " ".join(v["sentence"] for v in found.findings["verdict"])
    assert "The data determine" not in said
    assert "Nothing shows how large the errors of y are, so that it fixes no parameter. Give a scale for y" in said
    assert found.findings["weights"][0]["chosen"] == "unit"
    known = fit(line([1.0, 4.0], 0.3, seed, given={"y": 0.3}), seed=1)
    rows = {row["name"]: row for row in known.findings["parameters"]}
    assert rows["a"]["standard_error"] == pytest.approx(0.3 * np.sqrt(2.0) / 3.0, rel=1e-3)
    assert rows["b"]["standard_error"] == pytest.approx(0.3 * np.hypot(1.0, 4.0) / 3.0, rel=1e-3)
    assert rows["a"]["high"] - rows["a"]["low"] == pytest.approx(2 * 1.96 * rows["a"]["standard_error"], rel=1e-2)
    compared = compare_intervals(known, kinds=("profile", "bootstrap"), replicates=50).typed
    (profile,) = [k for k in compared.parameters[0].kinds if k.kind == "profile"]
    assert any(
        v.sentence.startswith("Refits do not move a, for its samples are followed exactly") for v in compared.verdict
    )
    assert (profile.low, profile.high) == pytest.approx((rows["a"]["low"], rows["a"]["high"]), rel=0.02)


@pytest.mark.parametrize(("u", "free"), [([1.0, 4.0], "a"), ([1.0, 4.0, 5.0], "ab"), ([1.0, 2.0, 3.0, 4.0, 9.0], "ab")])
def test_more_points_than_parameters_show_their_errors(u, free):
    found = fit(line(u, 0.3, 3, free=free), seed=1)
    assert found.problem.scale_sources["y"] == UNIT
    assert all(row["standard_error"] for row in found.findings["parameters"])
    assert "shows nothing" not in " ".join(v["sentence"] for v in found.findings["verdict"])


@pytest.mark.parametrize(("fits", "told"), [((99.99, 60.0), "y"), ((98.0, 60.0), None), ((), "y and z")])
def test_what_still_changes_is_followed_exactly_or_not_said_to_be(fits, told):
    row = {"scale": 1.0, "unit": None, "who": "estimated", "chosen": "residuals", "settled": False}
    rows = [{**row, "output": o} for o in "yz"]
    scores = [{"output": o, "part": "fit", "fit_percent": f} for o, f in zip("yz", fits, strict=False)]
    (said,) = weight_sentences({"weights": rows, "scores": scores})
    assert said["level"] == "warning"
    assert ("grows without end" in said["sentence"]) == (told is not None)
    assert f"Give a scale for {told}:" in said["sentence"] or told is None
    (said,) = weight_sentences({"weights": [{**r, "settled": True} for r in rows], "scores": scores})
    assert said["level"] == "info"
