"""Information criteria against closed forms, and choices between polynomials whose order is known."""

import numpy as np
import pytest

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models import equations
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.trust.validate.model_comparison import by_criteria

POWERS = {1: "a + b*u", 2: "a + b*u + c*u*u", 4: "a + b*u + c*u*u + d*u*u*u + g*u*u*u*u"}


def polynomial(order, u, y, **settings):
    model = equations(
        f"y = {POWERS[order]}", inputs={"u": None}, outputs={"y": None},
        parameters={n: {"bounds": (-50.0, 50.0)} for n in "abcdg"[: order + 1]},
    )  # fmt: skip
    problem = Problem(model, Recording(np.arange(float(len(u))), {"u": Signal(u), "y": Signal(y)}, "r"), **settings)
    best = np.polynomial.polynomial.polyfit(u, y, order)
    return problem, problem.space.cube(problem.space.vector(dict(zip("abcdg", best, strict=False))))


def sampled(seed, n=200, memory=0.0):
    rng = np.random.default_rng(seed)
    u, e = rng.uniform(-1.0, 1.0, n), rng.normal(size=n)
    for k in range(1, n):
        e[k] = memory * e[k - 1] + np.sqrt(1 - memory**2) * e[k]
    return u, 1.0 + 2.0 * u + 1.5 * u**2 + 0.5 * e


def compared(seed, **more):
    u, y = sampled(seed, **more)
    return by_criteria({f"order {p}": polynomial(p, u, y) for p in POWERS})


def test_criteria_of_white_residuals_are_the_textbooks():
    found = next(f for f in (compared(s) for s in range(10)) if f.independent == f.samples)
    n = found.samples
    raw = {}
    for c, order in zip(found.candidates, POWERS, strict=True):
        assert c.free == order + 1
        assert c.effective == pytest.approx(order + 1, abs=0.01)
        fit, k = n * np.log(c.rms**2), order + 2
        raw[c.name] = (fit + 2 * k, fit + 2 * k + 2 * k * (k + 1) / (n - k - 1), fit + k * np.log(n))
    least = np.min(list(raw.values()), axis=0)
    for c in found.candidates:
        np.testing.assert_allclose((c.aic, c.aicc, c.bic), raw[c.name] - least, atol=0.1)


def test_bic_finds_the_order_and_a_line_is_refused():
    chosen = [compared(seed).best("bic").name for seed in range(12)]
    assert chosen.count("order 2") >= 10
    assert compared(0).candidates[0].aicc > 20.0


def test_correlated_residuals_are_worth_fewer():
    found = [compared(seed, n=2000, memory=0.8) for seed in range(6)]
    worth = np.mean([f.independent for f in found])
    assert worth == pytest.approx(2000 * 0.2 / 1.8, rel=0.3)  # (1 - rho)/(1 + rho)


def test_left_out_errors_are_told_and_who_has_none():
    u, y = sampled(3)
    found = by_criteria({f"order {p}": polynomial(p, u, y) for p in (1, 2)}, {"order 2": 0.51})
    assert found.best("left_out").name == "order 2"
    assert found.sentences[-1] == (
        "Recordings left out are predicted best by order 2, with an RMS error "
        "of 0.51; order 1: cannot predict a recording without having seen it."
    )
    assert [row[-1] for row in found.table("V")["rows"]] == ["cannot", "0.51"]
    with pytest.raises(ModelError, match="give left_out"):
        compared(1).best("left_out")


def test_other_data_or_scales_are_refused():
    u, y = sampled(4)
    with pytest.raises(ModelError, match="fit all of them to the same data"):
        by_criteria({"a": polynomial(1, u, y), "b": polynomial(2, u[:-1], y[:-1])})
    with pytest.raises(ModelError, match="fit all of them to the same data"):
        by_criteria({"a": polynomial(1, u, y), "b": polynomial(2, u, y, scales={"y": 2.0})})
