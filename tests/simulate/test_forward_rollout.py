"""States simulated for forward mode alone have the values and derivatives of those simulated for both modes."""

import numpy as np
import pytest

from plantfit import Parameter, Problem, Recording, Signal
from plantfit.models import equations

import jax

PLANTS = {
    "lag with dead time": ("x' = (b*delay(u, L) - x)/a\ny = x", ["x"]),
    "two states": ("x' = v\nv' = -b*x - a*v + u\ny = x", ["x", "v"]),
    "dry friction": ("x' = v\nv' = u - b*v - a*friction(v, 0.5)\ny = x", ["x", "v"]),
    "an event": ("x' = -x/a + b*u\nwhen falling(x - 0.2): x = x + 0.5\ny = x", ["x"]),
    "no parameter in the rate": ("x' = u - x\ny = a*x + b", ["x"]),
}
ALONE = {(1, "two states")}


@pytest.mark.parametrize(
    ("lanes", "name"),
    [
        pytest.param(lanes, name, marks=() if lanes == 11 or (lanes, name) in ALONE else pytest.mark.slow)
        for lanes in (1, 3, 11)
        for name in PLANTS
    ],
)
@pytest.mark.further(1)
def test_same_values_and_derivatives(name, lanes):
    """Of one candidate and of several side by side, by parameters, dead time and first states."""
    text, states = PLANTS[name]
    delay = {"L": {"bounds": (0.0, 1.0)}} if "L" in text else {}
    model = equations(
        text,
        inputs=["u"],
        states=states,
        outputs=["y"],
        parameters={"a": {"bounds": (0.1, 2)}, "b": {"bounds": (0.1, 2)}} | delay,
        check=False,
    )
    t = np.linspace(0, 4, 81)
    record = Recording(t, {"u": Signal(np.where(np.sin(3 * t) > 0, 1.0, -0.7), None), "y": Signal(0 * t, None)}, "run")
    problem = Problem(model, record, {n: Parameter((0.1, 2.0)) for n in ("a", "b")}, substeps=2)
    simulator, drive, q = problem.predictor.stepping(), problem.data["drive"]["run"], problem.space.dimension

    def outcome(v, forwards):
        p = problem.space.tree(problem.space.physical(v[:q]), "run")
        return simulator.states(p, drive, tuple(v[q:]), forwards=forwards)

    points = np.random.default_rng(0).uniform(0.2, 0.8, (lanes, q + len(states)))
    values, slopes = (jax.jit(lambda v, d=d: [jax.vmap(d(lambda v, w=w: outcome(v, w)))(v) for w in (False, True)])
                      for d in (lambda f: f, jax.jacfwd))  # fmt: skip
    wanted, found = zip(values(points), slopes(points), strict=True)
    for a, b in zip(jax.tree.leaves(wanted), jax.tree.leaves(found), strict=True):
        assert np.all(np.isfinite(a))
        np.testing.assert_allclose(np.asarray(b), np.asarray(a), rtol=1e-9, atol=1e-9)
    assert np.max(np.abs(jax.tree.leaves(found[1])[0])) > 1e-3
