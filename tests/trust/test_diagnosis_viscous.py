"""Viscous friction that a model lacks is named with its value, and not where another friction or none is missing."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import plantfit as pf

DT = 0.05
SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))]


def record(rate, start, output, noise, seed, held=20, n=400):
    """An input of levels that are held for `held` samples, and what the plant shows."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-2.0, 2.5, size=-(-n // held)), held)[:n]
    x, kept = np.array(start, dtype=float), []
    for k in range(n):
        kept.append(output(x))
        x = solve_ivp(lambda _, y, k=k: rate(y, u[k]), (0, DT), x, rtol=1e-8, atol=1e-10).y[:, -1]
    return np.arange(n) * DT, u, np.array(kept) + noise * rng.normal(size=n)


def rotor(loss, seed, text="w' = T/J; y = w", more=None):
    """J = 0.5 under a torque, slowed by `loss` (rad/s^2 at a speed), its speed measured with noise of 0.1 rad/s."""
    t, u, y = record(lambda x, u: [u / 0.5 - loss(x[0])], [0.0], lambda x: x[0], 0.05, seed)
    model = pf.equations(
        text, states={"w": {"unit": "rad/s", "initial": "y"}}, inputs={"T": "N*m"}, outputs={"y": "rad/s"},
        parameters={"J": "kg*m^2"} | {n: "N*m*s/rad" for n in more or ()},
    )  # fmt: skip
    seen = pf.Recording(t, {"T": pf.Signal(u, "N*m"), "y": pf.Signal(y, "rad/s")}, "bench")
    bounds = {"J": pf.Parameter((0.01, 10.0), scale="log")} | (more or {})
    return pf.fit(pf.Problem(model, seen, bounds, split=0.7, hold={"T": "previous"}), seed=1)


def first_named(answer):
    made = answer.diagnose(whole=True)
    return made["rounds"][0]["found"][0], made["verdict"][0]["sentence"]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.thorough
def test_viscous_friction_of_a_rotor_is_very_likely_missing(seed):
    first, sentence = first_named(rotor(lambda w: 0.4 * w, seed))
    assert first == "viscous friction of w"
    assert sentence.startswith(("Viscous friction of 0.4", "Viscous friction of 0.39"))
    assert "very likely missing" in sentence


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_viscous_friction_of_a_pendulum_is_very_likely_missing(seed):
    t, u, y = record(
        lambda x, u: [x[1], -9.81 / 0.8 * np.sin(x[0]) - 0.3 * x[1] + u], [0.0, 0.0], lambda x: x[0], 0.003, seed
    )
    model = pf.equations(
        "th' = w; w' = -g/L*sin(th) + k*u; a = th", inputs={"u": "V"}, outputs={"a": "rad"},
        states={"th": {"unit": "rad", "initial": "a"}, "w": "rad/s"}, constants={"g": "9.81 m/s^2"},
        parameters={"L": "m", "k": "1/s^2/V"},
    )  # fmt: skip
    seen = pf.Recording(t, {"u": pf.Signal(u, "V"), "a": pf.Signal(y, "rad")}, "bench")
    bounds = {"L": (0.3, 3.0), "k": (0.1, 5.0)}
    answer = pf.fit(pf.Problem(model, seen, bounds, split=0.7, hold={"u": "previous"}), seed=1)
    first, sentence = first_named(answer)
    assert first == "viscous friction of w"
    assert sentence.startswith(("Viscous friction of 0.3", "Viscous friction of 0.29"))


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.thorough
def test_another_friction_is_not_called_viscous(seed):
    first, sentence = first_named(rotor(lambda w: 1.0 * np.tanh(w / 0.01), seed))
    assert first == "dry friction of w"
    assert "viscous" not in sentence
    first, sentence = first_named(rotor(lambda w: 0.15 * w * abs(w), seed))
    assert first == "drag of w by its square"
    assert "viscous" not in sentence


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.thorough
def test_it_is_not_named_of_a_model_that_has_it(seed):
    own = {"b": pf.Parameter((0.0, 2.0))}
    answer = rotor(lambda w: 0.4 * w, seed, "w' = (T - b*w)/J; y = w", own)
    assert answer.diagnose() is None
    offset = rotor(lambda w: 0.4 * w + 0.5, seed, "w' = (T - b*w)/J; y = w", own)
    first, sentence = first_named(offset)
    assert not first.startswith("viscous")
    assert "iscous" not in sentence
