"""LQ servo: feedback of states that a Kalman filter estimates, inputs on their way through dead time and a load at
the input among them."""

import math
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Settings, checked
from plantfit.simulate.loop.closed_loop import Controller

import jax.numpy as jnp


class Servo(NamedTuple):
    """Parameters of `servo`, deviations from (x0, u0, y0); the plant has n - 1 states, x[n - 1] is the load, and p past
    inputs still act.

        x[k+1] = A x[k] + B (u[k], u[k-1], .., u[k-p]),  y = C x + D u[k-1]
        s grows by share (r - y0 - s) a sample,  u = f s - K x - P (u[k-1], .., u[k-p])

    A (n, n), B (n, p + 1), C (n,), D (), gain (n,) of the filter, K (n,), P (p,), f () and share () of the set point;
    `rest` (n,) states and input that rest where the output is 1 higher; u0, y0.
    """

    A: Any
    B: Any
    C: Any
    D: Any
    gain: Any
    K: Any
    P: Any
    f: Any
    share: Any
    rest: Any
    u0: Any
    y0: Any


def servo(period: float, *, lower: float = -math.inf, upper: float = math.inf) -> Controller:
    """The controller every `period` s whose parameters are (`Servo`, the input at which the loop rests before the first
    sample).

    Its integral action is the estimated load, which the input takes back: at rest the output is at the set point
    whatever the gain of the true plant. The filter knows the limited command, so that nothing winds up. Source: Astrom,
    Wittenmark, Computer-Controlled Systems, 3rd ed., sections 4.5 (integral action by an estimated disturbance) and
    11.3 - 11.4.
    """
    checked(Settings(period, lower, upper, "none", None))

    def init(measurement, parameters):
        s, rest = parameters
        dy, du = measurement - s.y0, rest - s.u0
        return s.rest * dy - du * (jnp.arange(s.rest.shape[0]) == s.rest.shape[0] - 1), jnp.full(s.P.shape, du), dy

    def update(state, measurement, reference, parameters):
        (x, past, followed), (s, _) = state, parameters
        through = s.D * past[0] if past.shape[0] else 0.0
        x = x + s.gain * (measurement - s.y0 - s.C @ x - through)
        followed = followed + s.share * (reference - s.y0 - followed)
        command = jnp.clip(s.f * followed - s.K @ x - s.P @ past, lower - s.u0, upper - s.u0)
        inputs = jnp.concatenate([command[None], past])
        return (s.A @ x + s.B @ inputs, inputs[: past.shape[0]], followed), command + s.u0

    return Controller(init, update)


def servo_response(s: Servo, period: float, w: Any, xp: Any = np) -> Any:
    """C(e^(jwh)) (F,) from the error to the input, no limit acting, at w (F,) in rad/s."""
    above, below = servo_parts(s, period, w, xp)
    return above / below


def servo_parts(s: Servo, period: float, w: Any, xp: Any = np) -> tuple[Any, Any]:
    """Above and below the line of `servo_response`, each (F,): polynomials over the characteristic one of the filter's
    error, whose zeros lie inside the unit circle, and over powers of z."""
    z = xp.exp(1j * w * period)
    n, past = s.A.shape[0], s.P.shape[0]
    back = z[:, None] ** -xp.arange(past + 1)
    kept = xp.eye(n) - xp.outer(s.gain, s.C)
    through = s.gain * s.D / z[:, None]
    by_u = back @ s.B.T - through @ s.A.T
    by_y = xp.broadcast_to((s.A @ s.gain).astype(by_u.dtype), by_u.shape)
    found = xp.linalg.solve(z[:, None, None] * xp.eye(n) - s.A @ kept, xp.stack([by_u, by_y], axis=-1))
    from_u, from_y = (found[..., k] @ kept.T @ s.K for k in (0, 1))
    return from_y + s.gain @ s.K, 1.0 + from_u - through @ s.K + back[:, 1:] @ s.P


def unstable_poles(s: Servo) -> int:
    """How many poles the controller itself has outside the unit circle; one lies at 1, its integral action."""
    n, past = s.A.shape[0], s.P.shape[0]
    size = n + past
    seen = np.r_[s.C, float(s.D) if past else np.zeros(0), np.zeros(max(past - 1, 0))]
    kept = np.eye(n, size) - np.outer(s.gain, seen)  # the corrected state, y being 0
    command = -np.asarray(s.K) @ kept - np.r_[np.zeros(n), np.asarray(s.P)]
    moved = np.zeros((size, size))
    moved[:n] = np.asarray(s.A) @ kept + np.outer(np.asarray(s.B)[:, 0], command)
    moved[:n, n:] += np.asarray(s.B)[:, 1:]
    if past:
        moved[n] = command
        moved[n + 1 :, n : size - 1] = np.eye(past - 1)
    return int(np.sum(np.abs(np.linalg.eigvals(moved)) > 1.0 + 1e-6))
