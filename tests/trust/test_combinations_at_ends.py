"""Combinations that the data determine at the ends of ranges, too, and not by the derivatives at the answer alone."""

from functools import cache

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal
from plantfit.fitting import fit
from plantfit.models import dc_motor, equations
from plantfit.simulate import Simulator

MOTOR = {"Rm": 1.1, "Lm": 0.0021, "Kb": 0.071, "Kt": 0.071, "Jm": 6.5e-5, "Cm": 1.1e-4, "Tf": 3e-3}
BOX = {
    "Rm": (0.1, 100.0), "Lm": (1e-5, 0.1), "Kb": (1e-3, 1.0), "Kt": (1e-3, 1.0), "Jm": (1e-8, 1e-2),
    "Cm": (1e-8, 1e-2), "Tf": (1e-6, 1.0),
}  # fmt: skip
SEEDS = [1, 2, 3]


@cache
def motor(seed):
    """What is said of a motor of which voltage and speed are recorded."""
    rng = np.random.default_rng(seed)
    n, model = 1500, dc_motor()
    t, volts = 0.002 * np.arange(n), np.repeat(10.0 * rng.uniform(-1.0, 1.0, n // 50), 50)
    simulator = Simulator.of(model, substeps=8)
    w = np.asarray(simulator.outputs(MOTOR, simulator.drive(t, {"V": volts}, measured={"w": np.zeros(n)}))["w"])
    record = Recording(t, {"V": Signal(volts, "V"), "w": Signal(w + 0.05 * rng.normal(size=n), "rad/s")}, "motor")
    return fit(Problem(model, record, {k: Parameter(b, scale="log") for k, b in BOX.items()}), seed=seed).findings[
        "determined"
    ]


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.thorough
def test_a_slope_at_the_answer_is_no_combination(seed):
    """Kb + Rm Cm/Kt is known. It was "Kb + 0.101*Cm = 0.0727 ± 0.0000075"."""
    found = motor(seed)["combinations"]
    assert len(found) >= 2
    for c in found:
        assert c["product"], c["formula"]
        truth = np.prod([MOTOR[k] ** power for k, power in c["weights"].items()])
        assert c["low"] < truth < c["high"], c["formula"]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_friction_that_seems_to_do_nothing_does_not_fix_the_motor_constant_once_it_is_known(seed):
    """Kb + Rm Cm/Kt is known: with Cm known Rm/Kt may still be anything. It was "Kb is determined only if Cm is"."""
    assert "Kb" not in motor(seed)["only_if"]


def test_what_is_named_are_numbers_of_their_own():
    """Of three directions that are known the third is no product and no sum: the quotient of the two others is not
    counted for it."""
    for seed in SEEDS:
        found = motor(seed)
        rows = [[c["weights"].get(k, 0.0) for k in MOTOR] for c in found["combinations"]]
        assert np.linalg.matrix_rank(rows) == len(rows)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("text", "names", "expected"),
    [
        ("y = a*b*u + c/d*v", "abcd", [{"a": 1.0, "b": 1.0}, {"c": 1.0, "d": -1.0}]),
        ("y = (a + b)*u + c*d*v", "abcd", [{"a": 1.0, "b": 1.0}, {"c": 1.0, "d": 1.0}]),
        ("y = (a + b)*u + (b + c)*v", "abc", [{"a": 1.0, "b": 1.0}, {"b": 1.0, "c": 1.0}]),
        ("y = a*b^2*u + v", "ab", [{"a": 0.5, "b": 1.0}]),
    ],
)
@pytest.mark.further(4)
def test_what_is_one_everywhere_is_named(text, names, expected, seed):
    rng = np.random.default_rng(seed)
    u, v = rng.normal(size=(2, 200))
    truth = {k: float(np.exp(rng.uniform(-1.0, 1.0))) for k in names}
    y = eval(text.removeprefix("y = ").replace("^", "**"), {}, {"u": u, "v": v, **truth})
    model = equations(text, inputs=["u", "v"], outputs=["y"], parameters=list(names))
    record = Recording(
        np.arange(200.0), {k: Signal(s) for k, s in zip("uvy", (u, v, y + 0.01 * rng.normal(size=200)), strict=True)}
    )
    problem = Problem(model, record, {n: Parameter((1e-3, 100.0), scale="log") for n in names})
    found = fit(problem, seed=seed).findings["determined"]["combinations"]
    rows = [[weights.get(k, 0.0) for k in names] for weights in (*expected, *(c["weights"] for c in found))]
    assert len(found) == len(expected) == np.linalg.matrix_rank(rows, tol=1e-3)  # they span the same
