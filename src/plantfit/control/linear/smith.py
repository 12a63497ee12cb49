"""Smith predictor: a PID that sees the output as it will be after the dead time, and what the prediction missed
through a filter."""

import math
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains, pid_law
from plantfit.simulate.loop.controller import Controller

import jax.numpy as jnp
from jax import jacfwd
from jax.flatten_util import ravel_pytree


class Smith(NamedTuple):
    """Parameters of `smith`: `gains` of its PID and the plant without dead time, about (u0, y0).

        x[k+1] = A x[k] + B (u[k] - u0),   y[k + ahead] = y0 + C x[k]

    A (m, m), B (m,), C (m,); `steady` (m,) states at rest per unit of input; the filter takes `taken` () of what is
    missed in a sample.
    """

    gains: Gains
    A: Any
    B: Any
    C: Any
    steady: Any
    taken: Any
    u0: Any
    y0: Any


class SmithState(NamedTuple):
    """State of the PID, states (m,) of the model, its last outputs (ahead,), newest first, and the filtered miss."""

    pid: Any
    x: Any
    line: Any
    miss: Any


def smith(period: float, ahead: int, anti_windup: str) -> Controller:
    """The controller every `period` s for a dead time of `ahead` samples; parameters (`Smith`, input at rest, `Limits`
    of the PID).

    Commands are counted from the input at rest. The PID acts on y0 + C x + filtered (y - y0 - C x[k - ahead]), so that
    its loop has no dead time where the model is right; the model knows the limited command. Source: O. Smith, Chem.
    Eng. Progress 53 (1957) 217; filter of the miss: J. Normey-Rico, E. Camacho, Control of Dead-time Processes (2007),
    section 5.5.
    """
    init_pid, update_pid = pid_law(period, anti_windup)

    def init(measurement, parameters):
        s, rest, _ = parameters
        x = s.steady * (rest - s.u0)
        fast = s.C @ x
        inner = init_pid(measurement, s.gains).at_rest(measurement, rest, s.gains)
        return SmithState(inner, x, jnp.full(ahead, fast), measurement - s.y0 - fast)

    def update(state, measurement, reference, parameters):
        s, rest, limits = parameters
        fast = s.C @ state.x
        miss = state.miss + s.taken * (measurement - s.y0 - state.line[-1] - state.miss)
        inner, command = update_pid(state.pid, s.y0 + fast + miss, reference, s.gains, *limits)
        line = jnp.concatenate([fast[None], state.line[:-1]])
        return SmithState(inner, s.A @ state.x + s.B * (command - s.u0), line, miss), command - rest

    return Controller(init, update)


def smith_response(s: Smith, c: Any, ahead: int, period: float, w: Any, xp: Any = np) -> Any:
    """C(e^(jwh)) (F,) of the whole controller from the error to the input, `c` (F,) that of its PID, at w (F,) in
    rad/s."""
    above, below = smith_parts(s, c, ahead, period, w, xp)
    return above / below


def smith_parts(s: Smith, c: Any, ahead: int, period: float, w: Any, xp: Any = np) -> tuple[Any, Any]:
    """Above and below the line of `smith_response`, each (F,): rational functions whose poles lie inside the unit
    circle where those of the model do, but for the one at 1 of the PID's integral action."""
    z = xp.exp(1j * w * period)
    m = s.A.shape[0]
    moved = xp.linalg.solve(
        z[:, None, None] * xp.eye(m) - s.A, xp.broadcast_to(s.B, (len(w), m))[..., None].astype(z.dtype)
    )[..., 0]
    kept = s.taken / (1.0 - (1.0 - s.taken) / z)
    return c * kept, 1.0 + c * (moved @ s.C) * (1.0 - kept * z**-ahead)


def poles_outside(controller: Controller, parameters: Any) -> int:
    """How many poles a controller itself has outside the unit circle, where no limit acts."""
    flat, back = ravel_pytree(controller.init(jnp.zeros(()), parameters))
    moved = jacfwd(lambda v: ravel_pytree(controller.update(back(v), jnp.zeros(()), jnp.zeros(()), parameters)[0])[0])(
        flat
    )
    return int(np.sum(np.abs(np.linalg.eigvals(np.asarray(moved))) > 1.0 + 1e-6))


def unlimited() -> tuple[float, float, float]:
    """Limits of a PID that never act."""
    return -math.inf, math.inf, 0.0
