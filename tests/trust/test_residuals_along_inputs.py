"""Residuals of a static model that follow its inputs: rows in no order look white whatever the model lacks."""

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.fitting import fit
from plantfit.trust.validate.residuals.curved import curved
from plantfit.trust.verdict.outputs import FLOOR


def rows_of(seed, n=60, inputs=2):
    rng = np.random.default_rng(seed)
    return rng, {f"u{k}": rng.uniform(-10.0 + 20 * k, 15.0 + 20 * k, n) for k in range(inputs)}


@pytest.mark.parametrize("inputs", [1, 2, 3])
@pytest.mark.parametrize("noise", ["even", "in proportion", "heavy"])
def test_what_is_left_of_a_right_model_follows_no_input_more_often_than_chance(noise, inputs):
    """Of 300 records one in a thousand may; noise of differing sizes makes it a few more."""
    told = 0
    for seed in range(300):
        rng, u = rows_of(seed, inputs=inputs)
        y = 3.0 + 0.5 * np.sum(list(u.values()), axis=0)
        white = rng.standard_t(4, len(y)) if noise == "heavy" else rng.standard_normal(len(y))
        r = 0.1 * white * (np.abs(y) / 10 if noise == "in proportion" else 1.0)
        a = np.column_stack([np.ones(len(y)), *u.values()])
        r -= a @ np.linalg.lstsq(a, r, rcond=None)[0]
        told += curved(r, u, 1 + inputs) is not None
    assert told <= (6 if noise == "in proportion" else 3)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("lacks", ["square", "product", "root", "limit"])
def test_what_a_wrong_model_leaves_follows_its_inputs(lacks, seed):
    rng, u = rows_of(seed)
    a = np.column_stack([np.ones(60), *u.values()])
    true = {
        "square": 0.02 * u["u0"] ** 2,
        "product": 0.05 * u["u0"] * u["u1"],
        "root": 2.0 * np.sqrt(u["u0"] + 10.0),
        "limit": np.minimum(u["u1"], 25.0),
    }[lacks]
    r = true + 0.1 * rng.standard_normal(60)
    r -= a @ np.linalg.lstsq(a, r, rcond=None)[0]
    found = curved(r, u, 3)
    assert found is not None
    assert found.inputs == ["u0", "u1"]
    assert found.explained > 0.6
    exact = lacks in ("square", "product")
    assert found.noise == pytest.approx(0.1, rel=0.35) if exact else found.noise < 0.9 * np.sqrt(np.mean(r**2))


def test_rows_that_are_too_few_or_lack_inputs_tell_nothing():
    rng, u = rows_of(1, n=20)
    y = 0.05 * u["u0"] * u["u1"] + 0.01 * rng.standard_normal(20)
    assert curved(y, u, 6) is None
    assert curved(y, {}, 1) is None
    assert curved(y, {"u0": np.full(20, 3.0)}, 1) is None
    rng, u = rows_of(2)
    y = u["u0"] ** 2 + rng.standard_normal(60)
    assert curved(y, u, 1) is not None
    assert curved(np.where(np.arange(60) % 3, np.nan, y), u, 1) is None  # 20 rows


def test_scaled_and_shifted_inputs_tell_the_same():
    rng, u = rows_of(3)
    y = 0.02 * u["u0"] ** 2 + 0.3 * rng.standard_normal(60)
    one, other = curved(y, u, 1), curved(1e6 * y, {n: 1e3 + 1e-3 * v for n, v in u.items()}, 1)
    assert one is not None
    assert other is not None
    assert other.explained == pytest.approx(one.explained, rel=1e-6)
    assert other.noise == pytest.approx(1e6 * one.noise, rel=1e-6)


def verdict_of(power, times, seed=4):
    """What is said of a heat pump whose compressor takes `power` kW before it pumps any heat."""
    rng = np.random.default_rng(seed)
    cold, hot, p = rng.uniform(263, 288, 60), rng.uniform(303, 328, 60), rng.uniform(0.8, 3.0, 60)
    q = 0.45 * hot / (hot - cold) * (p - power) + 0.05 * rng.standard_normal(60)
    values = {"cold": (cold, "K"), "hot": (hot, "K"), "P": (p, "kW"), "Q": (q, "kW")}
    recording = Recording(np.arange(60.0) * times, {n: Signal(v, unit) for n, (v, unit) in values.items()}, "map")
    model = equations(
        "Q = eta*hot/(hot - cold)*P", inputs={"cold": "K", "hot": "K", "P": "kW"}, outputs={"Q": "kW"},
        parameters=["eta"],
    )  # fmt: skip
    answer = fit(Problem(model, recording, {"eta": Parameter((0.1, 1.0))}), budget=200)
    return answer, {v["sentence"]: v["level"] for v in answer.findings["verdict"]}


@pytest.mark.parametrize("power", [0.0, 0.12])
def test_a_static_curve_that_is_wrong_is_not_called_noise(power):
    answer, said = verdict_of(power, 1.0)
    text = " ".join(said)
    wrong = power > 0
    assert ("The residuals of Q follow cold, hot and P: a polynomial of them explains " in text) is wrong
    assert ("The curve of the model is not that of the plant" in text) is wrong
    assert ("the fit is at the noise floor" in text) is not wrong
    assert ("so a better model could still gain" in text) is wrong
    assert ("The residuals of Q are white" in text) is not wrong
    assert ("The residuals of Q follow the inputs: if the model lacks something" in text) is wrong
    test = answer.findings["residual_tests"][0]
    assert test["white"]
    if wrong:
        assert test["curved"]["noise"] == pytest.approx(0.05, rel=0.3)
        assert np.sqrt(np.mean(0.143**2)) / test["curved"]["noise"] > FLOOR
