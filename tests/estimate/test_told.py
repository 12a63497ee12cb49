"""What is said of several filters: once where it is the same, of each by itself where it is not."""

import pytest

from plantfit.estimate.methods.told import verdict_of
from plantfit.findings.results.estimated import (
    EstimatedParameter,
    EstimateOfMethod,
    EstimatesByMethod,
    FilterOfEstimate,
    InnovationSize,
)


def record(memories, held, sentences=("The innovations are as large as the filter expects.",) * 2):
    """Of EKF and UKF: correlations of neighbouring innovations, whether intervals hold the truth 2, and what is said
    of their size."""
    filters = [
        FilterOfEstimate(
            method=m, memory={"y": r}, log_likelihood=0.0,
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
        ("good", "EKF, UKF: The innovations are as large as the filter expects.")
    ]
    (narrow,) = (s for level, s in told if level == "warning")
    assert narrow.startswith(
        "EKF, UKF: neighbouring innovations are correlated (0.40 of y): intervals of filters are too narrow"
    )
    assert ("info", "By each of EKF, UKF, 1 of 1 intervals hold the truth.") in told


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


@pytest.mark.parametrize("memory", [0.0, 0.09, -0.09, None])
def test_nothing_is_said_of_correlations_that_are_small(memory):
    assert not any("correlated" in s for _, s in said((memory, memory), (True, True)))
