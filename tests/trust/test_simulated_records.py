"""Records that a program simulated, without noise: what its own solver leaves is no missing dynamics and no failure
on unseen samples."""

import numpy as np
import pytest

import plantfit as pf

PERIOD, N = 0.1, 400


def simulated(steps, missing=0.0, seed=0):
    """A van der Pol oscillator by Heun's method with so many steps a sample, driven by random levels; `missing`: a
    cubic spring."""
    u = np.random.default_rng(seed).uniform(-1.0, 1.0, N // 10).repeat(10)
    x, h, y = np.array([0.5, 0.0]), PERIOD / steps, np.empty(N)
    for k in range(N):
        y[k] = x[0]
        for _ in range(steps):
            rate = lambda z, k=k: np.array([z[1], 1.2 * (1 - z[0] ** 2) * z[1] - z[0] - missing * z[0] ** 3 + u[k]])  # noqa: E731
            first = rate(x)
            x = x + 0.5 * h * (first + rate(x + h * first))
    recording = pf.Recording(PERIOD * np.arange(N), {"u": pf.Signal(u), "y": pf.Signal(y)}, "made")
    model = pf.equations(
        "x' = v\nv' = mu*(1 - x^2)*v - x + u\ny = x", inputs=["u"],
        states={"x": {"initial": 0.5}, "v": {"initial": 0.0}}, outputs=["y"],
        parameters=["mu"],
    )  # fmt: skip
    return pf.fit(pf.Problem(model, recording, {"mu": (0.1, 5.0)}, split=0.5), budget=600)


@pytest.mark.parametrize(
    ("steps", "seed"),
    [(20, 1), (200, 2), *(pytest.param(*p, marks=pytest.mark.slow) for p in ((20, 0), (20, 2), (200, 0), (200, 1)))],
)
@pytest.mark.thorough
def test_errors_of_its_solver_are_told_as_such(steps, seed):
    answer = simulated(steps, seed=seed)
    assert answer.values["mu"] == pytest.approx(1.2, rel=1e-3)
    verdict = answer.findings["verdict"]
    assert any(
        "the solver or the rounding that made the record may leave as much" in s["sentence"] and s["level"] == "info"
        for s in verdict
    )
    assert any(s["sentence"].endswith("it holds.") and s["level"] == "good" for s in verdict)
    assert not any("systematic" in s["sentence"] or "does not hold" in s["sentence"] for s in verdict)


@pytest.mark.thorough
def test_what_a_model_lacks_is_told_of_records_without_noise():
    verdict = str(simulated(200, missing=0.1).verdict)
    assert "something systematic is missing" in verdict
    assert "may leave as much" not in verdict
