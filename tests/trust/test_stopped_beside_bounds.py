"""Ranges of what is measured, beside parameters that the data leave open and that stand on bounds of the search."""

from typing import Literal

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal, equations
from plantfit.fitting import fit


def reaction(seed, start_bounds=(0.0, 400.0)):
    """A reaction of first order at a nearly constant temperature, which tells its rate there and not what it changes
    with; its start is measured."""
    t = np.arange(150) * 1.0
    temperature = 333.0 + 0.02 * np.sin(0.05 * t)
    rate = 0.02 * np.exp(-8000.0 * (1 / temperature - 1 / 340.0))
    x = 2.0 * np.exp(-np.concatenate([[0.0], np.cumsum(rate[:-1])]))
    record = Recording(
        t,
        {"T": Signal(temperature), "y": Signal(x + 0.01 * np.random.default_rng(seed).normal(size=len(t)))},
        "run",
    )
    model = equations(
        "x' = -k*exp(-E*(1/T - 1/340))*x\ny = x",
        states={"x": {"initial": "x0"}}, inputs=["T"], outputs=["y"], parameters=["k", "E", "x0"], name="batch",
    )  # fmt: skip
    box = {
        "k": Parameter((1e-4, 1.0), scale="log"),
        "E": Parameter((5000.0, 10000.0)),
        "x0": Parameter(start_bounds),
    }
    return {row["name"]: row for row in fit(Problem(model, record, box), seed=1).findings["parameters"]}


@pytest.mark.parametrize("seed", [1, 6, 10])
def test_a_measured_start_has_ends_where_an_activation_energy_presses_on_its_bound(seed):
    """It was "at least 1.995, and the data set no upper end": E presses on its bound, and might have paid for it."""
    found = reaction(seed)
    start = found["x0"]
    assert start["status"] == "determined"
    assert start["low"] < 2.0 < start["high"]
    assert start["high"] - start["low"] < 0.02  # 0.0085 by its standard error alone
    # what the same bound does hold stays open: with a wide box, E may be 54 000 to 84 000 K, and k 0.35 to 2.2
    assert found["E"]["status"] == "flat"
    assert found["k"]["status"] in ("weak", "flat")
    assert found["k"]["low"] == pytest.approx(0.0122, rel=0.03)  # where nothing changes with the temperature
    assert found["k"]["high"] >= 0.3


# the law, and the number before v
LAWS = {
    # k/R is known, and so is what b is the rest of
    "square": ("y = (k*k/R + b)*v + (k/R)*u", lambda k, R, b: k * k / R + b),
    "cube": ("y = (k^3/R^2 + b)*v + (k/R)*u", lambda k, R, b: k**3 / R**2 + b),
    "inverse": ("y = (1/R + b)*v + (k/R)*u", lambda k, R, b: 1 / R + b),
    # b is anything, with k and R in proportion
    "divided": ("y = (b/R)*v + (k/R)*u", lambda k, R, b: b / R),
    "product": ("y = k*b*v + (k/R)*u", lambda k, R, b: k * b),
}


def friction(law, key, scale: Literal["linear", "log"] = "log"):
    """What a fit says of b beside k and R, which leave the box together; the number that the data know with it; the
    truth; the combinations that the data determine."""
    text, known = LAWS[law]
    rng = np.random.default_rng([key, 7])
    p = {n: float(np.exp(rng.uniform(np.log(0.1), np.log(10.0)))) for n in ("k", "R", "b")}
    u, v = rng.normal(size=(2, 200))
    y = known(**p) * v + p["k"] / p["R"] * u
    y = y + 0.01 * np.std(y) * rng.normal(size=len(y))
    box = {
        n: Parameter((p[n] / np.exp(rng.uniform(0.5, 3.0)), p[n] * np.exp(rng.uniform(0.5, 3.0))), scale=scale)
        for n in p
    }
    model = equations(text, inputs=["u", "v"], outputs=["y"], parameters=list(p))
    record = Recording(np.arange(200.0), {"u": Signal(u), "v": Signal(v), "y": Signal(y)})
    findings = fit(Problem(model, record, box), seed=key).findings
    row = {r["name"]: r for r in findings["parameters"]}["b"]
    return row, known(**p), p, findings["determined"]["combinations"]


@pytest.mark.parametrize("key", [6, 18, *(pytest.param(k, marks=pytest.mark.slow) for k in (8, 10, 22))])
@pytest.mark.parametrize("law", ["square", "inverse"])
def test_a_rest_ends_where_two_others_leave_the_box_together(law, key):
    """It was "any value above 0": a resistance near zero changes anything, and its motor constant takes it back."""
    row, most, truth, _ = friction(law, key)
    assert row["status"] != "flat"
    assert truth["b"] < row["high"]
    assert 0.95 * most < row["high"] < 1.5 * most


@pytest.mark.parametrize("key", [0, 3, 17, *(pytest.param(k, marks=pytest.mark.slow) for k in (1, 2, 4, 5, 27, 39))])
@pytest.mark.parametrize("law", ["divided", "product"])
def test_what_goes_with_two_others_stays_open(law, key):
    row, *_ = friction(law, key)
    assert row["status"] == "flat"


@pytest.mark.parametrize("key", [3, 6, *(pytest.param(k, marks=pytest.mark.slow) for k in (7, 8, 10, 18))])
def test_a_sum_whose_factor_is_a_ratio_is_named_in_as_many_digits_as_it_needs(key):
    """k/R and k*k/R + b are known, so k + (R/k)*b is: with three digits of R/k it was called neither product nor
    sum."""
    _, known, truth, found = friction("square", key)
    ratio = truth["R"] / truth["k"]
    [total] = [c for c in found if not c["product"]]
    assert set(total["weights"]) in ({"k", "b"}, {"R", "b"})
    other = next(n for n in total["weights"] if n != "b")
    factor = total["weights"]["b"] / total["weights"][other]
    scale = 1.0 if other == "k" else ratio  # of R + R*R/(k*k)*b
    assert factor == pytest.approx(scale * ratio, rel=0.02)
    assert total["value"] / total["weights"][other] == pytest.approx(scale * known * ratio, rel=0.02)
    assert 0.0 < total["standard_error"] < 0.02 * abs(total["value"])


def test_what_is_neither_product_nor_sum_is_not_named():
    """(k - R)^2 + b alone is known."""
    u, v = np.random.default_rng(3).normal(size=(2, 200))
    y = 2.0 * v + 0.01 * np.random.default_rng(4).normal(size=200)  # (k - R)^2 + b = 2
    model = equations("y = ((k - R)^2 + b)*v + 0*u", inputs=["u", "v"], outputs=["y"], parameters=["k", "R", "b"])
    record = Recording(np.arange(200.0), {"u": Signal(u), "v": Signal(v), "y": Signal(y)})
    box = {n: Parameter((0.0, 4.0)) for n in ("k", "R", "b")}
    found = fit(Problem(model, record, box), seed=1).findings["determined"]
    assert found["combinations"] == []


@pytest.mark.slow
def test_most_rests_have_an_end_and_what_goes_with_others_hardly_ever():
    """The figures of docs/identifiability.md: 16 plants of each law, boxes in logarithms and not."""
    flat = {
        law: sum(friction(law, key, "linear" if key % 2 else "log")[0]["status"] == "flat" for key in range(8, 24))
        for law in LAWS
    }
    assert flat["divided"] == 16
    assert flat["product"] >= 15  # one stands at its bound, without an end
    assert 48 - flat["square"] - flat["cube"] - flat["inverse"] >= 34, flat
