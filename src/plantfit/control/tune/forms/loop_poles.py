"""Poles of a sampled loop as its gain grows: a root locus, dead time exact as delay states."""

from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.tune.forms.form import Form
from plantfit.control.tune.frequency import input_matrices
from plantfit.control.tune.one_loop import OneLoop, Rest

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree

FACTORS = np.geomspace(0.1, 10.0, 61)  # of the plant's gain; the middle one is 1


def loop_poles(plant: OneLoop, rest: Rest, form: Form, parameters: Any, level: float, period: float) -> np.ndarray:
    """Poles (F, m) in z of the loop of the first plant at rest at `level`, for its gain times every one of `FACTORS`.

    No limit acts. The states are those of the plant, its inputs on their way through the dead time, and the
    controller's.
    """
    one = Rest(*(getattr(rest, name)[:1] for name in ("x", "u", "A", "B", "C", "D", "late")))
    a, b = input_matrices(one, period)
    n, past = len(a), max(len(b) - 1, 1 if rest.D[0] else 0)
    ways = np.zeros((past + 1, n))
    ways[: len(b)] = b
    seen, through = rest.C[0], float(rest.D[0])
    inner = plant.inner_row(rest)[0] if form.inner else None
    held = 0.0 if plant.inner is None or not form.inner else plant.inner_level(rest)
    given = (parameters, float(rest.u[0]), *form.given)

    def measured(x: Any, late: Any) -> Any:
        y = level + seen @ x + (through * late[0] if past else 0.0)
        return y if inner is None else {plant.output: y, plant.inner: held + inner @ x}

    start, back = ravel_pytree(form.loop.init(measured(jnp.zeros(n), jnp.zeros(past)), given))

    def moved(s: Any, factor: Any) -> Any:
        x, late, state = s[:n], s[n : n + past], back(s[n + past :])
        state, command = form.loop.update(state, measured(x, late), level, given)
        inputs = jnp.concatenate([jnp.reshape(factor * command, (1,)), late])
        return jnp.concatenate([a @ x + inputs @ ways, inputs[:past], ravel_pytree(state)[0]])

    at = jnp.concatenate([jnp.zeros(n + past), start])
    opened, closed = (np.asarray(jax.jacfwd(moved)(at, f)) for f in (0.0, 1.0))
    return np.linalg.eigvals(opened + FACTORS[:, None, None] * (closed - opened))
