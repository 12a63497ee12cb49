"""Run as a script by test_study_kill.py: works on a slow study until it is done or killed.

python killed_child.py DATABASE      starts study 1, or goes on with it
"""

import sys
import time

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Objective
from plantfit.study import Plan, Store, resume, run

import jax
import jax.numpy as jnp

PLAN = Plan(name="killed", methods=("lbfgsb", "pso"), runs=3, budget=900, seed=11, settings={"pso": {"population": 10}}, chunk=2)


def rosenbrock(z):
    x = 4 * z - 2
    return jnp.sum(100 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1 - x[..., :-1]) ** 2, axis=-1)


slope = jax.jit(jax.value_and_grad(rosenbrock))


def objective(delay: float) -> Objective:
    """A Rosenbrock valley that takes `delay` seconds per batch of candidates, with the same bits for any delay."""

    def wait(x):
        time.sleep(delay)
        return np.zeros((), np.float64)

    def costs(z):
        nothing = jax.pure_callback(wait, jax.ShapeDtypeStruct((), jnp.float64), z) if delay else 0.0
        return rosenbrock(z) + nothing

    def value_and_gradient(z):
        time.sleep(delay / 8)
        value, gradient = slope(z)
        return float(value), np.asarray(gradient)

    return Objective(dimension=3, costs=costs, value_and_gradient=value_and_gradient)


if __name__ == "__main__":
    store = Store.open(sys.argv[1])
    if store.studies():
        resume(store, 1, objective(0.02), checkpoint_seconds=0.1)
    else:
        run(PLAN, objective(0.02), store, checkpoint_seconds=0.1)
