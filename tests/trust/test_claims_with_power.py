"""Sentences on inputs, unseen samples and noise are said where a test could have told the contrary, and only there."""

import re

import numpy as np
import pytest
from scipy.signal import lfilter, lsim, lti

from plantfit.findings import Score
from plantfit.report.sections.tables import scores_table
from plantfit.report.text import _scores
from plantfit.trust.validate.residuals.residual_tests import (
    cross_correlation,
    explained_by_past,
    independent,
    whiteness,
)
from plantfit.trust.verdict.fit import fit_sentences
from plantfit.trust.verdict.outputs import noise_rows
from plantfit.trust.verdict.parameters import parameter_sentences
from plantfit.trust.verdict.residuals import residual_sentences
from plantfit.trust.verdict.unseen import failing, unseen_sentences


def findings(measured, simulated, u=None, rmse=1.0, unseen=None, percent=90.0):
    """A record of one output y of input u; `unseen` is the RMSE on unseen samples, `percent` the fit there."""
    residual = np.asarray(measured) - simulated
    own, p = whiteness(residual)
    cross = {}
    if u is not None:
        c = cross_correlation(residual, u)
        cross = {"u": {"bound": c.bound, "independent": independent(c), "explained": explained_by_past(residual, u)}}
    score = {"recording": "run", "output": "y", "unit": "V", "bias": 0.0}
    scores = [{**score, "part": "fit", "rmse": rmse, "fit_percent": 90.0}]
    scores += [] if unseen is None else [{**score, "part": "validation", "rmse": unseen, "fit_percent": percent}]
    test = {
        "recording": "run",
        "output": "y",
        "autocorrelation": own.values.tolist(),
        "white": p > 0.01,
        "p_value": p,
        "cross": cross,
    }
    output = {"unit": "V", "measured": list(measured), "simulated": list(simulated), "part": ["fit"] * len(residual)}
    return {"recordings": [{"name": "run", "outputs": {"y": output}}], "scores": scores, "residual_tests": [test]}


def noise(n, memory, seed=1):
    return np.asarray(lfilter([1.0], [1.0, -memory], np.random.default_rng(seed).normal(size=n)))


@pytest.mark.parametrize(("memory", "slow_input", "said"), [(0.5, False, True), (0.98, True, False)])
def test_residuals_do_not_follow_inputs_where_they_could_be_seen_to(memory, slow_input, said):
    rng = np.random.default_rng(2)
    u = np.linspace(0.0, 4.0, 400) if slow_input else rng.choice([-1.0, 1.0], 400)
    (told,) = residual_sentences(findings(noise(400, memory), np.zeros(400), u))
    assert "are not white" in told["sentence"]
    assert ("it is no linear response to the inputs" in told["sentence"]) is said


@pytest.mark.parametrize(("omega", "damping"), [(1.2, 0.17), (3.0, 0.4)])
def test_residuals_of_an_oscillation_follow_the_input_though_no_lag_correlates(omega, damping):
    rng = np.random.default_rng(1)
    u = np.repeat(rng.choice([-1.0, 0.0, 1.0, 2.0], 30), 20)
    y = lsim(lti([1.0], [1 / omega**2, 2 * damping / omega, 1.0]), u, 0.1 * np.arange(600), interp=False)[1] - u
    left = y - y.mean() + 0.05 * rng.standard_normal(600)
    assert explained_by_past(left, u) > 0.7
    (told,) = residual_sentences(findings(left, np.zeros(600), u))
    assert "it depends on u" in told["sentence"]


@pytest.mark.parametrize("memory", [0.0, 0.8, 0.95])
def test_residuals_that_know_nothing_of_an_input_are_not_foretold_by_it(memory):
    found = [
        explained_by_past(noise(1500, memory, s), np.repeat(np.random.default_rng(s).normal(size=75), 20))
        for s in range(20)
    ]
    assert np.mean(np.array(found) < 0.05) >= 0.8
    assert max(found) < 0.6


@pytest.mark.parametrize(
    ("percent", "unseen", "level"), [(90.0, 1.1, "good"), (30.0, 1.1, "warning"), (30.0, 3.0, "bad")]
)
def test_unseen_samples_hold_only_where_something_is_explained(percent, unseen, level):
    left = np.sin(np.arange(400) / 40.0) + 0.5 * noise(400, 0.0)
    (told,) = unseen_sentences(findings(left, np.zeros(400), unseen=unseen, percent=percent))
    assert told["level"] == level
    assert told["sentence"].endswith("a fit of 30 % only.") is (level == "warning")
    assert told["sentence"].endswith("it holds.") is (level == "good")


@pytest.mark.parametrize("slow", [True, False])
def test_a_middling_fit_holds_only_where_noise_allows_no_more(slow):
    """60 % explained on fitted and unseen samples alike: what is left is slow, or noise from sample to sample."""
    left = np.sin(np.arange(400) / 40.0) + 0.05 * noise(400, 0.0) if slow else noise(400, 0.0)
    (told,) = unseen_sentences(findings(left, np.zeros(400), unseen=0.9 * float(np.std(left)), percent=60.0))
    assert told["level"] == ("warning" if slow else "good")
    assert told["sentence"].endswith("times the noise from sample to sample.") is slow
    assert told["sentence"].endswith("it holds.") is not slow


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
@pytest.mark.parametrize("times", [0.9, 1.25])
@pytest.mark.parametrize(
    ("percent", "above", "said"),
    [
        (
            98.0,
            59.0,
            "no worse than there, with a fit of 98 %, but",
        ),  # well beside the spread, and badly beside the noise
        (99.93, 10.0, "no worse than there, with a fit of 99.93 %, but"),
        (99.995, 59.0, None),  # a program may leave as much
        (98.0, 2.0, None),
        (90.0, 1.0, None),
    ],
)
def test_a_model_that_misses_many_times_the_noise_does_not_hold_whatever_the_spread(percent, above, said, times, size):
    left = np.sqrt(2.0) * np.sin(np.arange(400) / 40.0) + noise(400, 0.0) / above
    left *= size / float(np.std(left))
    (told,) = unseen_sentences(findings(left, np.zeros(400), rmse=size, unseen=times * size, percent=percent))
    assert told["sentence"].endswith("it holds.") is (said is None)
    assert told["level"] == ("good" if said is None else "info")
    if said:
        assert said in told["sentence"]
        (stated,) = re.findall(r"but ([\d.e+]+) times the noise from sample to sample\.$", told["sentence"])
        assert float(stated) == pytest.approx(times * above, rel=0.25)


@pytest.mark.parametrize("kept", [False, True])
def test_a_split_whose_rest_was_not_measured_is_not_asked_for(kept):
    found = findings(noise(40, 0.0), np.zeros(40))
    if kept:
        own = found["recordings"][0]["outputs"]["y"]
        own |= {k: [*own[k], v] for k, v in (("measured", None), ("simulated", 0.0), ("part", "validation"))}
    (told,) = unseen_sentences(found)
    assert told["sentence"].startswith("No output was measured where samples were kept unseen") is kept
    assert told["sentence"].startswith("Nothing was kept unseen") is not kept


@pytest.mark.parametrize("above", [1.0, 59.0])
def test_many_recordings_do_not_hold_at_many_times_the_noise(above):
    left = np.sqrt(2.0) * np.sin(np.arange(400) / 40.0) + noise(400, 0.0) / above
    found = findings(left, np.zeros(400))
    score = {**found["scores"][0], "part": "validation", "rmse": 1.1, "fit_percent": 97.0}
    rows = [{**score, "recording": f"r{k}"} for k in range(5)]
    (told,) = unseen_sentences({**found, "scores": [*found["scores"], *rows]})
    assert ("it holds (5" in told["sentence"]) is (above == 1.0)
    assert ("at more than 3 times the noise from sample to sample (5" in told["sentence"]) is (above > 1.0)


def test_a_poor_percentage_of_pure_noise_holds():
    (told,) = unseen_sentences(findings(noise(400, 0.0), np.zeros(400), unseen=1.05, percent=1.0))
    assert told["level"] == "good"


def test_rounding_is_no_noise():
    y = 3.0 + noise(400, 0.0)
    assert not list(noise_rows(findings(y, y + 1e-15 * noise(400, 0.0, 3))))
    assert list(noise_rows(findings(y, y + 1e-3 * noise(400, 0.0, 3))))


@pytest.mark.parametrize(("fitted", "level"), [(96.0, "good"), (60.0, "warning")])
def test_few_samples_that_hardly_move_hold_where_those_that_move_are_followed_well(fitted, level):
    """15 samples tell no noise: glucose that is used up stays at zero, and a fit of -5 % says nothing."""
    found = findings(noise(15, 0.0), np.zeros(15), unseen=0.9, percent=-5.0)
    fits = [{**r, "fit_percent": fitted} if r["part"] == "fit" else r for r in found["scores"]]
    (told,) = unseen_sentences({**found, "scores": fits})
    assert told["level"] == level
    assert told["sentence"].endswith("it holds.") is (level == "good")


SLOW = np.sin(np.arange(400) / 40.0)


@pytest.mark.parametrize("ratio", [0.8, 1.31, 1.51, 1.99])
@pytest.mark.parametrize("percent", [-40.0, -1.3, 0.0, 10.0, 33.0, 49.0])
def test_a_useless_fit_does_not_hold_in_part(percent, ratio):
    (told,) = unseen_sentences(findings(SLOW, np.zeros(400), unseen=ratio, percent=percent))
    assert told["level"] == "warning"
    assert "it holds" not in told["sentence"]
    assert (
        f"{'no worse than there, but' if ratio < 1.3 else 'worse than there, and'} a fit of {percent:.0f} % only."
        in told["sentence"]
    )


@pytest.mark.parametrize("ratio", [1.31, 1.51, 1.99])
@pytest.mark.parametrize("percent", [51.0, 60.0, 79.0, 95.0, None])
def test_a_fit_that_is_worse_on_unseen_samples_holds_in_part(percent, ratio):
    (told,) = unseen_sentences(findings(SLOW, np.zeros(400), unseen=ratio, percent=percent))
    assert told["level"] == "warning"
    assert told["sentence"].endswith("it holds in part.")


@pytest.mark.parametrize("poor", [0, 1, 3, 5])
def test_useless_fits_among_many_recordings_are_told(poor):
    found = findings(SLOW, np.zeros(400))
    score = {**found["scores"][0], "part": "validation"}
    rows = [
        {**score, "recording": f"r{k}", "rmse": (1.0, 1.5)[k % 2], "fit_percent": 90.0 if k >= poor else 20.0}
        for k in range(5)
    ]
    (told,) = unseen_sentences({**found, "scores": [*found["scores"], *rows]})
    assert ("a fit of less than 50 % only" in told["sentence"]) is (poor > 0)
    assert ("it holds" in told["sentence"]) is (poor < 5)
    assert (f"only ({poor}: r0" in told["sentence"]) is (poor > 0)


def misses(ratios, foretold=None, agree=None):
    """A record of recordings whose unseen samples are missed by so many times the fitted RMSE."""
    found = findings(SLOW, np.zeros(400))
    score = {**found["scores"][0], "part": "validation", "foretold": foretold}
    rows = [{**score, "recording": f"r{k}", "rmse": q} for k, q in enumerate(ratios)]
    return {**found, "scores": [*found["scores"], *rows], "heterogeneity": None if agree is None else {"agree": agree}}


@pytest.mark.parametrize("count", [1, 3, 5])
@pytest.mark.parametrize("ratio", [1.4, 1.9, 2.1, 7.65, 80.0])
@pytest.mark.parametrize("agree", [None, True, False])
@pytest.mark.parametrize("share", [None, 0.9, 1.1])
def test_a_miss_counts_unless_it_is_foretold(count, ratio, agree, share):
    found = misses([ratio] * count, None if share is None else share * ratio, agree)
    excused = share == 1.1 and agree is not False
    for told in unseen_sentences(found):
        assert ("the uncertainty of the parameters lets expect" in told["sentence"]) is (excused and ratio > 2)
        assert ("noise and the uncertainty of the parameters let expect" in told["sentence"]) is (excused and ratio < 2)
        assert ("it does not hold there" in told["sentence"]) is (not excused and ratio > 2)
        assert ("it holds in part" in told["sentence"]) is (not excused and ratio < 2)
        assert told["level"] == (("info" if ratio < 2 else "warning") if excused else "warning" if ratio < 2 else "bad")
    assert failing(found) == (["y"] if not excused and ratio > 2 else [])


@pytest.mark.parametrize("count", [1, 2, 3, 5])
@pytest.mark.parametrize(
    ("ratio", "foretold", "said"), [(0.9, None, False), (1.9, None, False), (3.0, None, True), (3.0, 4.0, False)]
)
def test_determined_parameters_of_a_model_that_fails_are_its_own(count, ratio, foretold, said):
    row = {
        "name": "R",
        "unit": "ohm",
        "value": 2.0,
        "standard_error": 0.1,
        "status": "determined",
        "low": 1.8,
        "high": 2.2,
    }
    (told,) = parameter_sentences({**misses([ratio] * count, foretold), "parameters": [row]})
    assert told["sentence"].startswith("The data determine 1 of 1 parameters: R = 2.00 ± 0.10 ohm.")
    assert ("does not hold for unseen samples of y: these are its values" in told["sentence"]) is said
    assert ("if the model lacks something" in told["sentence"]) is not said  # what is left is a sine
    assert told["level"] == ("warning" if said else "info")


STRETCH = {"begin": 1.0, "end": 2.0, "share": 0.9, "samples": 0.02}
NAMED = {"rounds": [{"found": ["dead time of u"]}]}


@pytest.mark.parametrize(
    ("left", "more", "diagnosis", "said"),
    [
        (noise(400, 0.0), {}, None, False),  # white
        (noise(400, 0.9), {}, None, True),
        (SLOW + 0.05 * noise(400, 0.0), {}, None, True),
        (0.3 * SLOW + noise(400, 0.0), {}, None, False),  # not white, and hardly above the noise
        (0.3 * SLOW + noise(400, 0.0), {}, NAMED, True),
        (0.3 * SLOW + noise(400, 0.0), {}, {"rounds": [{"found": []}]}, False),
        (noise(400, 0.0), {}, NAMED, False),
        (SLOW + 0.05 * noise(400, 0.0), {"stretch": STRETCH}, None, False),  # the record is odd, not the model
        (SLOW + 0.05 * noise(400, 0.0), {"shared": "slot"}, None, False),
    ],
)
def test_determined_parameters_of_a_model_that_lacks_something_are_its_own(left, more, diagnosis, said):
    found = findings(left, np.zeros(400))
    found["residual_tests"][0].update(more)
    row = {
        "name": "R",
        "unit": "ohm",
        "value": 2.0,
        "standard_error": 0.1,
        "status": "determined",
        "low": 1.8,
        "high": 2.2,
    }
    (told,) = parameter_sentences({**found, "diagnosis": diagnosis, "parameters": [row]})
    text = (
        "The residuals of y are not white: if the model lacks something, "
        "the plant's values may be others, by more than ± tells."
    )
    assert told["sentence"].endswith(text) is said
    assert told["level"] == ("info" if said else "good")


@pytest.mark.parametrize(
    ("percent", "times"), [(-35266.4, "354 times"), (-101.0, "2.01 times"), (-100.0, None), (-3.0, None), (90.0, None)]
)
def test_a_simulation_that_runs_away_is_told_by_the_rmse_of_the_mean_and_not_in_per_cent(percent, times):
    found = findings(SLOW, np.zeros(400), unseen=1.5, percent=percent)
    fitted = {**found["scores"][0], "fit_percent": percent, "n": 400, "spare": None, "started": None}
    (fit,) = fit_sentences({**found, "scores": [fitted]})
    mean = f"{times} that of a constant at the mean of these samples."
    assert fit["sentence"].endswith(mean) is (times is not None)
    assert fit["sentence"].startswith("The model does not follow y") is (times is not None)
    assert (
        f"The model follows y with an RMSE of 1 V on the fitted samples, a fit of {percent:.1f} %" in fit["sentence"]
    ) is (times is None)
    (unseen,) = unseen_sentences(found)
    assert (f"worse than there, and {times} that of a constant at the mean." in unseen["sentence"]) is (
        times is not None
    )
    assert f"{percent:.0f} %" not in unseen["sentence"] or times is None
    score = Score(
        recording="run", output="y", unit="V", part="fit", n=400, rmse=1.0, bias=0.0, fit_percent=percent, spare=None
    )
    cell = scores_table([score]).rows[0][5]
    assert cell == (f"{times} the mean's RMSE" if times else f"{percent:g} %".replace("-", "\N{MINUS SIGN}"))
    assert (f"{times} the mean's RMSE" in _scores([score])) is (times is not None)


@pytest.mark.parametrize(
    ("percents", "said"),
    [
        ((85.0, 90.0, 70.0, -286.7), "a fit of 90.0 % at best; in r3 the RMSE is 3.87 times that of a constant"),
        (
            (-300.0, -900.0, -400.0, -200.0),
            "in r1 10 times that of a constant at the mean and nowhere less than 3 times",
        ),
        ((85.0, 90.0, 70.0, -86.7), "a fit of -86.7 to 90.0 % (lowest in r3)."),
    ],
)
def test_of_many_recordings_the_one_that_runs_away_is_told_so(percents, said):
    found = findings(SLOW, np.zeros(400))
    score = {**found["scores"][0], "n": 400, "spare": None, "started": None}
    rows = [{**score, "recording": f"r{k}", "fit_percent": p} for k, p in enumerate(percents)]
    (told,) = fit_sentences({**found, "scores": rows})
    assert said in told["sentence"]
    assert ("constant" in told["sentence"]) is (min(percents) < -100.0)
