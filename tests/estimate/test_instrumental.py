"""Instrumental variables against closed forms, and intervals against the truth of many drawn records."""

import numpy as np
import pytest
from scipy.signal import lfilter

from plantfit.errors import SearchError
from plantfit.estimate import instrumental_variables
from plantfit.estimate.whitening import usable, whitening
from plantfit.problem.measure.long_run import degrees_of_freedom

TRUTH = np.array([2.0, -1.0])


def drawn(seed, n=600, rho=0.0, blur=0.7):
    """Columns with errors of standard deviation `blur`, target with AR(1) errors, and the columns without errors."""
    rng = np.random.default_rng(seed)
    clean = np.c_[np.sin(np.arange(n) / 9.0) * np.sqrt(2.0), lfilter([0.6], [1.0, -0.8], rng.normal(size=n))]
    e = 0.5 * np.sqrt(1 - rho**2) * lfilter([1.0], [1.0, -rho], rng.normal(size=n))
    return clean + blur * rng.normal(size=clean.shape), clean @ TRUTH + e, clean


def test_least_squares_is_drawn_to_zero_as_theory_says_and_instruments_are_not():
    plain, unbiased = np.zeros(2), np.zeros(2)
    for seed in range(40):
        x, y, clean = drawn(seed, n=2000)
        plain += instrumental_variables(x, y, x, whiten=False).values / 40
        unbiased += instrumental_variables(x, y, clean).values / 40
    # attenuation (C + S)^-1 C of the columns' covariance C by that of their errors S
    np.testing.assert_allclose(plain, np.linalg.solve(np.eye(2) * (1 + 0.49), np.eye(2) @ TRUTH), atol=0.03)
    np.testing.assert_allclose(unbiased, TRUTH, atol=0.03)


def test_without_whitening_values_are_the_closed_form_and_least_squares_its_special_case():
    x, y, clean = drawn(1)
    np.testing.assert_allclose(
        instrumental_variables(x, y, clean, whiten=False).values, np.linalg.solve(clean.T @ x, clean.T @ y), rtol=1e-10
    )
    np.testing.assert_allclose(
        instrumental_variables(x, y, x, whiten=False).values, np.linalg.lstsq(x, y)[0], rtol=1e-10
    )


def test_the_covariance_of_white_errors_is_that_of_the_textbook():
    x, y, clean = drawn(2, n=4000)
    estimate = instrumental_variables(x, y, clean, whiten=False)
    r, a = y - x @ estimate.values, np.linalg.inv(clean.T @ x)
    np.testing.assert_allclose(
        estimate.standard_error, np.sqrt(np.diag(a @ clean.T @ clean @ a.T) * np.mean(r**2)), rtol=0.08
    )


def test_influences_are_what_leaving_a_sample_out_does():
    # HC3 is the jackknife: (Z'X)^-1 z r / (1 - h) is the change when that sample is left out
    x, y, clean = drawn(3, n=60)
    estimate = instrumental_variables(x, y, clean, whiten=False)
    assert estimate.influence is not None
    for out in (0, 17, 59):
        rest = np.delete(np.arange(60), out)
        without = np.linalg.solve(clean[rest].T @ x[rest], clean[rest].T @ y[rest])
        np.testing.assert_allclose(estimate.influence[out], estimate.values - without, rtol=1e-8)


@pytest.mark.parametrize("rho", [0.0, 0.9])
def test_intervals_hold_the_truth_as_often_as_they_say(rho):
    held, seeds = np.zeros(2), 120
    for seed in range(seeds):
        x, y, clean = drawn(seed, rho=rho)
        e = instrumental_variables(x, y, clean)
        held += (e.low <= TRUTH) & (e.high >= TRUTH)
    assert np.all(held / seeds >= 0.90), held / seeds
    assert np.all(held / seeds <= 0.995), held / seeds


def one_move(seed, rho=0.0, length=5, n=300):
    """The second column is there in one short move only."""
    rng = np.random.default_rng(seed)
    clean = np.c_[np.sin(np.arange(n) / 9.0), np.zeros(n)]
    clean[200 : 200 + length, 1] = np.hanning(length + 2)[1:-1] * np.where(np.arange(length) % 2, 2.0, -2.0)
    e = 0.5 * np.sqrt(1 - rho**2) * lfilter([1.0], [1.0, -rho], rng.normal(size=n))
    return clean + 0.05 * rng.normal(size=clean.shape), clean @ TRUTH + e, clean


@pytest.mark.parametrize("whiten", [True, False])
@pytest.mark.parametrize(("rho", "length"), [(0.0, 5), (0.0, 8), (0.8, 5)])
@pytest.mark.further(3)
def test_intervals_of_what_one_short_move_tells_are_wider_and_hold_the_truth(rho, length, whiten):
    found, sides = [], []
    for seed in range(300):
        x, y, clean = one_move(seed, rho, length)
        e = instrumental_variables(x, y, clean, whiten=whiten)
        found.append((e.low <= TRUTH) & (e.high >= TRUTH))
        sides.append((e.values - TRUTH) / e.standard_error)
        assert e.degrees is not None
        assert e.degrees[1] < 2 * length
        assert e.degrees[0] > 8
    held = np.mean(found, axis=0)
    assert np.all(held >= 0.90), held
    assert np.median(np.abs(np.array(sides)[:, 1])) > 0.15  # 0.67 for a standard error that is right: no blanket


def test_degrees_of_freedom_of_alike_rows_are_their_number_and_of_few_rows_theirs():
    scores = np.random.default_rng(1).normal(size=(2000, 1))
    white = degrees_of_freedom(scores, np.ones((2000, 1)), np.arange(2000))[0]
    assert 400 < white <= 2000  # a kernel of a few lags takes some
    few = np.zeros((2000, 1))
    few[[5, 500, 1000, 1500]] = 1.0
    assert degrees_of_freedom(scores, few, np.arange(2000))[0] == pytest.approx(4.0)
    assert degrees_of_freedom(scores, np.zeros((2000, 1)), np.arange(2000))[0] == np.inf


def test_whitening_narrows_intervals_where_errors_last():
    wide = narrow = 0.0
    for seed in range(20):
        x, y, clean = drawn(seed, rho=0.95, blur=0.05)
        wide += instrumental_variables(x, y, clean, whiten=False).standard_error[0]
        narrow += instrumental_variables(x, y, clean).standard_error[1]
        errors = instrumental_variables(x, y, clean)
    assert errors.order >= 1
    assert narrow < 0.7 * wide


def test_the_autoregression_of_two_outputs_is_found():
    a1, a2 = np.array([[1.2, 0.1], [0.0, 0.5]]), np.array([[-0.5, 0.0], [0.2, 0.0]])
    rng = np.random.default_rng(0)
    r = np.zeros((20_000, 2))
    noise = rng.normal(size=r.shape) @ np.array([[1.0, 0.6], [0.0, 0.3]])
    for k in range(2, len(r)):
        r[k] = a1 @ r[k - 1] + a2 @ r[k - 2] + noise[k]
    found = whitening(r, np.arange(len(r)), 5)
    assert found.order == 2
    np.testing.assert_allclose(found.filters, [a1, a2], atol=0.03)
    white = found(r, usable(np.arange(len(r)), 2))
    np.testing.assert_allclose(white.T @ white / len(white), np.eye(2), atol=0.03)
    assert abs(np.mean(white[1:, 0] * white[:-1, 0])) < 0.03


def test_whitening_does_not_reach_over_gaps():
    assert usable(np.array([0, 1, 2, 3, 10, 11, 12]), 2).tolist() == [2, 3, 6]
    assert usable(np.array([0, 5, 9]), 0).tolist() == [0, 1, 2]


def test_a_noisy_output_counts_for_less():
    rng = np.random.default_rng(1)
    clean = rng.normal(size=(500, 2, 1))
    y = clean[:, :, 0] * 3.0 + rng.normal(size=(500, 2)) * [0.1, 10.0]
    estimate = instrumental_variables(clean, y, clean)
    assert estimate.standard_error[0] == pytest.approx(0.1 / np.sqrt(500), rel=0.15)
    assert abs(estimate.values[0] - 3.0) < 4 * estimate.standard_error[0]


def test_instruments_are_made_anew_until_the_values_settle():
    x, y, clean = drawn(5)
    asked = []

    def instruments(values):
        asked.append(values["a"])
        return clean * (1.0 + 0.3 * np.sin(values["a"] + np.arange(len(clean)) / 50.0)[:, None])

    estimate = instrumental_variables(x, y, instruments, ("a", "b"), start=clean)
    assert estimate.iterations == len(asked) >= 2
    assert abs(asked[-1] - estimate.named["a"]) <= 0.01 * estimate.standard_error[0]


@pytest.mark.parametrize(
    ("x", "y", "z", "options", "said"),
    [
        (np.ones((9, 2)), np.ones(8), np.ones((9, 2)), {}, "with a target"),
        (np.ones((9, 2)), np.ones(9), np.ones((9, 3)), {}, "one for each column"),
        (np.ones((9, 2)), np.ones(9), np.ones((9, 2)), {}, "do not tell them apart"),
        (np.ones((9, 2)), np.ones(9), np.ones((9, 2)), {"names": ("a",)}, "1 names for"),
        (np.full((9, 1), np.nan), np.ones(9), np.ones((9, 1)), {}, "regressor is not finite at sample 0"),
        (np.ones((9, 1)), np.ones(9), np.full((9, 1), np.inf), {}, "instruments are not finite"),
        (np.ones((4, 2)), np.ones(4), np.ones((4, 2)), {}, "give at least 5"),
        (np.ones((9, 1)), np.ones(9), np.ones((9, 1)), {"index": np.zeros(9)}, "numbers that grow"),
    ],
)
def test_what_cannot_be_estimated_is_told_in_a_sentence(x, y, z, options, said):
    with pytest.raises(SearchError, match=said):
        instrumental_variables(x, y, z, **options)
