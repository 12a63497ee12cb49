"""Steps as long as their error allows, each candidate with its own: for sharp friction and stiff corners of a box.

One step is the third-order exponential Rosenbrock pair exprb32 (M. Hochbruck, A. Ostermann, J. Schweitzer, SIAM J.
Numer. Anal. 47 (2009) 786). Rational functions stand in place of its functions of Z, all with the denominator of
`exponential.exponential`,

    x1 = x + h v                                        (order 2)
    x2 = x1 + 2 h phi3(Z) dN,  dN = f(x1) - f(x) - Z v - d,   2 phi3(Z) = (1 - 5/12 Z)/(3 (1 - 2/3 Z + Z^2/6)),
    (1)

and goes on with x2. The error of a step is taken as h |2 phi3(Z) dN|, what the second stage changed, plus that of the
rational exponential on the linear part, h |Z^2 (1 - 2/3 Z + Z^2/6)^-1 (f + d)|/72, each state's as a share of the
largest size that the state has had in this interval: a state that has died away asks for nothing, and neither does what
rounding of the rate leaves of a state at rest. A state that begins at zero grows as a power of time, so that its error
is the same share of it however short a step is: it counts as large as it would be after a hundredth of the interval at
its rate.

Most intervals are good in one such step, which costs twice that of `exponential.exponential` (`_at_once`). Where it is
not, and the linear part is to blame, one and two states have functions of Z that are exact, as their eigenvalues are
known in closed form: between the moments at which friction turns round, a motor takes one step. Only then is the
interval divided (`_divided`).

A step could be exact enough although the rate turns round in it: friction is then jumped over to and fro, far inside of
the tolerance and without end. Such a step is tried anew with a tenth of its length, which finds where the state sticks.

The sequence of steps follows from the candidate alone, never from those beside it. Derivatives are those of the
sequence as it is: lengths of steps are constant shares of the interval.
"""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.exponential import inverse_of_pair, solution
from plantfit.simulate.steps.steppers import Matrix, dot, drift_of, jacobian_of, plus, times
from plantfit.simulate.steps.switching.switched import Switching

import jax
import jax.numpy as jnp

TOLERANCE = 0.1  # error of a step as a share of the state, at fineness 1
FINEST = 1000  # 1e-10 of the state
LEVELS, WIDTH = 4, 10  # at most 10^4 trials in an interval
SHORT, LOST = 1e-15, 2.0  # of the interval: a step that is none, and where a state counts as done that has met a pole
SOON = 0.01  # of the interval, for which a state that began at zero is taken to grow as it does now
APART, STEEPEST = 0.01, 50.0  # eigenvalues of Z this far apart and up to this are taken by their exponentials
NEAR, TERMS = 0.01, 5  # size of an eigenvalue below which series are taken, and their terms
WHOLE = 0.3  # of the allowed error, for an interval in one step: what follows in the next ones has not been seen
ROUGH = 0.1  # of the allowed error, up to which the linear part is left to rational functions
NOISE = 1e-14  # rounding of a rate, as a share of the terms that it is a sum of
SAFETY, SHORTEST, LONGEST = 0.9, 0.1, 5.0  # of the next step, in lengths of this one
# share of a step's way that the second stage changes, and of the allowed error, from which on it is tried anew
BENT, SEEN = (0.25, 1e-5)


def tolerance(fineness: int) -> float:
    """Error of a step as a share of the state; twice the fineness makes steps of order 2 half as long and quarters
    the error."""
    return TOLERANCE / fineness**3


def adaptive(fineness: int) -> Switching:
    """A stepper (see `steppers`) that divides the interval it is given as the error of each part asks for.

    States are NaN where an interval takes more than 10 000 trials.
    """
    allowed = tolerance(fineness)

    def quiet(rate, x, u0, u1, h, p, varying, pattern=None):
        later, good = _at_once(rate, x, u0, u1, h, p, varying, pattern, allowed)
        return later, ~good

    return Switching(partial(_divided, _until, allowed), partial(_divided, _in_blocks, allowed), quiet)


def _divided(repeated, allowed, rate, x, u0, u1, h, p, varying, pattern=None):
    """The states after an interval in as many steps as their error asks for; `repeated` is the loop around a trial."""

    def between(share):
        return tuple(a + (b - a) * share for a, b in zip(u0, u1, strict=True)) if varying else u0

    def tried(carry):
        x, done, length, largest = carry
        length = jnp.minimum(length, 1.0 - done)
        last = length >= 1.0 - done
        end = jnp.where(last, 1.0, done + length)
        found = _trial(
            rate, x, between(done), between(end) if varying else u1, length * h, p, varying, pattern, allowed
        )
        size = tuple(map(jnp.maximum, largest, map(_size, found.later)))
        soon = tuple(  # how large a state that began at zero is going to be
            jnp.where(v == 0.0, jnp.maximum(s, SOON * _size(h * w)), s)
            for v, s, w in zip(begin, size, found.way, strict=True)
        )
        # what begins at zero is bent at first, as a power of time
        may = [a <= b for a, b in zip(soon, size, strict=True)]
        worst, strained = _worst(found, soon, allowed), _strained(found, soon, allowed, may)
        # nothing comes after a state that is not finite, or that no step leads away from: a pole
        stuck = (length < SHORT) & ~last
        lost = ~jnp.isfinite(sum(map(jax.lax.stop_gradient, x))) | stuck
        good = ((worst <= 1.0) & ~strained) | lost
        return (
            tuple(jnp.where(good, b, a) for a, b in zip(x, found.later, strict=True)),
            jnp.where(lost, jnp.where(stuck, LOST, 1.0), jnp.where(good, end, done)),
            length * _factor(worst, strained),
            tuple(jnp.where(good, b, a) for a, b in zip(largest, size, strict=True)),
        )

    begin = tuple(jnp.asarray(v, dtype=float) for v in x)
    x, done, *_ = repeated(tried)((begin, jnp.zeros(()), jnp.ones(()), tuple(map(_size, begin))))
    return tuple(jnp.where((done < 1.0) | (done >= LOST), jnp.nan, v) for v in x)


def _at_once(rate, x, u0, u1, h, p, varying, pattern, allowed) -> tuple[tuple[Any, ...], Any]:
    """The states after an interval in one step by rational functions, and whether that is good, judged in few words:
    `_trial` may find good what is refused here."""
    z, _, linear, more, later = _stages(rate, x, u0, u1, h, p, varying, pattern, None)
    good = jnp.ones((), dtype=bool)
    for a, row, c, e in zip(x, z, more, linear, strict=True):
        good &= _size(h * plus(c, e)) <= WHOLE * allowed * _size(a) + NOISE * _size(dot(row, x))
    return later, good


def _size(a: Any) -> Any:
    return jnp.abs(jax.lax.stop_gradient(a))


def _worst(found: "_Trial", size: Sequence[Any], allowed: float) -> Any:
    """The largest error of a trial as a share of what is allowed; NaN where one is not a number."""
    worst = jnp.zeros(())
    for e, n, s in zip(found.errors, found.noise, size, strict=True):
        share = jnp.maximum(e - n, 0.0) / jnp.maximum(allowed * s, 1e-300)
        worst = jnp.where((share > worst) | jnp.isnan(share), share, worst)
    return worst


def _strained(found: "_Trial", size: Sequence[Any], allowed: float, may: Sequence[Any]) -> Any:
    """Whether the rate may turn round in a step, of states that `may` tell it."""
    strained = jnp.zeros((), dtype=bool)
    for e, n, s, bent, told in zip(found.errors, found.noise, size, found.bent, may, strict=True):
        strained |= bent & told & (e > SEEN * allowed * s + n)
    return strained


def _factor(worst: Any, strained: Any) -> Any:
    """Length of the next trial, in lengths of this one."""
    factor = jnp.clip(SAFETY / jnp.sqrt(jnp.sqrt(jnp.maximum(worst, 1e-6))), SHORTEST, LONGEST)
    return jnp.where(jnp.isfinite(worst) & ~strained, factor, SHORTEST)


def _until(tried: Callable) -> Callable:
    """`tried` until the interval is done, at most WIDTH^LEVELS times; no derivatives are taken of it."""

    def trials(carry):
        def more(state):
            return (state[0][1] < 1.0) & (state[1] < WIDTH**LEVELS)

        return jax.lax.while_loop(more, lambda state: (tried(state[0]), state[1] + 1), (carry, 0))[0]

    return trials


def _in_blocks(tried: Callable, levels: int = LEVELS) -> Callable:
    """The same as loops in loops, so that what is not needed is skipped in blocks, and backwards only the carry of
    each is kept."""
    if levels == 0:
        return tried
    inner = _in_blocks(tried, levels - 1)

    def needed(carry, _):
        return jax.lax.cond(carry[1] < 1.0, inner, lambda carry: carry, carry), None

    return jax.checkpoint(lambda carry: jax.lax.scan(needed, carry, None, length=WIDTH)[0])


class _Trial(NamedTuple):
    """What a step gives: of every state its later value (eq. 1), the estimated error, what rounding of the rate may
    add to it, whether the second stage changed much of its way, and its mean rate."""

    later: tuple[Any, ...]
    errors: tuple[Any, ...]
    noise: tuple[Any, ...]
    bent: tuple[Any, ...]
    way: tuple[Any, ...]


def _trial(rate, x, u0, u1, h, p, varying, pattern, allowed) -> _Trial:
    """One step of length h (s), whose error may be the share `allowed` of a state."""

    def noise_of(z):
        return tuple(NOISE * sum((_size(times(a, b)) for a, b in zip(row, x, strict=True)), jnp.zeros(())) for row in z)

    def limits(z):
        return [ROUGH * allowed * _size(a) + m for a, m in zip(x, noise_of(z), strict=True)]

    z, v, linear, more, later = _stages(rate, x, u0, u1, h, p, varying, pattern, limits)
    errors = tuple(_size(h * a) + _size(h * e) for a, e in zip(more, linear, strict=True))
    bent = tuple(_size(a) > BENT * _size(b) for a, b in zip(more, v, strict=True))
    return _Trial(later, errors, noise_of(z), bent, tuple(plus(a, b) for a, b in zip(v, more, strict=True)))


def _stages(rate, x, u0, u1, h, p, varying, pattern, limits: Callable[[Matrix], Sequence[Any]] | None):
    """Z, v and the error of its linear part, 2 phi3(Z) dN, and the later states of eq. (1); `limits` of Z as
    `_linear` takes them."""
    f, jacobian = jacobian_of(rate, x, u0, p, pattern)
    z = [[times(h, a) for a in row] for row in jacobian]
    d = drift_of(rate, x, u0, u1, p)[1] if varying else (0.0,) * len(x)
    v, linear, second = _linear(z, f, d, h, None if limits is None else limits(z))
    first = tuple(a + h * b for a, b in zip(x, v, strict=True))
    more = second([a - b for a, b in zip(rate(first, u1, p), _at_the_end(z, f, d, v), strict=True)])
    return z, v, linear, more, tuple(a + h * b for a, b in zip(first, more, strict=True))


def _at_the_end(z: Matrix, f: Sequence[Any], d: Sequence[Any], v: Sequence[Any]) -> list[Any]:
    """The rates after a step of mean rates v, of the linear part."""
    return [plus(a, plus(dot(row, v), b)) for a, b, row in zip(f, d, z, strict=True)]


def _error(z: Matrix, f: Sequence[Any], d: Sequence[Any], v: Sequence[Any]) -> list[Any]:
    """Z^2 (1 - 2/3 Z + Z^2/6)^-1 (f + d)/72, which is (f + (f + Z v) - 2 v)/12 where inputs are held."""
    if all(isinstance(a, float) and a == 0.0 for a in d):
        return [(plus(a, b) - 2.0 * c) * (1.0 / 12.0) for a, b, c in zip(f, _at_the_end(z, f, d, v), v, strict=True)]
    moved = [plus(a, b) for a, b in zip(f, d, strict=True)]
    return solution(z, (0.0, -1.0 / 12.0, [dot(row, moved) for row in z]))


def _linear(
    z: Matrix, f: Sequence[Any], d: Sequence[Any], h: Any, limits: Sequence[Any] | None
) -> tuple[Sequence[Any], Sequence[Any], Callable[[Sequence[Any]], list[Any]]]:
    """v = phi1(Z) f + phi2(Z) d, the error of what stands for the exponential there, and the function y -> 2 phi3(Z) y.

    By rational functions, which take a fraction of the time; of one and two states by exponential ones where h times
    that error is above `limits`.
    """
    v: Sequence[Any] = solution(z, (1.0, 1.0, f), (0.5, 1.0, d))
    linear = _error(z, f, d, v)
    if limits is None or len(f) > 2:
        return v, linear, lambda y: solution(z, (1.0 / 3.0, 5.0 / 6.0, y))
    of, values = (_of_one, _values_of_one) if len(f) == 1 else (_of_two, _values_of_two)
    fine = jnp.ones((), dtype=bool)
    for e, most in zip(linear, limits, strict=True):
        fine &= _size(h * e) <= most
    rational, exact = values(z)
    given = v, linear, rational[2]

    def exactly():
        holds, (one, two, three) = exact()
        v = [plus(a, b) for a, b in zip(of(z, one, f), of(z, two, d), strict=True)]
        return v, [jnp.where(holds, 0.0, e) for e in linear], three

    v, linear, third = jax.lax.cond(fine, lambda: given, exactly)
    return v, linear, lambda y: of(z, third, y)


Values = tuple[tuple[Any, ...], ...]
"""What phi1, phi2 and 2 phi3 are: c of c I, or (c, g) of c I + g Z."""


def _of_one(z: Matrix, value: tuple[Any, ...], y: Sequence[Any]) -> list[Any]:
    return [times(value[0], y[0])]


def _of_two(z: Matrix, value: tuple[Any, ...], y: Sequence[Any]) -> list[Any]:
    return [plus(times(value[0], a), times(value[1], dot(row, y))) for a, row in zip(y, z, strict=True)]


def _values_of_one(z: Matrix) -> tuple[Values, Callable[[], tuple[Any, Values]]]:
    """The rational functions of one state, and the exponential ones where they hold, which is not for large growth."""
    value = jnp.asarray(z[0][0], dtype=float)
    inverse = 1.0 / (1.0 + value * (value / 6.0 - 2.0 / 3.0))
    rational = tuple((a * inverse,) for a in (1.0 - value / 6.0, 0.5 - value / 6.0, 1.0 / 3.0 - 5.0 / 36.0 * value))

    def exact() -> tuple[Any, Values]:
        holds = value < STEEPEST
        one, two, three = _phi(jnp.where(holds, value, -1.0))
        return holds, jax.tree.map(lambda a, b: jnp.where(holds, a, b), ((one,), (two,), (2.0 * three,)), rational)

    return rational, exact


def _values_of_two(z: Matrix) -> tuple[Values, Callable[[], tuple[Any, Values]]]:
    """The rational functions of two states, and the exponential ones where they hold: by the divided difference of
    real eigenvalues, by the imaginary part of complex ones; rational ones where both are close together, or both
    small."""
    rational, half = _rational(z), 0.5 * jnp.asarray(plus(z[0][0], z[1][1]), dtype=float)

    def exact() -> tuple[Any, Values]:
        # (trace/2)^2 - det without its cancellation
        square = (0.5 * plus(z[0][0], times(-1.0, z[1][1]))) ** 2 + jnp.asarray(times(z[0][1], z[1][0]), dtype=float)
        turning, size = square < 0.0, jnp.abs(half)
        way = jnp.sqrt(jnp.maximum(jnp.abs(square), APART**2))
        holds = (jnp.abs(square) > APART**2) & (size + way > NEAR) & (half + jnp.where(turning, 0.0, way) < STEEPEST)
        found = _exponential(jnp.where(holds, half, -1.0), way, turning)
        return holds, jax.tree.map(lambda a, b: jnp.where(holds, a, b), found, rational)

    return rational, exact


def _rational(z: Matrix) -> Values:
    """(I - 2/3 Z + Z^2/6)^-1 (c I + g Z), by Z^2 = trace Z - det I."""
    a, b, trace, det = (jnp.asarray(v, dtype=float) for v in inverse_of_pair(z))
    whole = a + b * trace
    return tuple(
        (c * whole + g * b * det, g * a - c * b)
        for c, g in ((1.0, -1.0 / 6.0), (0.5, -1.0 / 6.0), (1.0 / 3.0, -5.0 / 36.0))
    )


def _exponential(half: Any, way: Any, turning: Any) -> Values:
    """Those for the eigenvalues half +- way, or half +- i way where it is `turning`."""
    signed = jnp.where(half < 0.0, -way, way)
    far = jnp.where(turning, half, half + signed)
    grown = jnp.exp(far)
    real, imaginary = grown * jnp.cos(way), grown * jnp.sin(way)
    small, once = _phi(half - signed), _recurred(grown, far)
    inverse, per_way, found = 1.0 / (half * half + way * way), 1.0 / way, []
    for k, (constant, share) in enumerate(((1.0, 1.0), (1.0, 1.0), (0.5, 2.0))):
        a, b = real - constant, imaginary
        real, imaginary = (a * half + b * way) * inverse, (b * half - a * way) * inverse
        by_z = jnp.where(
            turning, imaginary * per_way, (once[k] - small[k]) * jnp.where(half < 0.0, -0.5, 0.5) * per_way
        )
        own = jnp.where(turning, real, 0.5 * (once[k] + small[k])) - half * by_z
        found.append((share * own, share * by_z))
    return tuple(found)


def _phi(value: Any) -> tuple[Any, Any, Any]:
    """phi_1, phi_2, phi_3 of a number: (exp(z) - 1)/z, and phi_(k+1) = (phi_k - 1/k!)/z; by their series where that
    cancels."""
    small = jnp.abs(value) < NEAR
    near, far = jnp.where(small, value, 0.0), jnp.where(small, 1.0, value)
    third = jnp.zeros_like(near)
    for k in reversed(range(TERMS)):
        third = third * near + 1.0 / math.factorial(k + 3)
    second = third * near + 0.5
    series = (second * near + 1.0, second, third)
    one, two, three = (jnp.where(small, a, b) for a, b in zip(series, _recurred(jnp.exp(far), far), strict=True))
    return one, two, three


def _recurred(grown: Any, value: Any) -> tuple[Any, Any, Any]:
    """phi_1, phi_2, phi_3 of a number that is not small, and its exponential."""
    inverse = 1.0 / value
    one = (grown - 1.0) * inverse
    two = (one - 1.0) * inverse
    return one, two, (two - 0.5) * inverse
