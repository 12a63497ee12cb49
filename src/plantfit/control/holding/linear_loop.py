"""Plants near one equilibrium under a regulator with its filter: poles of the loop, sensitivity at the input."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy

from plantfit.models.model import Model
from plantfit.runtime import jit
from plantfit.simulate.steps.vector import vectorise

import jax
import jax.numpy as jnp


@dataclass(frozen=True, eq=False)
class Near:
    """n plants near one point, sampled: A (n, s, s), B (n, s, m) with the inputs held over a period, C (n, p, s), D
    (n, p, m) of the input of the sample before, as the outputs are measured before it changes."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray


def near(model: Model, plants: Mapping[str, np.ndarray], x0: np.ndarray, u0: np.ndarray, period: float) -> Near:
    """The plants (parameters (n,) by name) linearised at x0, u0 and sampled."""
    vector = vectorise(model)
    p = tuple(jnp.asarray(plants[name], dtype=float) for name in vector.parameters)

    def local(p):
        def rate(x, u):
            return jnp.stack(vector.rate(tuple(x), (*u, 0.0), p))

        def out(x, u):
            return jnp.stack(vector.output(tuple(x), (*u, 0.0), p))

        a, b = jax.jacfwd(rate, (0, 1))(jnp.asarray(x0), jnp.asarray(u0))
        return a, b, *jax.jacfwd(out, (0, 1))(jnp.asarray(x0), jnp.asarray(u0))

    a, b, c, d = (np.asarray(v) for v in jit(jax.vmap(local))(p))
    n, s, m = b.shape
    big = np.zeros((n, s + m, s + m))
    big[:, :s, :s], big[:, :s, s:] = a, b
    found = scipy.linalg.expm(big * period)
    return Near(found[:, :s, :s], found[:, :s, s:], c, d)


class LinearController(NamedTuple):
    """s+ = F s + G (y - D u_last),  u = -H s - J (y - D u_last), all deviations; of a regulator on the corrected
    state of a filter."""

    F: np.ndarray
    G: np.ndarray
    H: np.ndarray
    J: np.ndarray
    D: np.ndarray


def controller_of(parameters: Any) -> LinearController:
    """`StateFeedback` where no limit acts."""
    e, k = parameters.estimator, np.asarray(parameters.gain)
    a, b, c, gain = (np.asarray(v) for v in (e.A, e.B, e.C, e.gain))
    kept, moved = np.eye(len(a)) - gain @ c, a - b @ k
    return LinearController(moved @ kept, moved @ gain, k @ kept, k @ gain, np.asarray(e.D))


def poles(plants: Near, controller: LinearController) -> np.ndarray:
    """The largest modulus (n,) of the poles of every loop."""
    n, s = len(plants.A), plants.A.shape[-1]
    size = len(controller.F)
    whole = np.zeros((n, s + size, s + size))
    whole[:, :s, :s] = plants.A - plants.B @ controller.J @ plants.C
    whole[:, :s, s:] = -plants.B @ controller.H
    whole[:, s:, :s] = controller.G @ plants.C
    whole[:, s:, s:] = controller.F
    missed = plants.D - controller.D  # of what the outputs follow at once, what the filter does not know
    if np.any(missed):
        late = np.concatenate([-plants.B @ controller.J @ missed, controller.G @ missed], axis=1)
        command = np.concatenate(
            [-controller.J @ plants.C, np.broadcast_to(-controller.H, (n, *controller.H.shape))], axis=2
        )
        below = np.concatenate([command, -controller.J @ missed], axis=2)
        whole = np.concatenate([np.concatenate([whole, late], axis=2), below], axis=1)
    return np.max(np.abs(np.linalg.eigvals(whole)), axis=1)


def largest_sensitivity(plants: Near, controller: LinearController, w: np.ndarray, period: float) -> np.ndarray:
    """The largest |1 / (1 + L)| (n,) at the only input, at w (F,) in rad/s."""
    z = np.exp(1j * w * period)[:, None, None]
    own = np.linalg.solve(z * np.eye(len(controller.F)) - controller.F, controller.G.astype(complex)[None])
    c = controller.H @ own + controller.J  # (F, 1, p)
    g = np.linalg.solve(z * np.eye(plants.A.shape[-1]) - plants.A[:, None], plants.B.astype(complex)[:, None])
    loop = np.einsum("fp,nfp->nf", c[:, 0], np.einsum("nps,nfsm->nfp", plants.C, g))
    if np.any(plants.D) or np.any(controller.D):
        through, known = (np.einsum("fp,npm->nf", c[:, 0], d) / z[:, 0, 0] for d in (plants.D, controller.D[None]))
        loop = (loop + through) / (1.0 - known)
    return np.max(1.0 / np.abs(1.0 + loop), axis=1)
