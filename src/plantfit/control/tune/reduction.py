"""A plant reduced to one or two lags with dead time, for rules that know no other."""

from dataclasses import dataclass

import numpy as np
import scipy

from plantfit.control.tune.one_loop import Rest
from plantfit.errors import SimulationError

STILL = 1e-8  # of the fastest pole: a slower one is an integrator
UNSTABLE = 1e-6  # of a pole's size: a smaller real part is that of an oscillation without damping
SLOW = 1e-4  # of the slowest pole that moves: there integrators alone count
LONGEST = 1e9  # s: no time constant is longer


@dataclass(frozen=True)
class Reduced:
    """`first_order` (k, tau, theta) and `second_order` (k, tau1, tau2, theta); seconds, k in output per input, or
    per second of it where `integrating` (tau and tau1 then inf). `how` says by which method."""

    first_order: tuple[float, float, float]
    second_order: tuple[float, float, float, float]
    integrating: bool
    how: str


def slowest(small: Reduced) -> float:
    """Seconds that a reduced plant takes: its lag and its dead time."""
    _, lag, dead = small.first_order
    return (lag if np.isfinite(lag) else small.second_order[2]) + dead


def poles(rest: Rest, at: int = 0) -> np.ndarray:
    """Poles (s,) of one plant in 1/s."""
    return np.linalg.eigvals(rest.A[at])


def integrators(rest: Rest, at: int = 0) -> int:
    """How many poles lie at 0."""
    found = np.abs(poles(rest, at))
    return int(np.sum(found <= STILL * max(float(np.max(found)), 1.0 / LONGEST)))


def open_poles(rest: Rest, least: float) -> tuple[np.ndarray, np.ndarray]:
    """Of every plant (n,): how many poles frequencies from `least` (rad/s) on cannot tell from an integrator, and
    how many others are unstable."""
    a = np.where(np.isfinite(rest.A), rest.A, 0.0)
    found = np.linalg.eigvals(a)
    size = np.abs(found)
    near = size <= np.maximum(least, STILL * np.max(size, axis=1, keepdims=True))
    return np.sum(near, axis=1), np.sum(~near & (np.real(found) > UNSTABLE * size), axis=1)


def reduced(rest: Rest, extra: float = 0.0, at: int = 0) -> Reduced:
    """Plant number `at` as one and two lags with dead time, `extra` seconds of dead time added (half a sample for the
    hold).

    Real poles, no zero and one dead time: the half rule (S. Skogestad, J. Process Control 13 (2003) 291, section 2).
    Else least squares on the plant's exact step response. Raises SimulationError for a gain of 0 and for more than one
    integrator.
    """
    count, own = integrators(rest, at), poles(rest, at)
    if count > 1:
        raise SimulationError(
            f"The plant has {count} integrators between input and output; the rules of a PID know one at most. Close "
            "an inner loop of another output (--controller cascade --inner NAME), or hold its states (--hold)."
        )
    used = np.flatnonzero(
        np.max(np.abs(rest.B[at]), axis=1) + (np.arange(rest.B.shape[1]) == 0) * np.abs(rest.D[at]) > 0
    )
    moving = own[np.abs(own) > STILL * max(float(np.max(np.abs(own))), 1.0 / LONGEST)]
    real = np.all(np.abs(np.imag(moving)) <= 1e-9 * np.abs(moving))
    if len(used) == 1 and real and not len(_zeros(rest, at, int(used[0]))) and len(moving) + count == rest.A.shape[-1]:
        lags = np.sort(-1.0 / np.real(moving))[::-1]
        return _half_rule(gain_of(rest, at), lags, float(rest.late[at, used[0]]) + extra, bool(count))
    return _fitted(rest, at, count, extra, moving)


def behind(outer: Rest, inner: Rest, gains: tuple[float, float], row: np.ndarray, at: int = 0) -> Rest:
    """Plant number `at` from the set point of an inner loop to the outer output: the inner output `row` (s,) of the
    states under a PI of `gains` K and Ti (s), continuous, the dead time outside of the loop."""
    k, ti = gains
    n, b = outer.A.shape[-1], outer.B[at].sum(axis=0)
    a = np.zeros((n + 1, n + 1))
    a[:n, :n], a[:n, n], a[n, :n] = outer.A[at] - k * np.outer(b, row), k / ti * b, -row
    late = np.array([[float(np.max(inner.late[at]))]])
    return Rest(
        outer.x[at : at + 1], outer.u[at : at + 1], a[None], np.append(k * b, 1.0)[None, None],
        np.append(outer.C[at], 0.0)[None], np.zeros(1), late,
    )  # fmt: skip


def gain_of(rest: Rest, at: int = 0) -> float:
    """The gain at rest, or of the slope where there is an integrator, of the n-th derivative where there are n."""
    count = integrators(rest, at)
    b = rest.B[at].sum(axis=0)
    if count > 1:  # their eigenvectors are one and the same
        own = np.sort(np.abs(poles(rest, at)))
        s = SLOW * float(own[count]) if count < len(own) else 1.0
        return float(s**count * (rest.C[at] @ np.linalg.solve(s * np.eye(len(own)) - rest.A[at], b) + rest.D[at]))
    if not count:
        return float(rest.C[at] @ np.linalg.solve(-rest.A[at], b) + rest.D[at])
    values, left, right = scipy.linalg.eig(rest.A[at], left=True)
    k = int(np.argmin(np.abs(values)))
    scale = left[:, k].conj() @ right[:, k]
    return float(np.real((rest.C[at] @ right[:, k]) * (left[:, k].conj() @ b) / scale))


def _zeros(rest: Rest, at: int, way: int) -> np.ndarray:
    """Finite zeros from one way of the input to the output, those that cancel poles too."""
    n = rest.A.shape[-1]
    big = np.block(
        [[rest.A[at], rest.B[at, way][:, None]], [rest.C[at][None, :], np.array([[rest.D[at] if way == 0 else 0.0]])]]
    )
    unit = np.zeros((n + 1, n + 1))
    unit[:n, :n] = np.eye(n)
    scale = max(float(np.max(np.abs(poles(rest, at)))), 1e-12)
    found = scipy.linalg.eigvals(big, unit)
    return found[np.isfinite(found) & (np.abs(found) < 1e6 * scale)]


def _half_rule(k: float, lags: np.ndarray, dead: float, integrating: bool) -> Reduced:
    how = "half rule (Skogestad 2003)" if len(lags) > 1 - integrating else "as it is"
    if integrating:
        first = (k, np.inf, dead + float(np.sum(lags[:1]) * 0.5 + np.sum(lags[1:])))
        second = (
            k,
            np.inf,
            float(np.sum(lags[:1]) + 0.5 * np.sum(lags[1:2])),
            dead + float(0.5 * np.sum(lags[1:2]) + np.sum(lags[2:])),
        )
        return Reduced(first, second, True, how)
    one = (k, float(lags[0] + 0.5 * np.sum(lags[1:2])), dead + float(0.5 * np.sum(lags[1:2]) + np.sum(lags[2:])))
    two = (
        k,
        float(lags[0]),
        float(np.sum(lags[1:2]) + 0.5 * np.sum(lags[2:3])),
        dead + float(0.5 * np.sum(lags[2:3]) + np.sum(lags[3:])),
    )
    return Reduced(one, two, False, how)


def step_response(rest: Rest, t: np.ndarray, at: int = 0) -> np.ndarray:
    """The output (N,) of one plant at times t (N,) in s after a unit step of its input, dead time exact."""
    n = rest.A.shape[-1]
    y = np.where(t >= 0, rest.D[at], 0.0)
    for way in range(rest.B.shape[1]):
        big = np.zeros((n + 1, n + 1))
        big[:n, :n], big[:n, n] = rest.A[at], rest.B[at, way]
        since = np.maximum(t - rest.late[at, way], 0.0)
        y = y + scipy.linalg.expm(big * since[:, None, None])[:, :n, n] @ rest.C[at]
    return y


def _fitted(rest: Rest, at: int, count: int, extra: float, moving: np.ndarray) -> Reduced:
    """Both forms by least squares on the step response, which is made to end when it has come to rest."""
    k, longest = gain_of(rest, at), float(np.max(rest.late[at]))
    slow = float(np.sum(1.0 / np.abs(np.real(moving)))) if len(moving) else max(longest, 1.0)
    end = longest + 6.0 * slow
    t = np.linspace(0.0, end, 400)
    y = step_response(rest, t, at) / k

    def rise(tau1, tau2, theta):
        s = np.maximum(t - theta, 0.0)
        if count:
            return s - tau2 * (1.0 - np.exp(-s / tau2)) if tau2 > 0 else s
        if abs(tau1 - tau2) <= 1e-6 * tau1:
            return 1.0 - (1.0 + s / tau1) * np.exp(-s / tau1)
        if tau2 <= 0:
            return 1.0 - np.exp(-s / tau1)
        return 1.0 - (tau1 * np.exp(-s / tau1) - tau2 * np.exp(-s / tau2)) / (tau1 - tau2)

    def fit(parameters, start):
        low, high = [1e-6 * end] * (len(start) - 1) + [0.0], [end] * len(start)
        start = np.clip(start, np.array(low) * 1.01 + 1e-9 * end, 0.99 * np.array(high))
        return scipy.optimize.least_squares(lambda v: rise(*parameters(v)) - y, start, bounds=(low, high)).x

    if count:
        theta = float(fit(lambda v: (np.inf, 0.0, v[0]), [longest + 0.5 * slow])[0])
        lag, dead = (float(v) for v in fit(lambda v: (np.inf, v[0], v[1]), [slow, longest]))
        first, second = (k, np.inf, theta + extra), (k, np.inf, lag, dead + extra)
    else:
        tau, theta = (float(v) for v in fit(lambda v: (v[0], 0.0, v[1]), [slow, longest]))
        one, two, dead = (float(v) for v in fit(lambda v: (v[0], v[1], v[2]), [0.7 * slow, 0.2 * slow, longest]))
        first, second = (k, tau, theta + extra), (k, max(one, two), min(one, two), dead + extra)
    return Reduced(first, second, bool(count), "least squares on the step response")
