"""Steps as long as their error allows, each candidate with its own: for sharp friction and stiff corners of a box.

One step is the third-order exponential Rosenbrock pair exprb32 (M. Hochbruck, A. Ostermann, J. Schweitzer, SIAM J. Numer. Anal. 47
(2009) 786). Its functions of Z are exact for one and two states, whose eigenvalues are known in closed form: between the moments at which
friction turns round, a motor takes one step. For more states, and where both eigenvalues are nearly the same, rational functions stand
in place of the exponential ones, all with the denominator of `steppers.exponential`,

    x1 = x + h v                                        (order 2)
    x2 = x1 + 2 h phi3(Z) dN,  dN = f(x1) - f(x) - Z v - d,   2 phi3(Z) = (1 - 5/12 Z)/(3 (1 - 2/3 Z + Z^2/6)),           (1)

and goes on with x2. The error of a step is taken as h |2 phi3(Z) dN|, what the second stage changed, plus that of the rational
exponential on the linear part, h |Z^2 (1 - 2/3 Z + Z^2/6)^-1 (f + d)|/72, each state's as a share of the largest size that the state
has had in this interval: a state that has died away asks for nothing. A state that begins at zero grows as a power of time, so that its
error is the same share of it however short a step is: it counts as large as it would be after a hundredth of the interval at its rate.

A step could be exact enough although the rate turns round in it: friction is then jumped over to and fro, far inside of the tolerance
and without end. Such a step is tried anew with a tenth of its length, which finds where the state sticks.

The sequence of steps follows from the candidate alone, never from those beside it. Derivatives are those of the sequence as it is:
lengths of steps are constant shares of the interval.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.steppers import dot, drift_of, factored, jacobian_of, plus, times

import jax
import jax.numpy as jnp

Stepper = Callable[..., tuple[Any, ...]]

TOLERANCE = 0.1  # error of a step as a share of the state, at fineness 1
FINEST = 1000  # 1e-10 of the state
LEVELS, WIDTH = 3, 20  # at most 20^3 trials in an interval
SHORT, LOST = 1e-15, 2.0  # of the interval: a step that is none, and where a state counts as done that has met a pole
SOON = 0.01  # of the interval, for which a state that began at zero is taken to grow as it does now
APART, STEEPEST = 0.01, 50.0  # eigenvalues of Z this far apart and up to this are taken by their exponentials
NEAR, TERMS = 0.01, 5  # size of an eigenvalue below which series are taken, and their terms
SAFETY, SHORTEST, LONGEST = 0.9, 0.1, 5.0  # of the next step, in lengths of this one
BENT, SEEN = 0.25, 1e-5  # share of a step's way that the second stage changes, and of the allowed error, from which on it is tried anew


def tolerance(fineness: int) -> float:
    """Error of a step as a share of the state; twice the fineness makes steps of order 2 half as long and quarters the error."""
    return TOLERANCE / fineness**3


def adaptive(fineness: int) -> Stepper:
    """A stepper (see `steppers`) that divides the interval it is given as the error of each part asks for.

    States are NaN where an interval takes more than 8000 trials.
    """
    allowed = tolerance(fineness)

    def stepper(rate, x, u0, u1, h, p, varying, pattern=None):
        def between(share):
            return tuple(a + (b - a) * share for a, b in zip(u0, u1, strict=True)) if varying else u0

        def tried(carry):
            x, done, length, largest = carry
            length = jnp.minimum(length, 1.0 - done)
            last = length >= 1.0 - done
            end = jnp.where(last, 1.0, done + length)
            later, errors, bent, way = _pair(rate, x, between(done), u1 if not varying else between(end), length * h, p, varying, pattern)
            size = tuple(jnp.maximum(s, jnp.abs(jax.lax.stop_gradient(b))) for s, b in zip(largest, later, strict=True))
            soon = tuple(  # how large a state that began at zero is going to be
                jnp.where(v == 0.0, jnp.maximum(s, SOON * jnp.abs(jax.lax.stop_gradient(h * w))), s)
                for v, s, w in zip(begin, size, way, strict=True)
            )
            worst, strained = jnp.zeros(()), False
            for e, s, larger, b in zip(errors, size, soon, bent, strict=True):
                share = jax.lax.stop_gradient(e) / jnp.maximum(allowed * larger, 1e-300)
                strained |= b & (share > SEEN) & (larger <= s)  # what begins at zero is bent at first, as a power of time
                worst = jnp.where((share > worst) | jnp.isnan(share), share, worst)
            # nothing comes after a state that is not finite, or that no step leads away from: a pole
            stuck = (length < SHORT) & ~last
            lost = ~jnp.isfinite(sum(map(jax.lax.stop_gradient, x))) | stuck
            good = ((worst <= 1.0) & ~strained) | lost
            factor = jnp.clip(SAFETY / jnp.sqrt(jnp.sqrt(jnp.maximum(worst, 1e-6))), SHORTEST, LONGEST)
            factor = jnp.where(jnp.isfinite(worst) & ~strained, factor, SHORTEST)
            return (
                tuple(jnp.where(good, b, a) for a, b in zip(x, later, strict=True)),
                jnp.where(lost, jnp.where(stuck, LOST, 1.0), jnp.where(good, end, done)),
                length * factor,
                tuple(jnp.where(good, b, a) for a, b in zip(largest, size, strict=True)),
            )

        begin = tuple(jnp.asarray(v, dtype=float) for v in x)
        carry = (begin, jnp.zeros(()), jnp.ones(()), tuple(jnp.abs(jax.lax.stop_gradient(v)) for v in begin))
        x, done, *_ = _repeated(tried, LEVELS)(carry)
        return tuple(jnp.where((done < 1.0) | (done >= LOST), jnp.nan, v) for v in x)

    return stepper


def _repeated(tried: Callable, levels: int) -> Callable:
    """`tried` until the interval is done, at most WIDTH^levels times: loops in loops, so that what is not needed is skipped in blocks,
    and backwards only the carry of each is kept."""
    if levels == 0:
        return tried
    inner = _repeated(tried, levels - 1)

    def needed(carry, _):
        return jax.lax.cond(carry[1] < 1.0, inner, lambda carry: carry, carry), None

    return jax.checkpoint(lambda carry: jax.lax.scan(needed, carry, None, length=WIDTH)[0])


def _pair(rate, x, u0, u1, h, p, varying, pattern) -> tuple[tuple[Any, ...], Sequence[Any], Sequence[Any], Sequence[Any]]:
    """The states after a step (eq. 1), the estimated error of each, whether its second stage changed much of its way, and its mean
    rate."""
    n = len(x)
    f, jacobian = jacobian_of(rate, x, u0, p, pattern)
    z = [[times(h, a) for a in row] for row in jacobian]
    d = drift_of(rate, x, u0, u1, p)[1] if varying else (0.0,) * n
    phi = (_functions, _functions_of_one, _functions_of_two)[n if n <= 2 else 0](z)
    v = phi.first(f, d)
    first = tuple(a + h * b for a, b in zip(x, v, strict=True))
    after = rate(first, u1, p)
    rest = [a - b - plus(dot(row, v), c) for a, b, c, row in zip(after, f, d, z, strict=True)]
    second, linear = phi.second(rest), phi.error([plus(a, b) for a, b in zip(f, d, strict=True)])
    later = tuple(a + h * b for a, b in zip(first, second, strict=True))
    way = [plus(a, b) for a, b in zip(v, second, strict=True)]
    errors = [jnp.abs(h) * (jnp.abs(a) + jnp.abs(b)) for a, b in zip(second, linear, strict=True)]
    return later, errors, [jnp.abs(a) > BENT * jnp.abs(b) for a, b in zip(second, v, strict=True)], way


class _Functions(NamedTuple):
    """What a step needs of Z: phi1(Z) f + phi2(Z) d, 2 phi3(Z) y, and the error of what stands for exp(Z), by (f + d)."""

    first: Callable[[Sequence[Any], Sequence[Any]], list[Any]]
    second: Callable[[Sequence[Any]], list[Any]]
    error: Callable[[Sequence[Any]], list[Any]]


def _functions(z) -> _Functions:
    """Rational ones, of any number of states."""
    n = len(z)
    columns = [[row[j] for row in z] for j in range(n)]
    square = [[dot(row, column) for column in columns] for row in z]
    solve = factored(
        [
            [plus(1.0 if i == j else 0.0, plus(times(-2.0 / 3.0, z[i][j]), times(1.0 / 6.0, square[i][j]))) for j in range(n)]
            for i in range(n)
        ]
    )

    def first(f, d):
        turned = [dot(row, [plus(a, b) for a, b in zip(f, d, strict=True)]) for row in z]
        return solve([plus(plus(a, times(0.5, b)), times(-1.0 / 6.0, c)) for a, b, c in zip(f, d, turned, strict=True)])

    def error(moved):
        turned = [dot(row, moved) for row in z]
        return [b / 72.0 for b in solve([dot(row, turned) for row in z])]

    return _Functions(first, lambda y: solve([a / 3.0 - times(5.0 / 36.0, dot(row, y)) for a, row in zip(y, z, strict=True)]), error)


def _functions_of_one(z) -> _Functions:
    """Of one state: the exponential ones, but for large growth."""
    value = jnp.asarray(z[0][0], dtype=float)
    holds = value < STEEPEST
    exact = _phi(jnp.where(holds, value, -1.0))
    rational = _functions(z)

    def chosen(k, y, otherwise):
        return [jnp.where(holds, times(exact[k], a), b) for a, b in zip(y, otherwise, strict=True)]

    def first(f, d):
        own = [plus(a, b) for a, b in zip(chosen(0, f, f), chosen(1, d, d), strict=True)]
        return [jnp.where(holds, a, b) for a, b in zip(own, rational.first(f, d), strict=True)]

    return _Functions(
        first,
        lambda y: chosen(2, [2.0 * a for a in y], rational.second(y)),
        lambda moved: [jnp.where(holds, 0.0, b) for b in rational.error(moved)],
    )


def _functions_of_two(z) -> _Functions:
    """Of two states, as c I + g Z each: by the divided difference of real eigenvalues, by the imaginary part of complex ones;
    rational ones where both are close together, or both small."""
    half = 0.5 * jnp.asarray(plus(z[0][0], z[1][1]), dtype=float)
    det = jnp.asarray(plus(times(z[0][0], z[1][1]), times(-1.0, times(z[0][1], z[1][0]))), dtype=float)
    # (trace/2)^2 - det without its cancellation
    square = (0.5 * plus(z[0][0], times(-1.0, z[1][1]))) ** 2 + jnp.asarray(times(z[0][1], z[1][0]), dtype=float)
    turning, size = square < 0.0, jnp.abs(half)
    way = jnp.sqrt(jnp.maximum(jnp.abs(square), APART**2))
    holds = (jnp.abs(square) > APART**2) & (size + way > NEAR) & (half + jnp.where(turning, 0.0, way) < STEEPEST)
    exact = _exponential(jnp.where(holds, half, -1.0), way, turning)
    found = [jnp.where(holds, a, b) for a, b in zip(exact, _rational(half, det), strict=True)]

    def of(k, y):
        return [plus(times(found[2 * k], a), times(found[2 * k + 1], dot(row, y))) for a, row in zip(y, z, strict=True)]

    return _Functions(
        lambda f, d: [plus(a, b) for a, b in zip(of(0, f), of(1, d), strict=True)], lambda y: of(2, y), lambda moved: of(3, moved)
    )


def _rational(half: Any, det: Any) -> list[Any]:
    """(c, g) of all four: (I - 2/3 Z + Z^2/6)^-1 (c' I + g' Z) with Z^2 = trace Z - det I."""
    trace = 2.0 * half
    a, b = 1.0 - det / 6.0, trace / 6.0 - 2.0 / 3.0
    inverse = 1.0 / (a * a + b * (trace - 2.0 / 3.0 * det))  # a^2 + a b trace + b^2 det, without the terms that cancel
    a, b = a * inverse, b * inverse
    found = [
        (c * (a + b * trace) + g * b * det, g * a - c * b) for c, g in ((1.0, -1.0 / 6.0), (0.5, -1.0 / 6.0), (1.0 / 3.0, -5.0 / 36.0))
    ]
    return [v for pair in found for v in pair] + [-a * det / 72.0, (b * det + a * trace) / 72.0]


def _exponential(half: Any, way: Any, turning: Any) -> list[Any]:
    """(c, g) of all four, for the eigenvalues half +- way, or half +- i way where it is `turning`; the last is no error."""
    signed = jnp.where(half < 0.0, -way, way)
    far = jnp.where(turning, half, half + signed)
    grown = jnp.exp(far)
    real, imaginary = grown * jnp.cos(way), grown * jnp.sin(way)
    small, once = _phi(half - signed), _recurred(grown, far)
    inverse, per_way, found = 1.0 / (half * half + way * way), 1.0 / way, []
    for k, (constant, share) in enumerate(((1.0, 1.0), (1.0, 1.0), (0.5, 2.0))):
        a, b = real - constant, imaginary
        real, imaginary = (a * half + b * way) * inverse, (b * half - a * way) * inverse
        by_z = jnp.where(turning, imaginary * per_way, (once[k] - small[k]) * jnp.where(half < 0.0, -0.5, 0.5) * per_way)
        own = jnp.where(turning, real, 0.5 * (once[k] + small[k])) - half * by_z
        found += [share * own, share * by_z]
    return [*found, 0.0, 0.0]


def _phi(value: Any) -> tuple[Any, Any, Any]:
    """phi_1, phi_2, phi_3 of a number: (exp(z) - 1)/z, and phi_(k+1) = (phi_k - 1/k!)/z; by their series where that cancels."""
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
