"""A residual that lies in one short stretch, where the record and not the model is odd."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from plantfit.findings import read_findings
from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.validate.residuals.one_stretch import one_stretch
from plantfit.trust.verdict.residuals import noise_sentences, residual_sentences

N, H = 1500, 0.1
PLANTS = {"lag": ([2.0], [0.7, 1.0]), "oscillator": ([4.5], [1.0, 1.2, 9.0]), "two lags": ([1.0], [0.5, 1.5, 1.0])}


def output(plant, u):
    b, a, _ = cont2discrete(PLANTS[plant], H)
    return lfilter(b.ravel(), a, u)


def steps(rng, held=50):
    return np.repeat(rng.uniform(-2.0, 2.0, N // held + 1), held)[:N]


def found(t, measured, simulated, u):
    return one_stretch(t, measured - simulated, simulated, [u])


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("clocked", [False, True])
def test_lost_rows_are_placed(plant, clocked):
    """The plant is simulated on without the rows that were lost: what it misses decays. Without a gap of the clock
    it is told where inputs and simulation are at such levels elsewhere, too."""
    told = tried = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u = steps(rng)
        place = int(rng.integers(300, 1100))
        kept = np.r_[0:place, place + 63 : N]
        y = output(plant, u)
        if abs(y[place + 63] - y[place]) < 0.3 * np.std(y):
            continue  # it came back to where it was
        t = H * (kept if clocked else np.arange(len(kept)))
        stretch = found(t, y[kept] + 0.002 * np.std(y) * rng.normal(size=len(kept)), output(plant, u[kept]), u[kept])
        tried += 1
        if stretch is None:
            continue
        told += 1
        assert t[place] - 0.5 <= stretch.begin <= t[place] + 0.5
        assert stretch.share >= 0.75
        assert stretch.samples <= 0.1
        assert stretch.gap == (pytest.approx(64 * H) if clocked else None)
    assert tried >= 25
    assert told >= (0.9 if clocked else 0.7) * tried


@pytest.mark.parametrize("seed", range(20))
def test_a_wrong_model_is_not_told_as_a_wrong_record(seed):
    rng = np.random.default_rng(seed)
    t = H * np.arange(N)
    noise = 0.02 * rng.normal(size=N)
    for held in (50, 300):
        u = steps(rng, held)
        y = output("two lags", u)
        assert found(t, y + noise, output("lag", u) / 2.0, u) is None  # a lag is missing
        assert found(t, 1.1 * y + noise, y, u) is None  # another gain
        top = np.quantile(y, 0.95)  # an end of the sensor, reached where the simulation goes beyond
        assert found(t, np.minimum(y, top) + 0.1 * noise, y, u) is None
    one = np.where(t > 60.0, 1.0, 0.0)  # a single step: all there is to miss is missed there
    assert found(t, output("two lags", one) + noise, output("lag", one) / 2.0, one) is None
    u = steps(rng)
    # another initial value
    assert found(t, output("lag", u) + 3.0 * np.exp(-t / 0.7) + noise, output("lag", u), u) is None
    # it runs away at the end
    assert found(t, output("lag", u) + np.exp((t - t[-1]) / 5.0) + noise, output("lag", u), u) is None


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.99, 1.0])
def test_noise_with_a_memory_lies_in_no_stretch(memory):
    t, rng = H * np.arange(N), np.random.default_rng(1)
    u = steps(rng)
    for _ in range(100):
        noise = lfilter([1.0], [1.0, -memory], rng.normal(size=N))
        assert found(t, output("lag", u) + noise - noise.mean(), output("lag", u), u) is None


@pytest.mark.parametrize(("lost", "clocked"), [(0, False), (63, False), (63, True)])
def test_the_verdict_says_where_the_record_is_odd_and_blames_no_response(lost, clocked):
    rng = np.random.default_rng(15)
    u = steps(rng)
    kept = np.r_[0:600, 600 + lost : N]
    y = output("oscillator", u)[kept] + 0.01 * rng.normal(size=len(kept))
    t = H * (kept if clocked else np.arange(len(kept)))
    bounds = {n: {"bounds": b} for n, b in (("m", (0.05, 1.0)), ("c", (0.05, 1.0)), ("k", (0.5, 8.0)))}
    model = equations(
        "p' = v; v' = (u - c*v - k*p)/m; y = p", inputs=["u"], states=["p", "v"], outputs=["y"], parameters=bounds
    )
    answer = fit(Problem(model, Recording(t, {"u": Signal(u[kept]), "y": Signal(y)})), budget=500, seed=1)
    (test,) = read_findings(answer.findings).residual_tests
    said = [s["sentence"] for s in (*residual_sentences(answer.findings), *noise_sentences(answer.findings))]
    assert (test.stretch is not None) is bool(lost)
    assert ("of their squares lie from t = " in said[0]) is bool(lost)
    assert ("a gap of the clock of 6.4 s, over which inputs are held" in said[0]) is clocked
    assert ("look at the record there for lost rows" in said[0]) is (bool(lost) and not clocked)
    assert ("most of it in that stretch" in said[1]) is bool(lost)
    assert not any("the model's response to it is incomplete" in s or "a better model" in s for s in said)
    for name, value in (("m", 1 / 4.5), ("c", 1.2 / 4.5), ("k", 2.0)):
        assert answer.values[name] == pytest.approx(value, rel=0.05)
