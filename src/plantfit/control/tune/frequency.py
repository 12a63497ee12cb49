"""Frequency responses of sampled loops with dead time kept exact, and the margins that they show."""

from typing import Any, NamedTuple

import numpy as np
import scipy

import plantfit.runtime  # noqa: F401
from plantfit.control.tune.one_loop import Rest

import jax.numpy as jnp

ROUNDING = 1e-9  # of a sample
LIGHTLY, NARROW = 0.15, 1e-3  # damping below which a peak may be narrower than the steps of a grid, and least width
AROUND = 4.0  # half widths of a peak that are looked at on both sides
PEAKS = (64, 128, 256, 512)  # frequencies there
NOTHING = 1e-9  # size of an open loop that counts as 0


class Margins(NamedTuple):
    """Of each of n loops: `ms` the largest |1/(1 + L)|, `mt` the largest |L/(1 + L)|, `gain` margin (a factor; inf
    without a phase crossing), `phase` margin (deg; inf without a gain crossing), `stable`, by the encirclements of
    -1."""

    ms: np.ndarray
    mt: np.ndarray
    gain: np.ndarray
    phase: np.ndarray
    stable: np.ndarray


def frequencies(period: float, slowest: float, count: int, *matrices: np.ndarray) -> np.ndarray:
    """Angular frequencies (F,) in rad/s from a thousandth of 1/`slowest` (s) to that of half the sampling: `count` of
    them, and more where plants with these `matrices` A (n, s, s) in 1/s swing with little damping."""
    most = np.pi / period
    even = np.geomspace(1e-3 / slowest, most, count)
    poles = np.concatenate([np.linalg.eigvals(A).ravel() for A in matrices] or [np.zeros(0)])
    poles = poles[(poles.imag > 0.0) & (np.abs(poles.real) < LIGHTLY * np.abs(poles))]
    at = np.abs((poles.imag + most) % (2.0 * most) - most)  # as the samples show it
    if not len(at):
        return even
    half = np.maximum(np.abs(poles.real), NARROW * at)
    more, order = [], np.argsort(at - AROUND * half)
    low, high, half = (at - AROUND * half)[order], (at + AROUND * half)[order], half[order]
    begins = np.flatnonzero(np.r_[True, low[1:] > np.maximum.accumulate(high)[:-1]])
    for k, end in zip(begins, [*begins[1:], len(at)], strict=True):
        begin, stop = max(low[k], even[0]), min(np.max(high[k:end]), most)
        needed = (stop - begin) / (0.5 * np.min(half[k:end]))
        if begin < stop:  # few lengths, because a search is compiled for each
            more.append(np.linspace(begin, stop, min((n for n in PEAKS if n >= needed), default=PEAKS[-1])))
    return np.unique(np.concatenate([even, *more]))


def continuous_response(rest: Rest, w: np.ndarray) -> np.ndarray:
    """G(jw) (n, F) of every plant, dead time as e^(-jw L), at w (F,) in rad/s."""
    s = 1j * w
    drive = np.einsum("ncs,ncf->nfs", rest.B, np.exp(-rest.late[:, :, None] * s))
    size = rest.A.shape[-1]
    x = np.linalg.solve(s[None, :, None, None] * np.eye(size) - rest.A[:, None], drive[..., None])[..., 0]
    return np.einsum("ns,nfs->nf", rest.C, x) + rest.D[:, None]


def sampled_response(rest: Rest, period: float, w: np.ndarray) -> np.ndarray:
    """H(e^(jwh)) (n, F) of every plant with its input held over `period` h (s), dead time exact also between samples.

        H = C (z - Phi)^-1 sum of z^-d (Gamma((1-f) h) + z^-1 e^(A (1-f) h) Gamma(f h)),   L = (d + f) h

    for every way of the input. Source: Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., section 2.3.
    """
    n, ways, size = rest.B.shape
    z = np.exp(1j * w * period)
    whole, phi, first, over = _moves(rest, period)
    drive = np.zeros((n, len(w), size), complex)
    for k in range(ways):
        back = z[None, :] ** -whole[:, k, None]
        drive += back[..., None] * (first[:, k, None, :] + over[:, k, None, :] / z[None, :, None])
    x = np.linalg.solve(z[None, :, None, None] * np.eye(size) - phi[:, None], drive[..., None])[..., 0]
    return np.einsum("ns,nfs->nf", rest.C, x) + rest.D[:, None] / z[None, :]


def input_matrices(rest: Rest, period: float) -> tuple[np.ndarray, np.ndarray]:
    """A (s, s) and B (p + 1, s) of the first plant sampled: x[k+1] = A x[k] + sum of B[j] u[k-j], all ways of the
    input together."""
    whole, phi, first, over = _moves(rest, period)
    counts = whole[0].astype(int)
    b = np.zeros((int(counts.max()) + 2, phi.shape[-1]))
    for k, d in enumerate(counts):
        b[d] += first[0, k]
        b[d + 1] += over[0, k]
    used = np.flatnonzero(np.any(b != 0, axis=1))
    return phi[0], b[: (used[-1] if len(used) else 0) + 1]


def _moves(rest: Rest, period: float) -> tuple[np.ndarray, ...]:
    """Of every plant and way of the input: whole samples of dead time (n, c); e^(A h) (n, s, s); what an input moves
    the states in the rest of the sample in which it arrives (n, c, s) and in the next one."""
    n = len(rest.B)
    counts = rest.late / period
    whole = np.floor(counts + ROUNDING)
    share = np.maximum(counts - whole, 0.0)
    phi, _ = _held(rest.A, rest.B[:, :1], np.full((n, 1), period))
    late, first = _held(rest.A, rest.B, (1.0 - share) * period)
    _, second = _held(rest.A, rest.B, share * period)
    return whole, phi[:, 0], first, np.einsum("nkij,nkj->nki", late, second)


def _held(a: np.ndarray, b: np.ndarray, seconds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """e^(A t) (n, c, s, s) and Gamma(t) = int_0^t e^(A s) ds B (n, c, s)."""
    n, ways, size = b.shape
    big = np.zeros((n, ways, size + 1, size + 1))
    big[..., :size, :size] = a[:, None]
    big[..., :size, size] = b
    found = scipy.linalg.expm(big * seconds[..., None, None])
    return found[..., :size, :size], found[..., :size, size]


def pid_response(gains: Any, period: float, w: Any, xp: Any = np) -> Any:
    """C(e^(jwh)) of `control.pid` from the error, gains as arrays that broadcast against w (F,)."""
    back = xp.exp(-1j * w * period)
    integral = gains.Ki * (0.5 * period) * (1.0 + back) / (1.0 - back)
    return gains.Kp + integral + gains.Kd * (1.0 - back) / (gains.filter_time * (1.0 - back) + period)


def margins_in_search(loop: Any) -> tuple[Any, Any]:
    """Gain margin (a factor) and phase margin (deg) of open loops (..., F) up to half the sampling frequency, large
    without a crossing; jax-traceable, on the grid alone."""
    a, b = loop[..., :-1], loop[..., 1:]
    part = a.imag / jnp.where(a.imag == b.imag, 1.0, a.imag - b.imag)
    real = a.real + part * (b.real - a.real)
    crossed = (a.imag * b.imag <= 0) & (a.imag != b.imag) & (real < 0) & (real > -1)
    last = -loop[
        ..., -1
    ].real  # the loop is real at half the sampling frequency, where the axis is reached and not crossed
    at_last = jnp.where((last > 0) & (last < 1), last, NOTHING)
    gain = 1.0 / jnp.maximum(jnp.max(jnp.where(crossed, -real, NOTHING), axis=-1), at_last)
    low, high = jnp.log(jnp.abs(a)), jnp.log(jnp.abs(b))
    share = low / jnp.where(low == high, 1.0, low - high)
    near = a + share * (b - a)
    angle = jnp.degrees(jnp.abs(jnp.angle(-near)))
    phase = jnp.min(jnp.where((low * high <= 0) & (low != high), angle, 1e9), axis=-1)
    return gain, phase


def open_loop(c: Any, h: Any, xp: Any = np) -> Any:
    """L (n, F) at the plants' input: of a controller c (F,) and h (n, F), or of a cascade's c (2, F) and h (n, 2,
    F)."""
    return c[None, :] * h if c.ndim == 1 else xp.sum(c[None] * h, axis=1)


def outer_loop(c: Any, h: Any) -> Any:
    """L (n, F) at the outer output of a cascade, its inner loop closed."""
    return c[0] * h[:, 0] / (1.0 + c[1] * h[:, 1])


def noise_at_input(c: Any, s: Any, weights: Any, noise: Any, xp: Any = np) -> Any:
    """Standard deviation (n,) that measurement noise gives the input: s (n, F) sensitivities, `weights` (F,) of the
    spectrum's frequencies, `noise` standard deviations, one or two."""
    if c.ndim == 1:
        return noise * xp.sqrt(xp.sum(xp.abs(c * s) ** 2 * weights, axis=-1))
    return xp.sqrt(xp.sum(xp.sum(xp.abs(c * noise[:, None]) ** 2, axis=0) * xp.abs(s) ** 2 * weights, axis=-1))


def noise_in_moves(c: Any, s: Any, w: Any, period: float, weights: Any, noise: Any, xp: Any = np) -> Any:
    """Standard deviation (n,) that measurement noise gives every move of the input, from one sample of `period` h (s)
    to the next: that of `noise_at_input` behind 1 - z^-1, at w (F,) in rad/s."""
    return noise_at_input(c * (1.0 - xp.exp(-1j * w * period)), s, weights, noise, xp)


def loop_margins(c: np.ndarray, h: np.ndarray, w: np.ndarray, integrators: Any, unstable: Any = 0) -> Margins:
    """`Margins` of a controller on plants; of a cascade the worse of those at the input and at the outer output."""
    found = margins(open_loop(c, h), w, integrators, unstable)
    if c.ndim == 1:
        return found
    # its encirclements say nothing: poles of the inner loop are not known
    outside = margins(outer_loop(c, h), w, 0, held=found.stable)
    smaller = [
        np.where(found.stable, np.minimum(a, np.abs(b)), a)
        for a, b in ((found.gain, outside.gain), (found.phase, outside.phase))
    ]
    return Margins._make([np.maximum(found.ms, outside.ms), np.maximum(found.mt, outside.mt), *smaller, found.stable])


def poles_outside(loop: Any, integrators: Any, unstable: Any, xp: Any = np) -> Any:
    """How many poles (n,) of closed loops lie outside the unit circle, by open loops L (n, F) as `margins` takes them.

    On the way from 0 to half the sampling frequency the argument of 1 + L grows by pi/2 for each integrator and pi for
    each unstable pole if the closed loop is stable, and by pi less for each pole outside (the argument principle:
    closed over open characteristic polynomial).
    """
    back = 1.0 + loop
    turned = xp.sum(xp.angle(back[:, 1:] * xp.conj(back[:, :-1])), axis=1)
    # before the first frequency 1 + L comes from the direction of (j w)^-integrators, times the sign of its gain
    far = xp.where(integrators > 0, loop[:, 0], back[:, 0])
    behind = xp.where(xp.real(far * 1j**integrators) < 0, xp.pi, 0.0)
    begin = xp.angle(back[:, 0]) - (behind - 0.5 * xp.pi * integrators)
    begin = (begin + xp.pi) % (2 * xp.pi) - xp.pi
    return unstable + xp.rint((0.5 * xp.pi * integrators - (turned + begin)) / xp.pi)


def margins(
    loop: np.ndarray, w: np.ndarray, integrators: Any, unstable: Any = 0, held: np.ndarray | None = None
) -> Margins:
    """`Margins` of open loops L (n, F) at w (F,) that reach half the sampling frequency; poles of L lie inside the unit
    circle but for `integrators` at 1 and `unstable` ones outside, numbers for all loops or (n,).

    `held` (n,) says which closed loops are stable where that is known otherwise.
    """
    integrators = np.broadcast_to(integrators, len(loop))
    distance = np.abs(1.0 + loop)
    with np.errstate(all="ignore"):
        ms, mt = np.max(1.0 / distance, axis=1), np.max(np.abs(loop) / distance, axis=1)
    outside = poles_outside(loop, integrators, unstable) if held is None else np.where(held, 0, 1)
    gain, phase = np.full(len(loop), np.inf), np.full(len(loop), np.inf)
    angle, size = np.unwrap(np.angle(loop), axis=1), np.log(np.abs(loop))
    # the loop is real at half the sampling frequency, where the axis is reached and not crossed
    last = np.real(loop[:, -1])
    for i in range(len(loop)):
        factors = -1.0 / last[i : i + 1][last[i : i + 1] < -NOTHING]
        turns = np.floor((angle[i] + np.pi) / (2 * np.pi))  # changes where the angle passes an odd multiple of pi
        at = np.flatnonzero(turns[1:] != turns[:-1])
        if len(at):
            line = (np.maximum(turns[at], turns[at + 1]) * 2 - 1) * np.pi
            part = (line - angle[i, at]) / (angle[i, at + 1] - angle[i, at])
            factors = np.append(factors, np.exp(-(size[i, at] + part * (size[i, at + 1] - size[i, at]))))
        gain[i] = np.min(factors[factors > 1.0] if outside[i] == 0 else factors, initial=np.inf)
        at = np.flatnonzero((size[i, 1:] <= 0) != (size[i, :-1] <= 0))
        if len(at):
            part = -size[i, at] / (size[i, at + 1] - size[i, at])
            crossing = angle[i, at] + part * (angle[i, at + 1] - angle[i, at])
            phase[i] = np.degrees(np.min(np.abs((crossing + np.pi + np.pi) % (2 * np.pi) - np.pi)))
            if outside[i] != 0:
                phase[i] = -phase[i]
    return Margins(ms, mt, gain, phase, outside == 0)
