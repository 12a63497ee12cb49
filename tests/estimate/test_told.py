"""What is said of several filters: once where it is the same, of each by itself where it is not."""

from types import SimpleNamespace

import numpy as np
import pytest

from plantfit.estimate.methods.estimates_record import innovation_memory, memory_by_chance
from plantfit.estimate.methods.told import _memory, verdict_of
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
