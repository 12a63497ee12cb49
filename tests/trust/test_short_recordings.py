"""Recordings too short for tests of white noise of their own are tested together."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit as pf
from plantfit.trust.diagnosis import asked_for
from plantfit.trust.validate.residuals.residual_tests import short_recordings
from plantfit.trust.verdict.fit import fit_sentences


def left(rng, lengths, taken):
    """White noise (n,) of each recording, less its part along `taken` random smooth directions of all, as a fit
    leaves it."""
    n = sum(lengths)
    t = np.concatenate([np.arange(k) / k for k in lengths])
    basis = np.linalg.qr(np.exp(-np.outer(t, rng.uniform(0.5, 4.0, taken))))[0] if taken else np.zeros((n, 0))
    e = rng.standard_normal(n)
    e -= basis @ (basis.T @ e)
    return np.split(e, np.cumsum(lengths)[:-1])


@pytest.mark.parametrize(("lengths", "taken"), [((12,), 2), ((8, 10, 9), 0), ((8, 10, 9), 3), ((15,) * 6, 4)])
def test_white_noise_passes(lengths, taken):
    rng = np.random.default_rng([len(lengths), taken])
    found = [short_recordings(left(rng, lengths, taken)) for _ in range(2000)]
    assert np.mean([f is None or f[1] <= 0.01 for f in found]) <= 0.013


def test_what_drifts_does_not_pass_and_too_few_samples_are_not_tested():
    rng = np.random.default_rng(5)
    t = np.linspace(0, 1, 10)
    found = [
        short_recordings([np.sin(6 * t + k) + 0.3 * rng.standard_normal(10) for k in range(3)]) for _ in range(200)
    ]
    assert np.mean([f is not None and f[1] <= 0.01 for f in found]) > 0.95
    assert short_recordings([np.ones(6), np.ones(5)]) is None
    assert short_recordings([np.zeros(30)]) is None


def batch(seed, order, start, name, noise=0.02):
    """A reaction of first or second order, sampled 10 times."""
    t = np.linspace(0.0, 20.0, 10)
    y = solve_ivp(lambda _, c: -0.25 * c**order, (0, 20), [start], t_eval=t, rtol=1e-9, atol=1e-12).y[0]
    return pf.Recording(t, {"y": pf.Signal(y + noise * np.random.default_rng(seed).standard_normal(10), "1")}, name)


def answer(order, seed, noise=0.02):
    model = pf.equations(
        "c' = -k*c\ny = c", states={"c": {"unit": "1", "initial": "c0"}}, outputs={"y": "1"},
        parameters={"k": "1/s", "c0": "1"},
    )  # fmt: skip
    records = {f"b{i}": batch(10 * seed + i, order, s, f"b{i}", noise) for i, s in enumerate((1.0, 2.0, 3.0))}
    own = {"k": (0.01, 2.0), "c0": pf.Parameter((0.1, 5.0), per_recording=True)}
    return pf.fit(pf.Problem(model, records, own), budget=600, seed=1)


@pytest.mark.thorough
def test_a_wrong_order_of_three_batches_is_told_and_a_right_one_is_not():
    wrong = str(answer(2, 1).verdict)
    assert "The residuals of y are not white (correlation" in wrong
    assert "3 recordings of few samples taken together" in wrong
    assert "The residuals of y are not white: if the model lacks something" in wrong
    for seed in range(8):
        right = answer(1, seed)
        assert not asked_for(right.findings)
        assert right.findings["short_recordings"][0]["white"]
        assert "not white" not in str(right.verdict)


@pytest.mark.thorough
def test_what_such_recordings_lack_is_looked_for():
    wrong = answer(2, 1)
    assert not wrong.findings["residual_tests"]
    assert asked_for(wrong.findings)
    made = wrong.diagnose()
    assert made is not None
    first = made["rounds"][0]
    assert set(first["found"]) == {"drag of c by its square", "change of k with c"}  # the truth, and what is as good
    assert first["likely"] == "very likely"


@pytest.mark.thorough
def test_what_a_solver_leaves_is_nothing_that_the_model_lacks():
    assert "not white" not in str(answer(1, 1, noise=0.0).verdict)


@pytest.mark.parametrize(("off", "level"), [(0.0, "info"), (1.0, "bad")])
def test_short_pieces_that_hardly_move_are_followed_as_well_as_noise_lets(off, level):
    """A fit of -3 % of one of many pieces was called bad, whatever its noise."""
    rng, records, scores = np.random.default_rng(2), [], []
    for k in range(30):
        simulated = (0.02 if k % 3 else 5.0) * np.linspace(-1.0, 1.0, 10)
        measured = simulated + rng.normal(size=10) + off * np.linspace(-2.0, 2.0, 10)
        one = {"part": ["fit"] * 10, "measured": list(measured), "simulated": list(simulated), "unit": "mm"}
        records.append({"name": f"run-{k}", "outputs": {"y": one}})
        rmse = np.sqrt(np.mean((measured - simulated) ** 2))
        scores.append({"recording": f"run-{k}", "output": "y", "part": "fit", "rmse": rmse, "unit": "mm", "n": 10,
                       "fit_percent": 100.0 * (1.0 - rmse / np.std(measured))})  # fmt: skip
    (said,) = fit_sentences({"recordings": records, "scores": scores})
    assert said["level"] == level
    assert ("what is left is noise from sample to sample" in said["sentence"]) == (not off)
