"""LQ servo: state feedback with integral action, states by a Kalman filter, inputs on their way through dead time among them."""

import math
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Settings, checked
from plantfit.simulate.loop.closed_loop import Controller

import jax.numpy as jnp


class Servo(NamedTuple):
    """Parameters of `servo`, deviations from (x0, u0, y0); the plant has n states, and p past inputs still act.

        x[k+1] = A x[k] + B (u[k], u[k-1], .., u[k-p]),  y = C x + D u[k-1]
        u = f (r - y0) - K x - P (u[k-1], .., u[k-p]) + I,  I grows by Ki (r - y) a second

    A (n, n), B (n, p + 1), C (n,), D (), gain (n,) of the filter, K (n,), P (p,), Ki in u/(y s), f () of the set point, u0, y0.
    """

    A: Any
    B: Any
    C: Any
    D: Any
    gain: Any
    K: Any
    P: Any
    Ki: Any
    f: Any
    u0: Any
    y0: Any


def servo(
    period: float,
    *,
    lower: float = -math.inf,
    upper: float = math.inf,
    anti_windup: str = "clamping",
    tracking_time: float | None = None,
) -> Controller:
    """The controller every `period` s whose parameters are (`Servo`, the input at which the loop rests before the first sample).

    The filter knows the limited command; limits and `anti_windup` of the integral as in `control.pid`.
    Source: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., sections 4.5 (integral action) and 11.3 - 11.4.
    """
    follow = checked(Settings(period, lower, upper, anti_windup, tracking_time)).follow

    def corrected(x, past, dy, s):
        through = s.D * past[0] if s.P.shape[0] else 0.0
        return x + s.gain * (dy - s.C @ x - through)

    def init(measurement, parameters):
        s, rest = parameters
        dy, du = measurement - s.y0, rest - s.u0
        x = jnp.linalg.solve(*resting(s, dy, du, jnp))
        past = jnp.full(s.P.shape, du)
        integral = du + s.K @ corrected(x, past, dy, s) + jnp.sum(s.P) * du - s.f * dy
        return x, past, integral

    def update(state, measurement, reference, parameters):
        (x, past, integral), (s, _) = state, parameters
        dy, error = measurement - s.y0, reference - measurement
        x = corrected(x, past, dy, s)
        wanted = s.f * (reference - s.y0) - s.K @ x - s.P @ past + integral
        command = jnp.clip(wanted, lower - s.u0, upper - s.u0)
        added = period * s.Ki * error
        if anti_windup == "clamping":
            further = ((wanted > command) & (added > 0)) | ((wanted < command) & (added < 0))
            integral = jnp.where(further, integral, integral + added)
        else:
            integral = integral + added + follow * (command - wanted)
        inputs = jnp.concatenate([command[None], past])
        return (s.A @ x + s.B @ inputs, inputs[: past.shape[0]], integral), command + s.u0

    return Controller(init, update)


def resting(s: Servo, dy: Any, du: Any, xp: Any = np) -> tuple[Any, Any]:
    """M (n, n) and v (n,) of the predicted state x = M^-1 v in which the filter rests while y and u stay."""
    by_y = s.A @ s.gain
    return xp.eye(s.A.shape[0]) - s.A + xp.outer(by_y, s.C), by_y * (dy - s.D * du) + xp.sum(s.B, axis=1) * du


def servo_response(s: Servo, period: float, w: Any, xp: Any = np) -> Any:
    """C(e^(jwh)) (F,) from the error to the input, no limit acting, at w (F,) in rad/s."""
    z = xp.exp(1j * w * period)
    n, past = s.A.shape[0], s.P.shape[0]
    back = z[:, None] ** -xp.arange(past + 1)
    kept = xp.eye(n) - xp.outer(s.gain, s.C)
    through = s.gain * s.D / z[:, None]
    by_u = back @ s.B.T - through @ s.A.T
    by_y = xp.broadcast_to((s.A @ s.gain).astype(by_u.dtype), by_u.shape)
    found = xp.linalg.solve(z[:, None, None] * xp.eye(n) - s.A @ kept, xp.stack([by_u, by_y], axis=-1))
    from_u, from_y = (found[..., k] @ kept.T @ s.K for k in (0, 1))
    below = 1.0 + from_u - through @ s.K + back[:, 1:] @ s.P
    return (from_y + s.gain @ s.K + s.Ki * period / (z - 1.0)) / below


def unstable_poles(s: Servo, period: float) -> int:
    """How many poles the controller itself has outside the unit circle."""
    n, past = s.A.shape[0], s.P.shape[0]
    size = n + past
    by_state = np.zeros(size + 1)  # the input by x, past inputs and integral, y being 0
    seen = np.r_[s.C, float(s.D) if past else np.zeros(0), np.zeros(max(past - 1, 0))]
    kept = np.eye(n, size) - np.outer(s.gain, seen)  # the corrected state
    by_state[:size] = -np.asarray(s.K) @ kept - np.r_[np.zeros(n), np.asarray(s.P)]
    by_state[size] = 1.0
    moved = np.zeros((size + 1, size + 1))
    moved[:n, :size] = np.asarray(s.A) @ kept
    moved[:n, n:size] += np.asarray(s.B)[:, 1:]
    moved[:n] += np.outer(np.asarray(s.B)[:, 0], by_state)
    if past:
        moved[n] = by_state
        moved[n + 1 : size, n : size - 1] = np.eye(past - 1)
    moved[size, size] = 1.0
    return int(np.sum(np.abs(np.linalg.eigvals(moved)) > 1.0 + 1e-7))
