"""What is said of several filters: once where it is the same, of each by itself where it is not."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from plantfit.estimate.methods.estimates_record import innovation_memory, memory_by_chance
from plantfit.estimate.methods.told import _memory, verdict_of
from plantfit.findings.results.estimated import (
    CorrelatedNoise,
    EstimatedParameter,
    EstimateOfMethod,
    EstimatesByMethod,
    FilterOfEstimate,
    InnovationSize,
    MethodPair,
)


def record(memories, held, sentences=("The innovations are as large as the filter expects.",) * 2):
    """Of EKF and UKF: correlations of neighbouring innovations, whether intervals hold the truth 2, and what is said
    of their size."""
    filters = [
        FilterOfEstimate(
            method=m, memory={"y": r}, chance={"y": 0.26}, log_likelihood=0.0,
            nis=InnovationSize(mean=1.0, low=0.9, high=1.1, p=0.5, consistent="expects" in told, sentence=told),
        )
        for m, r, told in zip(("EKF", "UKF"), memories, sentences, strict=True)
    ]  # fmt: skip
    estimates = {
        m: EstimateOfMethod(value=2.0, standard_error=0.1, low=1.8 if inside else 2.1, high=2.3, at_bound=False)
        for m, inside in zip(("EKF", "UKF"), held, strict=True)
    }
    known = EstimatedParameter(name="K", unit=None, truth=2.0, estimates=estimates)
    return EstimatesByMethod(
        name="lag", methods=["EKF", "UKF"], parameters=[known], noise=[], filters=filters, agreement=[], assumed=[],
        log_likelihood=None,
        agree=None,
    )  # fmt: skip


def said(*given):
    return [(s.level, s.sentence) for s in verdict_of(record(*given), None)]


def test_what_is_the_same_of_both_is_said_once():
    told = said((0.4, 0.4), (True, True))
    assert [s for s in told if "as large as" in s[1]] == [
        ("good", "EKF and UKF: The innovations are as large as the filter expects.")
    ]
    (narrow,) = (s for level, s in told if level == "warning")
    assert narrow.startswith(
        "EKF and UKF: neighbouring innovations are correlated (0.40 of y): intervals of filters are too narrow"
    )
    assert ("info", "By each of EKF and UKF, 1 of 1 intervals hold the truth.") in told


def test_what_differs_is_said_of_each():
    told = said(
        (0.02, -0.3), (True, False), ("The innovations are as large as the filter expects.", "They are twice as large.")
    )
    assert ("good", "EKF: The innovations are as large as the filter expects.") in told
    assert ("warning", "UKF: They are twice as large.") in told
    (wide,) = (s for _, s in told if "correlated" in s)
    assert wide.startswith(
        "UKF: neighbouring innovations are correlated (-0.30 of y): intervals of filters are too wide"
    )
    assert ("info", "Of EKF, 1 of 1 intervals hold the truth.") in told
    assert ("info", "Of UKF, 0 of 1 intervals hold the truth, not K.") in told


@pytest.mark.parametrize(
    ("methods", "names"),
    [(["EKF", "UKF"], "EKF and UKF"), (["least squares", "EKF", "UKF"], "Least squares, EKF and UKF")],
)
def test_methods_that_agree_are_told_with_and(methods, names):
    pair = MethodPair(
        first=methods[0], second="UKF", statistic=1.0, degrees=1, p=0.4, sentence="They differ.", p_adjusted=0.4,
        differs=False,
    )  # fmt: skip
    found = record((0.0, 0.0), (True, True)).model_copy(update={"methods": methods, "agreement": [pair]})
    assert verdict_of(found, None)[0].sentence.startswith(f"{names} agree: no two differ")
    apart = found.model_copy(update={"agreement": [pair.model_copy(update={"differs": True})]})
    assert "agree" not in " ".join(s.sentence for s in verdict_of(apart, None))


@pytest.mark.parametrize("memory", [0.0, 0.09, -0.09, -0.2, None])
def test_nothing_is_said_of_correlations_that_are_small(memory):
    assert not any("correlated" in s for _, s in said((memory, memory), (True, True)))


def test_white_innovations_of_few_samples_are_not_called_correlated():
    """Of 36 samples half have a correlation of neighbours above 0.1, of 1000 samples hardly one has."""
    rng = np.random.default_rng(1)
    for n, most in ((36, 0.02), (1000, 0.02)):
        found = []
        for _ in range(1000):
            e = rng.standard_normal(n)
            run = SimpleNamespace(
                plant=SimpleNamespace(model=SimpleNamespace(outputs=["y"])),
                y=e[:, None], rank=np.arange(n), told={"white": e[:, None]},
            )  # fmt: skip
            memory, chance = innovation_memory([run]), memory_by_chance([run])  # pyrefly: ignore[bad-argument-type]
            found.append(bool(_memory(memory, chance)))
        assert np.mean(found) <= most
    slow = np.convolve(rng.standard_normal(40), [1.0, 0.9])
    run.y, run.rank, run.told = slow[:, None], np.arange(41), {"white": slow[:, None]}
    assert _memory(innovation_memory([run]), memory_by_chance([run]))  # pyrefly: ignore[bad-argument-type]


def of_noise(**changes):
    """What is said of generalised least squares whose intervals are half as long as those of least squares."""
    usual: dict[str, Any] = {
        "output": "y", "unit": "V", "deviation": 0.5, "order": 1, "correlation": 0.7, "samples": 400,
        "independent": 70.0, "left": 0.02, "shared": None, "form": None,
    }  # fmt: skip
    noise = CorrelatedNoise(**usual | changes)
    ends: dict[str, tuple[float | None, float | None]] = {
        "least squares": (1.8, 2.2), "generalised least squares": (1.9, 2.1),
    }  # fmt: skip
    if noise.independent < 8:
        ends["generalised least squares"] = (None, None)
    estimates = {
        m: EstimateOfMethod(value=2.0, standard_error=0.1, low=low, high=high, at_bound=False)
        for m, (low, high) in ends.items()
    }
    made = EstimatesByMethod(
        name="lag", methods=list(ends), parameters=[
            EstimatedParameter(name="K", unit=None, truth=None, estimates=estimates)
        ], noise=[], filters=[], correlated=[noise], agreement=[], assumed=[], log_likelihood=None, agree=None,
    )  # fmt: skip
    return [(s.level, s.sentence) for s in verdict_of(made, None)]


def test_noise_that_is_left_white_is_told_and_no_warning_given():
    taken, shorter = of_noise()
    assert taken == (
        "info",
        "Generalised least squares: the noise of y is 0.5 V, and correlated between neighbours (0.70, order 1): 400 "
        "samples tell as much as 70 independent ones.",
    )
    assert shorter[0] == "info"
    assert "are 0.5 times as long as those of least squares" in shorter[1]
    assert of_noise(order=0, correlation=0.0, independent=400.0)[0][1].endswith("0.5 V, and white.")


@pytest.mark.parametrize(("left", "words"), [(0.3, "too narrow"), (-0.3, "too wide"), (0.12, None), (-0.05, None)])
def test_residuals_that_stay_correlated_are_a_warning(left, words):
    """Of 400 samples 0.129 comes by chance in 1 %."""
    warned = [s for level, s in of_noise(left=left) if level == "warning"]
    assert (len(warned) == 1 and words in warned[0]) if words else not warned


def test_slow_noise_warns_and_the_slowest_has_no_intervals():
    assert [level for level, s in of_noise(independent=15.0) if "times as long" in s] == ["warning"]
    told = of_noise(independent=0.4)
    assert any(level == "warning" and "no intervals" in s for level, s in told)
    assert not any("times as long" in s for _, s in told)
    assert "tell as much as one." in told[0][1]


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ("edges in proportion", "errors of 2 % at edges that neighbouring numbers share"),
        ("own", "errors of 0.02 V of every number"),
    ],
)
def test_shared_errors_are_told_in_their_unit(form, words):
    assert words in of_noise(form=form, shared=0.02)[0][1]
    assert "shared_errors" not in of_noise()[0][1]
