"""Errors that come back, as those of an encoder's slots at every turn: their intervals against closed forms and by
how often they hold."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.errors import RecordingError
from plantfit.models.text.equations import equations
from plantfit.problem import Experiment, Problem
from plantfit.problem.measure.long_run import prewhitened_long_run
from plantfit.recording import Recording, Signal
from plantfit.trust.intervals.covariance import Block, covariance
from plantfit.trust.intervals.linearised import linearise

SLOTS, TURNS = 60, 8
LINE = equations("y = a + b*u", inputs=["u"], outputs=["y"], parameters={n: {"bounds": (-5.0, 5.0)} for n in "ab"})


def experiment(seed, shared=True, edges=False):
    """y = 1 + 2 u, errors of 60 places that come back in each of 8 turns; with `edges` those of two edges, which
    neighbours share."""
    rng = np.random.default_rng(seed)
    place = np.tile(np.arange(SLOTS), TURNS)
    e = rng.normal(size=SLOTS)
    e = e - np.roll(e, 1) if edges else e
    t = np.arange(len(place)) * 0.1
    u = np.sin(0.37 * t)
    signals = {
        "u": Signal(u),
        "y": Signal(1 + 2 * u + 0.3 * e[place] + 0.1 * rng.normal(size=len(t))),
        "place": Signal(place.astype(float)),
    }
    return Experiment(Recording(t, signals, "turns"), shared_errors={"y": "place"} if shared else {})


def spread_and_claim(shared, edges):
    """Standard deviation of a over 300 records, and the root of the mean square of what was claimed."""
    found, claimed = [], []
    for seed in range(300):
        r = experiment(seed, shared, edges).recording
        matrix = 10.0 * np.c_[np.ones(len(r.t)), r["u"]]  # of the unit cube's coordinates, 10 wide
        z = np.linalg.lstsq(matrix, r["y"])[0]
        block = Block(slice(0, len(r.t)), r["place"].astype(int) if shared else np.arange(len(r.t)))
        found.append(z[0])
        claimed.append(covariance(matrix, matrix @ z - r["y"], [block], np.ones(2, bool))[0, 0])
    return 10 * np.std(found), 10 * np.sqrt(np.mean(claimed))


def test_scores_of_one_error_add_up_before_they_are_squared():
    scores, place = np.array([[1.0], [2.0], [4.0], [-3.0]]), np.array([5, 3, 5, 3])
    assert prewhitened_long_run(scores, place)[0, 0] == pytest.approx((1 + 4) ** 2 + (2 - 3) ** 2)
    np.testing.assert_allclose(prewhitened_long_run(scores, np.arange(4)), scores.T @ scores)


def test_errors_that_come_back_are_claimed_as_large_as_they_are():
    true, claimed = spread_and_claim(shared=True, edges=False)
    # the mean of 60 errors of 0.3 and 480 of 0.1
    assert true == pytest.approx(np.sqrt(0.09 / 60 + 0.01 / 480), rel=0.12)
    assert claimed == pytest.approx(true, rel=0.15)
    unaware = spread_and_claim(shared=False, edges=False)
    assert unaware[1] < 0.5 * unaware[0]


def test_edges_between_slots_cancel_over_a_turn():
    true, claimed = spread_and_claim(shared=True, edges=True)
    assert true < 0.25 * 0.3 * np.sqrt(2 / 60)  # of errors that are independent
    assert claimed < 0.8 * 0.3 * np.sqrt(2 / 60)
    assert claimed > true


def test_samples_without_a_number_have_errors_of_their_own():
    e = experiment(1)
    none = Signal(np.full(len(e.recording.t), np.nan))
    blind = Experiment(
        Recording(e.recording.t, {**e.recording.signals, "place": none}, "turns"), shared_errors={"y": "place"}
    )
    z = np.array([0.6, 0.7])
    plain = linearise(Problem(LINE, experiment(1, shared=False)), z)
    np.testing.assert_allclose(linearise(Problem(LINE, blind), z).covariance, plain.covariance, rtol=1e-12)


def test_numbers_that_are_none_are_refused():
    with pytest.raises(RecordingError, match="'u' has others"):
        Experiment(experiment(1).recording, shared_errors={"y": "u"})
    with pytest.raises(RecordingError, match="name one of them"):
        Experiment(experiment(1).recording, shared_errors={"y": "slot"})
    with pytest.raises(RecordingError, match="names 'u', which is no output of the model; its outputs are y"):
        Problem(LINE, Experiment(experiment(1).recording, shared_errors={"u": "place"}))
