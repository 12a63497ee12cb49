"""Steps as long as their error allows, each candidate with its own: for sharp friction and stiff corners of a box.

One step is the third-order exponential Rosenbrock pair exprb32 (M. Hochbruck, A. Ostermann, J. Schweitzer, SIAM J. Numer. Anal. 47
(2009) 786) with rational functions in place of the exponential ones, all with the denominator of `steppers.exponential`,

    x1 = x + h v                                        (order 2)
    x2 = x1 + 2 h phi3(Z) dN,  dN = f(x1) - f(x) - Z v - d,   2 phi3(Z) = (1 - 5/12 Z)/(3 (1 - 2/3 Z + Z^2/6)),           (1)

and goes on with x2. The error of a step is taken as h |2 phi3(Z) dN|, what the second stage changed, plus that of the rational
exponential on the linear part, h |Z^2 (1 - 2/3 Z + Z^2/6)^-1 (f + d)|/72, each state's as a share of the largest size that the state
has had in this interval: a state that has died away asks for nothing.

A step could be exact enough although the rate turns round in it: friction is then jumped over to and fro, far inside of the tolerance
and without end. Such a step is tried anew with a tenth of its length, which finds where the state sticks.

The sequence of steps follows from the candidate alone, never from those beside it. Derivatives are those of the sequence as it is:
lengths of steps are constant shares of the interval.
"""

from collections.abc import Callable, Sequence
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.steppers import dot, drift_of, factored, jacobian_of, plus, times

import jax
import jax.numpy as jnp

Stepper = Callable[..., tuple[Any, ...]]

TOLERANCE = 0.1  # error of a step as a share of the state, at fineness 1
FINEST = 1000  # 1e-10 of the state
LEVELS, WIDTH = 3, 16  # at most 16^3 trials in an interval
SAFETY, SHORTEST, LONGEST = 0.9, 0.1, 5.0  # of the next step, in lengths of this one
BENT, SEEN = 0.25, 1e-5  # share of a step's way that the second stage changes, and of the allowed error, from which on it is tried anew


def tolerance(fineness: int) -> float:
    """Error of a step as a share of the state; twice the fineness makes steps of order 2 half as long and quarters the error."""
    return TOLERANCE / fineness**3


def adaptive(fineness: int) -> Stepper:
    """A stepper (see `steppers`) that divides the interval it is given as the error of each part asks for.

    States are NaN where an interval takes more than 4096 trials.
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
            later, errors, bent = _pair(rate, x, between(done), u1 if not varying else between(end), length * h, p, varying, pattern)
            size = tuple(jnp.maximum(s, jnp.abs(jax.lax.stop_gradient(b))) for s, b in zip(largest, later, strict=True))
            worst, strained = jnp.zeros(()), False
            for e, s, b in zip(errors, size, bent, strict=True):
                share = jax.lax.stop_gradient(e) / (allowed * jnp.maximum(s, 1e-300))
                strained |= b & (share > SEEN)
                worst = jnp.where((share > worst) | jnp.isnan(share), share, worst)
            lost = ~jnp.isfinite(sum(map(jax.lax.stop_gradient, x)))  # nothing comes after that
            good = ((worst <= 1.0) & ~strained) | lost
            factor = jnp.clip(SAFETY * jnp.maximum(worst, 1e-6) ** (-1.0 / 3.0), SHORTEST, LONGEST)
            factor = jnp.where(jnp.isfinite(worst) & ~strained, factor, SHORTEST)
            return (
                tuple(jnp.where(good, b, a) for a, b in zip(x, later, strict=True)),
                jnp.where(lost, 1.0, jnp.where(good, end, done)),
                length * factor,
                tuple(jnp.where(good, b, a) for a, b in zip(largest, size, strict=True)),
            )

        begin = tuple(jnp.asarray(v, dtype=float) for v in x)
        carry = (begin, jnp.zeros(()), jnp.ones(()), tuple(jnp.abs(jax.lax.stop_gradient(v)) for v in begin))
        x, done, *_ = _repeated(tried, LEVELS)(carry)
        return tuple(jnp.where(done < 1.0, jnp.nan, v) for v in x)

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


def _pair(rate, x, u0, u1, h, p, varying, pattern) -> tuple[tuple[Any, ...], Sequence[Any], Sequence[Any]]:
    """The states after a step (eq. 1), the estimated error of each, and whether its second stage changed much of its way."""
    n = len(x)
    f, jacobian = jacobian_of(rate, x, u0, p, pattern)
    z = [[times(h, a) for a in row] for row in jacobian]
    d = drift_of(rate, x, u0, u1, p)[1] if varying else (0.0,) * n
    columns = [[row[j] for row in z] for j in range(n)]
    square = [[dot(row, column) for column in columns] for row in z]
    solve = factored(
        [
            [plus(1.0 if i == j else 0.0, plus(times(-2.0 / 3.0, z[i][j]), times(1.0 / 6.0, square[i][j]))) for j in range(n)]
            for i in range(n)
        ]
    )
    moved = [plus(a, b) for a, b in zip(f, d, strict=True)]
    turned = [dot(row, moved) for row in z]
    v = solve([plus(plus(a, times(0.5, b)), times(-1.0 / 6.0, c)) for a, b, c in zip(f, d, turned, strict=True)])
    first = tuple(a + h * b for a, b in zip(x, v, strict=True))
    after = rate(first, u1, p)
    rest = [a - b - plus(dot(row, v), c) for a, b, c, row in zip(after, f, d, z, strict=True)]
    second = solve([a / 3.0 - times(5.0 / 36.0, dot(row, rest)) for a, row in zip(rest, z, strict=True)])
    linear = solve([dot(row, turned) for row in z])
    later = tuple(a + h * b for a, b in zip(first, second, strict=True))
    errors = [jnp.abs(h) * (jnp.abs(a) + jnp.abs(b) / 72.0) for a, b in zip(second, linear, strict=True)]
    return later, errors, [jnp.abs(a) > BENT * jnp.abs(b) for a, b in zip(second, v, strict=True)]
