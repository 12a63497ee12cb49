"""The same trajectory by scipy's BDF and by diffrax."""

import itertools
from collections.abc import Callable

import diffrax
import numpy as np
from scipy.integrate import solve_ivp

import plantfit.runtime  # noqa: F401
from benchmarks.plant import PARAMETERS, PERIOD, jacobian, rate

import jax
import jax.numpy as jnp

RTOL, ATOL = 1e-3, 1e-4  # loose: looser gains them little; the column "rms error" tells what each reaches


def scipy_bdf(t: np.ndarray, u: np.ndarray, rtol: float = RTOL, atol: float = ATOL) -> Callable[[], np.ndarray]:
    """y (n,) by BDF with the exact Jacobian, begun anew at every edge of the input, in plain floats (its fastest
    use)."""
    p = PARAMETERS
    edges = np.r_[0, np.flatnonzero(np.diff(u)) + 1, len(t) - 1]

    def run():
        x, states = [p["x10"], p["x20"]], np.empty((2, len(t)))
        for first, last in itertools.pairwise(edges):
            level = float(u[first])
            solved = solve_ivp(
                lambda s, x, level=level: rate(x[0], x[1], level, p),
                (t[first], t[last]),
                x,
                "BDF",
                t_eval=t[first : last + 1],
                rtol=rtol,
                atol=atol,
                jac=lambda s, x, level=level: jacobian(x[0], x[1], level, p),
            )
            states[:, first : last + 1], x = solved.y, solved.y[:, -1]
        return states[1] + p["e"] * states[0]

    return run


def diffrax_functions(t: np.ndarray, u: np.ndarray, target: np.ndarray) -> tuple[Callable, Callable, Callable]:
    """cost(p), its value and gradient, and y(p), by diffrax.

    Kvaerno3, adaptive, told the edges of the input; its recommended adjoint, recursive checkpoints.
    """
    held = jnp.asarray(u)
    edges = jnp.asarray(t[np.flatnonzero(np.diff(u)) + 1])

    def field(s, x, p):
        level = held[jnp.clip(jnp.floor(s / PERIOD + 1e-9).astype(int), 0, len(u) - 1)]
        return jnp.stack(rate(x[0], x[1], level, p))

    controller = diffrax.ClipStepSizeController(diffrax.PIDController(rtol=RTOL, atol=ATOL), jump_ts=edges)

    def outputs(p):
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(field),
            diffrax.Kvaerno3(),
            t[0],
            t[-1],
            1e-4,
            jnp.stack([p["x10"], p["x20"]]),
            p,
            saveat=diffrax.SaveAt(ts=jnp.asarray(t)),
            stepsize_controller=controller,
            max_steps=4 * len(t),
            adjoint=diffrax.RecursiveCheckpointAdjoint(),
        )
        assert solution.ys is not None
        return solution.ys[:, 1] + p["e"] * solution.ys[:, 0]

    def cost(p):
        return jnp.mean((outputs(p) - target) ** 2)

    return jax.jit(cost), jax.jit(jax.value_and_grad(cost)), jax.jit(outputs)
