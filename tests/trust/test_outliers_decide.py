"""Outliers that hold most of the squares of a residual are told first, and nothing is read from tests that they
decide."""

import numpy as np
import pytest

import plantfit as pf
from plantfit.recording.looks import signal_looks
from plantfit.recording.record import Recording, Signal
from plantfit.trust.verdict.fit import fit_sentences
from plantfit.trust.verdict.outputs import decided_by_outliers
from plantfit.trust.verdict.unseen import failing, unseen_sentences

N = 400


def findings(measured: np.ndarray, simulated: np.ndarray) -> dict:
    recording = Recording(np.arange(N) * 0.1, {"y": Signal(measured, "mm")}, "bench", ())
    looks = [look.record for look in signal_looks(recording, "y", measured=True)]
    y = {"measured": measured.tolist(), "simulated": simulated.tolist(), "part": ["fit"] * N, "unit": "mm"}
    return {"data": looks, "recordings": [{"name": "bench", "outputs": {"y": y}}]}


def motion(rng: np.random.Generator) -> np.ndarray:
    u, x = np.repeat(rng.uniform(-5, 5, N // 40), 40), np.zeros(N)
    for k in range(N - 1):
        x[k + 1] = x[k] + 0.08 * (10 * u[k] - x[k])
    return x


@pytest.mark.parametrize("seed", range(40))
def test_outliers_are_told_of_right_and_wrong_models(seed):
    rng = np.random.default_rng(seed)
    x = motion(rng)
    y = x + rng.normal(size=N)
    at = np.sort(rng.choice(np.arange(5, N - 5, 7), size=rng.integers(1, 8), replace=False))
    y[at] = rng.choice([-4000.0, 8190.0], size=len(at))
    simulated = x if seed % 2 else np.full(N, np.mean(x))  # what is left of the wrong one is much more than noise
    found = decided_by_outliers(findings(y, simulated))
    assert found["bench", "y"][0] == len(at)
    assert found["bench", "y"][1] > 0.9


@pytest.mark.parametrize("seed", range(60))
def test_noise_and_what_a_model_lacks_are_no_outliers(seed):
    rng = np.random.default_rng(seed)
    x = motion(rng)
    noise = [rng.normal(size=N), rng.laplace(size=N), rng.standard_t(5, size=N)][seed % 3]
    late = np.r_[x[:1], x[:-1]] if seed % 2 else x  # a sample of dead time: large errors behind each step alone
    assert decided_by_outliers(findings(late + 0.1 * noise, x)) == {}


def scored(made: dict, count: int) -> dict:
    """The findings of so many recordings alike, with scores."""
    [record] = made["recordings"]
    names = [f"run{k}" for k in range(count)]
    scores = [
        {"recording": n, "output": "y", "unit": "mm", "part": part, "n": N, "rmse": 300.0, "bias": 0.0,
         "fit_percent": 1.0, "spare": None, "started": None, "foretold": None}
        for n in names
        for part in ("fit", "validation")
    ]  # fmt: skip
    looks = [{**look, "recording": n} for n in names for look in made["data"]]
    return {"data": looks, "recordings": [{**record, "name": n} for n in names], "scores": scores, "residual_tests": []}


@pytest.mark.parametrize(("count", "told"), [(1, 1), (3, 3), (6, 1)])
def test_many_recordings_share_a_sentence(count, told):
    x = motion(np.random.default_rng(1))
    y = x + np.random.default_rng(2).normal(size=N)
    for spoiled in (True, False):
        y[200] = 8190.0 if spoiled else x[200]
        found = scored(findings(y, x), count)
        fit, unseen = ([s["sentence"] for s in f(found)] for f in (fit_sentences, unseen_sentences))
        assert sum("of the squares of what is left: take" in s for s in fit) == told * spoiled
        assert sum("so that this tells little" in s for s in unseen) == told * spoiled
        assert bool(failing(found)) is False


@pytest.mark.thorough
def test_the_verdict_of_a_sensor_that_loses_its_echo():
    rng = np.random.default_rng(4)
    t, u = np.arange(N) * 0.05, np.repeat(rng.uniform(-6, 6, N // 40), 40)
    x = np.zeros(N)
    for k in range(N - 1):
        x[k + 1] = 20 * u[k] + (x[k] - 20 * u[k]) * np.exp(-0.05 / 1.5)
    y = 250 + x + 1.5 * rng.normal(size=N)
    y[rng.choice(N, 6, replace=False)] = 8190.0

    def verdict(kept: np.ndarray) -> list[str]:
        recording = Recording(t, {"u": Signal(u, "V"), "d": Signal(kept, "mm")}, "bench", ())
        model = pf.equations(
            "x' = (K*u - x)/T; d = d0 + x", states={"x": "mm"}, inputs={"u": "V"}, outputs={"d": "mm"},
            parameters={"K": "mm/V", "T": "s", "d0": "mm"},
        )  # fmt: skip
        box = {"K": pf.Parameter((1.0, 100.0)), "T": pf.Parameter((0.1, 20.0)), "d0": pf.Parameter((0.0, 500.0))}
        answer = pf.fit(pf.Problem(model, recording, box, split=0.7), seed=1)
        return [s["sentence"] for s in answer.findings["verdict"]]

    said = " ".join(verdict(y))
    assert "outliers hold" in said
    assert "of the squares of what is left: take" in said
    assert "are decided by outliers, so that this tells little" in said
    assert not any(word in said for word in ("are white", "noise floor", "it holds"))
    clean = " ".join(verdict(np.where(y > 8000, np.nan, y)))
    assert "outlier" not in clean
    assert "are white" in clean
    assert "it holds" in clean
