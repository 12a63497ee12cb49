"""Derivatives, smoothers and cut-offs against closed forms, the textbook recursion and the full hat matrix."""

from math import factorial
from typing import Any

import numpy as np
import pytest

import plantfit.recording as rec
from plantfit.errors import RecordingError
from plantfit.recording.signals.differentiation import compare_derivatives
from plantfit.recording.signals.smoother import _cross_validation, _System, kalman_smoother

STEP = 2 * np.pi / 10_000
EVEN = np.arange(2000) * 0.002


def uneven(n=300, seed=0, period=0.01):
    return np.cumsum(period * (1 + 0.5 * np.random.default_rng(seed).random(n)))


def textbook(t, y, q, r, m):
    """Kalman filter and Rauch-Tung-Striebel recursion: (states, log-likelihood but for a constant)."""
    x, P = np.zeros(m), 1e8 * np.eye(m)
    kept, likelihood = [], 0.0
    for k, yk in enumerate(y):
        h = t[k] - t[k - 1] if k else 0.0
        F = np.array([[h ** (j - i) / factorial(j - i) if j >= i else 0.0 for j in range(m)] for i in range(m)])
        power = np.array([[2 * m - 1 - i - j for j in range(m)] for i in range(m)])
        scale = np.array([[factorial(m - 1 - i) * factorial(m - 1 - j) for j in range(m)] for i in range(m)])
        if k:
            x, P = F @ x, F @ P @ F.T + q * h**power / (power * scale)
        ahead = x, P
        S, e = P[0, 0] + r**2, yk - x[0]
        likelihood -= 0.5 * (e**2 / S + np.log(S))
        x, P = x + P[:, 0] / S * e, P - np.outer(P[:, 0], P[0]) / S
        kept.append((F, ahead, (x, P)))
    states = [x]
    for k in range(len(y) - 2, -1, -1):
        (F, (xp, Pp), _), (_, _, (x, P)) = kept[k + 1], kept[k]
        states.append(x + P @ F.T @ np.linalg.solve(Pp, states[-1] - xp))
    return np.array(states[::-1]), likelihood


@pytest.mark.parametrize("m", [2, 3])
def test_kalman_smoother_is_the_textbook_recursion_on_uneven_steps(m):
    t = uneven()
    y = np.sin(5 * t) + 0.01 * np.random.default_rng(1).standard_normal(len(t))
    fc, r = 6.0, 0.01
    q = (2 * np.pi * fc) ** (2 * m) * r**2 * np.median(np.diff(t))
    wanted, _ = textbook(t, y, q, r, m)
    found = kalman_smoother(t, y, fc, order=m).states
    np.testing.assert_allclose(found / np.abs(wanted).max(axis=0), wanted / np.abs(wanted).max(axis=0), atol=1e-6)


def test_likelihood_is_that_of_the_recursion_up_to_a_constant():
    t = uneven()
    y = np.sin(5 * t) + 0.01 * np.random.default_rng(1).standard_normal(len(t))
    system = _System(t, y, 3)
    differences = []
    for fc in (3.0, 6.0, 12.0):
        at = system.solve(fc)
        q = (2 * np.pi * fc) ** 6 * 1e-4 * system.h
        differences.append(-0.5 * (at.squares / 1e-4 + at.log_determinant) - textbook(t, y, q, 0.01, 3)[1])
    assert np.ptp(differences) < 1e-3


@pytest.mark.parametrize("fc", [2.0, 5.0])
def test_cross_validation_uses_the_trace_of_the_hat_matrix(fc):
    t = uneven(150)
    y = np.sin(5 * t) + 0.01 * np.random.default_rng(1).standard_normal(len(t))
    hat = np.array([kalman_smoother(t, e, fc).states[:, 0] for e in np.eye(len(t))]).T
    wanted = np.log(np.sum((hat @ y - y) ** 2)) - 2 * np.log(len(t) - np.trace(hat))
    assert _cross_validation(_System(t, y, 3), fc) == pytest.approx(wanted, abs=1e-5)


@pytest.mark.parametrize("frequency", [2.0, 5.0, 9.0])
def test_kalman_smoother_has_the_gain_of_a_zero_phase_butterworth(frequency):
    wave = np.sin(2 * np.pi * frequency * EVEN)
    middle = slice(600, 1400)
    found = kalman_smoother(EVEN, wave, 5.0).states[middle, 0]
    assert found @ wave[middle] / (wave[middle] @ wave[middle]) == pytest.approx(
        1 / (1 + (frequency / 5.0) ** 6), abs=2e-3
    )


@pytest.mark.parametrize("method", ["central", "savgol", "butterworth", "spline", "kalman"])
@pytest.mark.parametrize("derivative", [1, 2])
def test_derivatives_of_a_clean_wave(method, derivative):
    t = EVEN
    r = rec.from_arrays(t, signals={"q": (np.sin(4 * t), "rad")})
    settings: dict[str, Any] = {"cutoff": 30.0} if method in ("butterworth", "kalman") else {}
    r = rec.differentiate(r, "q", method=method, derivative=derivative, **settings)
    true = (4 * np.cos(4 * t), -16 * np.sin(4 * t))[derivative - 1]
    name = "q" + "d" * derivative
    np.testing.assert_allclose(r[name][100:-100], true[100:-100], atol=0.01)
    assert r.signals[name].unit == "rad" + "/s" * derivative


@pytest.mark.parametrize("method", ["central", "kalman", "spline"])
def test_uneven_steps_are_taken_as_they_are(method):
    t = uneven(600, period=0.004)
    r = rec.from_arrays(t, signals={"q": np.sin(4 * t)})
    settings: dict[str, Any] = {"cutoff": 30.0} if method == "kalman" else {}
    r = rec.differentiate(r, "q", "w", method=method, **settings)
    np.testing.assert_allclose(r["w"][50:-50], 4 * np.cos(4 * t[50:-50]), atol=0.005)


def test_forward_rates_held_between_samples_give_the_signal_back():
    t = uneven(200, period=0.004)
    r = rec.from_arrays(t, signals={"N": (np.floor(1e3 * np.sin(4 * t)), "counts")})
    r = rec.differentiate(r, "N", "rate", method="forward")
    np.testing.assert_allclose(
        r["N"][0] + np.concatenate([[0.0], np.cumsum(r["rate"][:-1] * np.diff(t))]), r["N"], atol=1e-9
    )
    assert r["rate"][-1] == r["rate"][-2]
    assert r.signals["rate"].unit == "counts/s"
    with pytest.raises(RecordingError, match="2 samples are too few for this method; use a longer recording"):
        rec.differentiate(
            rec.from_arrays(np.arange(2.0), signals={"y": (np.arange(2.0), "m")}, name="short"), "y", method="central"
        )
    with pytest.raises(RecordingError, match="first derivative only; use 'central'"):
        rec.differentiate(r, "N", "a", method="forward", derivative=2)


def test_ignoring_jitter_would_be_far_worse():
    t = uneven(600, period=0.004)
    honest, blind = (
        kalman_smoother(axis, np.sin(4 * t), 30.0).states[50:-50, 1] - 4 * np.cos(4 * t[50:-50])
        for axis in (t, np.linspace(t[0], t[-1], len(t)))
    )
    assert np.std(blind) > 20 * np.std(honest)


def test_a_clock_that_rounds_does_not_scale_a_derivative():
    true = np.arange(2000) * 0.0204
    made = rec.differentiate(rec.from_arrays(np.round(true, 3), signals={"q": 3.0 * true}), "q", "w")
    np.testing.assert_allclose(made["w"], 3.0, rtol=1e-4)


def test_butterworth_asks_for_a_grid_from_the_real_time_stamps():
    r = rec.from_arrays(uneven(), signals={"q": np.sin(uneven())})
    with pytest.raises(RecordingError, match=r"resample\(recording"):
        rec.differentiate(r, "q", method="butterworth", cutoff=5.0)


@pytest.mark.parametrize("rule", ["likelihood", "residual", "discrepancy"])
def test_rules_find_the_noise_and_a_useful_cutoff(rule):
    noise = 0.01
    y = np.sin(2 * EVEN) + 0.5 * np.sin(7 * EVEN)
    r = rec.from_arrays(EVEN, signals={"q": y + noise * np.random.default_rng(3).standard_normal(len(EVEN))})
    found = rec.cutoff_frequency(r, "q", rule, noise=noise if rule == "discrepancy" else None)
    assert found.noise == pytest.approx(noise, rel=0.05)
    true = 2 * np.cos(2 * EVEN) + 3.5 * np.cos(7 * EVEN)

    def error(cutoff):
        made = rec.differentiate(r, "q", "w", method="butterworth", cutoff=cutoff)["w"]
        return np.std((made - true)[100:-100])

    assert error(found.frequency) < 3.5 * min(error(fc) for fc in np.geomspace(2, 60, 15))


def test_encoder_steps_are_found_by_the_likelihood():
    y = np.round((np.sin(2 * EVEN) + 0.5 * np.sin(7 * EVEN)) / STEP) * STEP
    found = rec.cutoff_frequency(rec.from_arrays(EVEN, signals={"q": (y, "rad")}), "q")
    assert found.noise == pytest.approx(STEP / np.sqrt(12), rel=0.1)
    assert f"{found.frequency:.3g} Hz" in found.sentence


def test_rule_is_named_in_the_log_of_a_filter():
    r = rec.from_arrays(
        EVEN, signals={"q": np.sin(7 * EVEN) + 0.01 * np.random.default_rng(0).standard_normal(len(EVEN))}
    )
    cutoff = rec.cutoff_frequency(r, "q", "residual", order=2)
    by_rule, by_number = rec.lowpass(r, "q", "residual"), rec.lowpass(r, "q", cutoff.frequency)
    np.testing.assert_array_equal(by_rule["q"], by_number["q"])
    assert by_rule.log[-1].endswith(cutoff.sentence)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rule": "eye"}, "use one of"),
        ({"rule": "discrepancy"}, "needs noise="),
        ({"rule": "discrepancy", "noise": 1e9}, "no cut-off removes"),
        ({"rule": "likelihood", "noise": -1.0}, "above 0"),
        ({"signal": "p"}, "no signal 'p'"),
    ],
)
def test_bad_cutoffs_are_refused(settings, words):
    r = rec.from_arrays(EVEN, signals={"q": np.sin(7 * EVEN)})
    given: dict[str, Any] = {"signal": "q", **settings}
    with pytest.raises(RecordingError, match=words):
        rec.cutoff_frequency(r, **given)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"derivative": 3}, "give 1 or 2"),
        ({"method": "guess"}, "use one of"),
        ({"method": "kalman", "order": 1}, "from 2 to 4"),
        ({"method": "kalman", "cutoff": 1e-4}, "ill-conditioned"),
        ({"method": "butterworth"}, "needs cutoff="),
    ],
)
def test_bad_settings_are_refused(settings, words):
    r = rec.from_arrays(EVEN, signals={"q": np.sin(7 * EVEN)})
    with pytest.raises(RecordingError, match=words):
        rec.differentiate(r, "q", **settings)


def test_choice_of_method_shows_in_the_errors():
    w = np.array([2.0, 7.0])
    rows = compare_derivatives(
        EVEN,
        lambda t: np.sin(np.outer(t, w)).sum(axis=1),
        lambda t: (w * np.cos(np.outer(t, w))).sum(axis=1),
        lambda t: (-(w**2) * np.sin(np.outer(t, w))).sum(axis=1),
        step=STEP,
    )
    by = {(r.settings["method"], r.settings.get("cutoff")): r for r in rows}
    plain, smoothed = by["central", None], by["kalman", "likelihood"]
    # differences of rounded values: noise step/sqrt(12) times sqrt(2)/(2 h), and sqrt(6)/(4 h^2)
    assert plain.velocity == pytest.approx(STEP / np.sqrt(12) * np.sqrt(2) / 0.004, rel=0.1)
    assert smoothed.velocity < plain.velocity / 10
    assert smoothed.acceleration < plain.acceleration / 30


def test_presliding_follows_dahl_and_holds_at_rest():
    d = 0.01
    path = np.concatenate([np.linspace(0, 0.05, 400), np.full(50, 0.05), np.linspace(0.05, 0.02, 300)])
    r = rec.presliding(rec.from_arrays(np.arange(len(path)) * 0.01, signals={"q": (path, "rad")}), "q", "z", d)
    np.testing.assert_allclose(r["z"][:400], 1 - np.exp(-path[:400] / d), atol=1e-12)
    assert np.ptp(r["z"][400:450]) == 0
    turned = r["z"][449]
    np.testing.assert_allclose(r["z"][450:], -1 + (1 + turned) * np.exp(-(0.05 - path[450:]) / d), atol=1e-12)
    with pytest.raises(RecordingError, match="above 0"):
        rec.presliding(r, "q", "z2", 0.0)
