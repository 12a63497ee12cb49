"""Base parameters of the virtual pendubot from fresh records: unbiased, with intervals that hold."""

import numpy as np
import pytest
from scipy import stats

from plantfit.errors import RecordingError, SimulationError
from plantfit.estimate import InverseDynamics
from plantfit.models.library.pendubot import motor_torque, pendubot_regression
from plantfit.recording.record import Recording, Signal
from plantfit.rig import PendubotRig

RIG = PendubotRig()
TRUTH = np.array(list(RIG.base.values()))
REFERENCE = {"theta1": "theta1_ref", "theta2": "theta2_ref"}


def inverse(**settings):
    return InverseDynamics(
        pendubot_regression("base", joints=(1, 2)),
        {"theta1": ("omega1", "alpha1"), "theta2": ("omega2", "alpha2")},
        lambda s: {"tau1": motor_torque(s["V"], s["omega1"]), "tau2": 0.0},
        held=("V",),
        **settings,
    )


def fits(seeds, **settings):
    return [inverse(**settings).fit(RIG.record(seed=s).recording, RIG.noise_free, REFERENCE) for s in seeds]


@pytest.mark.thorough
def test_a_few_records_lie_about_the_truth_as_their_covariance_says():
    chi = []
    for fit in fits(range(3)):
        d = fit.estimate.values - TRUTH
        chi.append(d @ np.linalg.solve(fit.estimate.covariance, d))
        assert fit.bias.p_value < 1e-6  # plain least squares is off, and it is said
        assert fit.bias.sentence.startswith("Plain least squares differs")
        assert fit.estimate.iterations >= 1
    assert stats.chi2.sf(sum(chi), 12) > 1e-3
    assert np.all(fit.estimate.standard_error < [2e-3, 0.03, 5e-5, 0.03] * TRUTH)


def test_without_noise_the_parameters_are_exact():
    clean = RIG.noise_free()
    fit = inverse().fit(clean, RIG.noise_free, REFERENCE)
    np.testing.assert_allclose(fit.estimate.values, TRUTH, rtol=5e-4)


def test_plain_least_squares_depends_on_how_one_differentiates():
    record = RIG.record(seed=5).recording
    off = {}
    for smoothing in (10.0, 50.0):
        bench = inverse(smoothing=smoothing)
        x, y = bench.rows(record)
        off[smoothing] = np.linalg.lstsq(x.reshape(-1, 4), y.ravel())[0] / TRUTH - 1
    assert min(abs(off[10.0][1]), abs(off[50.0][1])) > 0.3


def test_what_is_missing_is_told_in_a_sentence():
    record = RIG.record(seed=1).recording
    with pytest.raises(RecordingError, match="nothing to make instruments of"):
        inverse().fit(record)
    with pytest.raises(RecordingError, match="no signal for 'theta2'"):
        inverse().fit(record, reference={"theta1": "theta1_ref"})
    with pytest.raises(RecordingError, match="band = 900"):
        inverse(band=900.0).rows(record)
    short = Recording(record.t[:40], {n: Signal(s.values[:40], s.unit) for n, s in record.signals.items()}, "short")
    with pytest.raises(
        RecordingError,
        match=r"Recording 'short' has 40 samples, which are too few: .* needs \d+ .*; use a longer recording",
    ):
        inverse().rows(short)
    with pytest.raises(SimulationError, match=r"cannot be simulated at b1 = .* fell"):
        inverse().fit(record, lambda values: RIG.noise_free({**values, "b5": 3.0 * values["b5"]}), REFERENCE)


@pytest.mark.slow
def test_intervals_of_200_fresh_records_hold_the_truth_in_95_percent():
    found = fits(range(5000, 5200))
    held = np.mean([(f.estimate.low <= TRUTH) & (f.estimate.high >= TRUTH) for f in found], axis=0)
    assert np.all(held >= 0.91), held
    scatter, told = (
        np.std([f.estimate.values for f in found], axis=0),
        np.median([f.estimate.standard_error for f in found], axis=0),
    )
    assert np.all((told > 0.9 * scatter) & (told < 1.45 * scatter)), told / scatter
    plain = np.mean([(f.least_squares.low <= TRUTH) & (f.least_squares.high >= TRUTH) for f in found], axis=0)
    assert np.all(plain < 0.05), plain
