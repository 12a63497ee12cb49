"""An output that moves against the simulation in a part of the record: a sign is wrong there, and only there it is
said."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from plantfit.findings import read_findings
from plantfit.fitting import fit
from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.validate.residuals.turned import turned, turned_records
from plantfit.trust.verdict.residuals import noise_sentences, residual_sentences

N = 1500
T = 0.1 * np.arange(N)


def output(u, numerator=(1.0,), denominator=(1.0, 1.0)):
    b, a, _ = cont2discrete((list(numerator), list(denominator)), 0.1)
    return lfilter(b.ravel(), a, u)


def steps(rng, held=30):
    return np.repeat(rng.uniform(-2.0, 2.0, N // held + 1), held)[:N]


@pytest.mark.parametrize("noise", [0.02, 0.3])
@pytest.mark.parametrize(("first", "last"), [(750, N), (0, 300), (500, 900), (1100, N)])
@pytest.mark.parametrize("offset", [0.0, 5.0])
def test_a_part_of_the_wrong_sign_is_placed(first, last, offset, noise):
    told = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        x = output(steps(rng))
        y = x + noise * np.std(x) * rng.normal(size=N)
        y[first:last] *= -1.0
        if (found := turned(T, y + offset, x)) is None:
            continue
        told += 1
        assert (found.begin, found.end) == pytest.approx((T[first], T[last - 1]), abs=8.0)
        assert found.within < -0.8
        assert found.elsewhere > 0.8
    assert told >= (10 if last - first > 500 else 8)


def slow(rng, level):
    """An input that passes its mean one to eight times."""
    return level + 2.0 * np.sin(2.0 * np.pi * rng.uniform(1.0, 4.0) * T / T[-1] + rng.uniform(0.0, 6.28))


@pytest.mark.parametrize("channel", ["u", "y"])
def test_the_wrong_sign_of_a_slow_record_is_placed_by_what_the_rest_foretells(channel):
    told = 0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = slow(rng, 0.0 if channel == "u" else 3.0)
        x = output(u)
        y = x + 0.05 * np.std(x) * rng.normal(size=N)
        if channel == "y":
            y[450:900] *= -1.0
        else:
            u[450:900] *= -1.0
            x = output(u)
        if (found := turned(T, y, 0.5 * x)) is None:  # as a fit that both parts pull at
            continue
        told += 1
        assert (found.begin, found.end) == pytest.approx((T[450], T[899]), abs=3.0)
    assert told >= 15


def test_slow_records_of_wrong_models_and_slow_noise_do_not_turn():
    for seed in range(40):
        rng = np.random.default_rng(seed)
        u = slow(rng, rng.choice([0.0, 3.0]))
        x = output(u)
        size = np.std(x)
        noise = [lfilter([1.0], [1.0, -memory], rng.normal(size=N)) for memory in (0.9, 0.98, 0.998, 1.0)]
        others = [
            *(x + size * r * e / np.std(e) for e in noise for r in (0.3, 1.0, 3.0)), *noise,
            output(u, [1.0], [6.0, 5.0, 1.0]),
            (u - np.mean(u)) ** 2, -x, np.r_[np.zeros(100), x[:-100]], x + 3.0 * size * (T > 90.0), x + 0.05 * size * T,
            x * np.where(T > 70.0, 0.2, 1.0), output(u, [-1.0, 1.0], [1.0, 2.0, 1.0]),
        ]  # fmt: skip
        assert not [k for k, y in enumerate(others) if turned(T, y, x) is not None]


def test_a_plant_whose_response_has_a_valley_has_no_wrong_sign():
    u = np.interp(T, [0.0, 150.0], [-1.0, 3.0])
    assert turned(T, u**2, u) is None


@pytest.mark.parametrize("held", [20, 50, 150])
def test_wrong_models_do_not_turn(held):
    for seed in range(30):
        rng = np.random.default_rng(seed)
        u = steps(rng, held)
        x = output(u)
        slow = lfilter([1.0], [1.0, -0.98], rng.normal(size=N))
        others = [
            output(u, [1.0], [6.0, 5.0, 1.0]), output(u, [4.5], [1.0, 1.2, 9.0]), output(u, [1.0], [1.0, 0.1, 1.0]),
            x + slow, slow,
            np.cumsum(rng.normal(size=N)), x**2, np.abs(x), -x, np.r_[np.zeros(30), x[:-30]],
            np.r_[np.zeros(100), x[:-100]],
        ]  # fmt: skip
        assert not [k for k, y in enumerate(others) if turned(T, y, x) is not None]


@pytest.mark.parametrize(
    ("channel", "moved"), [("u", "quick"), ("y", "quick"), (None, "quick"), ("u", "slow"), (None, "slow")],
)  # fmt: skip
def test_the_verdict_names_the_part_and_no_better_model(channel, moved):
    rng = np.random.default_rng(12)
    u = steps(rng) if moved == "quick" else slow(rng, 0.0)
    y = output(12.0 * u) + 0.3 * rng.normal(size=N)
    record = {"u": u.copy(), "y": y.copy()}
    if channel:
        record[channel][1000:] *= -1.0
    model = equations(
        "x' = (K*u - x)/tau; y = x", inputs=["u"], states=["x"], outputs=["y"],
        parameters={"K": {"bounds": (0.1, 100.0)}, "tau": {"bounds": (0.01, 20.0)}},
    )  # fmt: skip
    answer = fit(Problem(model, Recording(T, {n: Signal(v) for n, v in record.items()})), budget=400, seed=1)
    (test,) = read_findings(answer.findings).residual_tests
    said = " ".join(s["sentence"] for s in (*residual_sentences(answer.findings), *noise_sentences(answer.findings)))
    assert (test.turned is not None) is bool(channel)
    assert ("y moves against the simulation (correlation -" in said) is bool(channel)
    assert ("the sign of y or of an input may be wrong there." in said) is bool(channel)
    assert "a better model" not in said
    if test.turned:
        assert test.turned.begin == pytest.approx(100.0, abs=3.0)


def _runs(rng, count, wrong, noise=0.1):
    """Recordings of one plant by name, of which those in `wrong` were wired the other way round; their simulation has
    the gain that a fit of all has."""
    found, gain = {}, 1 - 2 * len(wrong) / count
    for k in range(count):
        x = output(steps(rng, int(rng.integers(20, 200))))
        y = (-x if k in wrong else x) + noise * np.std(x) * rng.normal(size=N)
        found[f"r{k}"] = T, y + rng.uniform(-3, 3), (gain or 0.1) * x
    return found


def test_a_recording_of_the_wrong_sign_is_named_and_no_other():
    for seed in range(40):
        rng = np.random.default_rng(seed)
        count = int(rng.integers(3, 8))
        wrong = set(rng.choice(count, int(rng.integers(1, (count + 1) // 2)), replace=False).tolist())
        told = turned_records(_runs(rng, count, wrong, rng.uniform(0, 0.5)))
        assert set(told) == {f"r{k}" for k in wrong}
        assert all(t.throughout and t.within < -0.8 < 0.5 < t.elsewhere for t in told.values())
    assert set(turned_records(_runs(np.random.default_rng(1), 2, {1}))) == {"r1"}


def test_recordings_of_one_sign_or_that_no_model_follows_name_none():
    for seed in range(60):
        rng = np.random.default_rng(200 + seed)
        count = int(rng.integers(2, 8))
        right = _runs(rng, count, set(), rng.uniform(0, 3))
        unrelated = {n: (t, np.cumsum(rng.normal(size=N)), x) for n, (t, _, x) in right.items()}
        all_wrong = {n: (t, -y, x) for n, (t, y, x) in right.items()}
        constant = {n: (t, y, np.zeros(N)) for n, (t, y, _) in right.items()}
        for records in (right, all_wrong, constant):
            assert turned_records(records) == {}
        mixed = {**right, "r0": unrelated["r0"]}
        if np.corrcoef(mixed["r0"][1], mixed["r0"][2])[0, 1] > -0.8:
            assert turned_records(mixed) == {}


def test_the_verdict_names_a_recording_whose_cable_was_turned_round():
    model = equations(
        "x' = (K*u - x)/tau\ny = x + rest", inputs=["u"], states=["x"], outputs=["y"], name="lag",
        parameters={"K": {"bounds": (0.01, 10)}, "tau": {"bounds": (0.1, 100), "unit": "s"},
                    "rest": {"bounds": (-50, 50)}},
    )  # fmt: skip
    rng = np.random.default_rng(7)
    records = {}
    for name, sign in (("a", 1.0), ("b", 1.0), ("c", -1.0)):
        u = steps(rng, 100)
        y = sign * output(u) + 0.02 * rng.normal(size=N)
        records[name] = Recording(T, {"u": Signal(u, None), "y": Signal(y, None)}, name)
    told = str(fit(Problem(model, records)).verdict)
    assert "y moves against the simulation throughout (correlation -" in told
    assert "agree within chance" not in told
    right = {n: r for n, r in records.items() if n != "c"}
    assert "throughout" not in str(fit(Problem(model, right)).verdict)
