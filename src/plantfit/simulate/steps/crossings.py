"""Where something falls through zero within a step, and how that place moves with all that the step depends on.

The place is solved for with constants; its derivatives follow from the residue there by the implicit function theorem. The states on
the way are those of the stepper itself, so that a step to the place ends on the surface.
"""

from collections.abc import Callable
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.vector import Scalars

import jax
import jax.numpy as jnp

GUESSES = 3  # on a cubic, cheap
CORRECTIONS = 10  # with the stepper itself, at most; one or two are usual
SETTLED = 1e-8  # of a step: what the next correction may be, for one to be the last
SETTLED_NEAR = 1e-11  # the same where NEAR tells whether a crossing has been
NEAR = 1e-9  # of a step's travel: the start of a step counts as on the surface


Function = Callable[[Scalars, Scalars, Scalars], Any]


def crossing(
    step: Callable[..., Scalars], rate: Function, g: Function, x: Scalars, u0: Scalars, u1: Scalars, h: Any, p: Scalars, varying: bool,
    near: Any = None, *, by_time: bool = False,
) -> tuple[Any, Any]:  # fmt: skip
    """Whether g falls through zero within the step, and at which share of it (differentiable; 1 where not).

    With `near`, a share of the step, a start that near to the surface has passed it and an end that near to it passes it, so that
    rounding lets no crossing happen twice or never.
    """
    fx, f0, f1, fh, fp = fixed = jax.lax.stop_gradient((x, u0, u1, h, p))
    moves = change(f0, f1, varying)

    def moved(share, x, u0, u1, h, p):
        u = between(u0, u1, share, varying, by_time)
        return step(rate, x, u0, u, share * h, p, varying), u

    def along(share, *given):
        return g(*moved(share, *given), given[-1])

    g0, travel0 = slope(g, rate, fx, f0, moves, fh, fp)
    g1, travel1 = slope(g, rate, step(rate, *fixed, varying), f1 if varying else f0, moves, fh, fp)
    # a start on the surface, moving off it, is a root that must not be found again
    at_start = jnp.abs(g0) <= (NEAR if near is None else near) * jnp.abs(travel0)
    on_surface = at_start & (travel0 > 0.0)
    crossed = ((g0 > 0.0) | on_surface) & (g1 <= 0.0) & ((g1 < 0.0) | (travel1 < 0.0))
    if near is not None:
        at_end = (g0 > 0.0) & (g1 > 0.0) & (g1 <= near * jnp.abs(travel1)) & (travel1 < 0.0)
        crossed = (crossed | at_end) & ~(at_start & (travel0 < 0.0)) & (fh != 0.0)

    def unsettled(search):
        tries, _, _, _, _, next_one = search
        return (tries < CORRECTIONS) & (next_one > (SETTLED if near is None else SETTLED_NEAR))

    def corrected(search):
        tries, low, share, high, last, _ = search
        value, climb = slope(g, rate, *moved(share, *fixed), moves, fh, fp)
        low, high = jnp.where(value > 0.0, share, low), jnp.where(value > 0.0, high, share)
        newton = share - value / jnp.where(climb == 0.0, -1.0, climb)
        inside = (newton >= low - NEAR) & (newton <= high + NEAR)
        better = jnp.where(inside, jnp.clip(newton, low, high), 0.5 * (low + high))
        correction = jnp.abs(better - share)
        # they shrink at least at the pace that the slope by rates is off the slope of steps
        pace = jnp.where(tries == 0, 0.1, correction / jnp.where(last > 0.0, last, 1.0))
        return tries + 1, low, better, high, correction, correction * pace

    def located(x, u0, u1, h, p):
        share = _root_of_cubic(g0, travel0, g1, travel1, on_surface)
        one = jnp.ones_like(share)
        share = jax.lax.while_loop(unsettled, corrected, (0, jnp.zeros_like(share), share, one, one, one))[2]
        share = jax.lax.stop_gradient(jnp.where(crossed, share, 1.0))

        climb = jax.jvp(lambda s: along(s, *fixed), (share,), (one,))[1]
        return _root(share, along(share, x, u0, u1, h, p), jnp.where(crossed & (climb != 0.0), climb, -1.0))

    share = jax.lax.cond(crossed, located, lambda *_: jnp.ones_like(g0), x, u0, u1, h, p)
    return crossed, share


def slope(g: Function, rate: Function, x: Scalars, u: Scalars, moves: Scalars, h: Any, p: Scalars) -> tuple[Any, Any]:
    """g, and its change over a step of length h in which the inputs change by `moves`, as fast as at x."""
    return jax.jvp(lambda x, u: g(x, u, p), (x, u), (tuple(h * f for f in rate(x, u, p)), moves))


def change(u0: Scalars, u1: Scalars, varying: bool) -> Scalars:
    """What the inputs change by."""
    return tuple(b - a for a, b in zip(u0, u1, strict=True)) if varying else tuple(jnp.zeros_like(a) for a in u0)


def between(u0: Scalars, u1: Scalars, share: Any, varying: bool, by_time: bool = False) -> Scalars:
    """The inputs at a share of the step; `by_time` has the time at its end to the last bit, so that no moment is seen twice or never."""
    if not varying:
        return u0
    u = tuple(a + share * (b - a) for a, b in zip(u0, u1, strict=True))
    if not by_time:
        return u
    rounding = jax.lax.stop_gradient(jnp.where(share == 1.0, u1[-1] - u[-1], 0.0))
    return (*u[:-1], u[-1] + rounding)


@jax.custom_jvp
def _root(share, residue, climb):
    """The share where the residue, which climbs so steeply by it, is zero: it moves against the residue."""
    return share


@_root.defjvp
def _(primals, tangents):
    share, _, climb = primals
    return share, -tangents[1] / climb


def _root_of_cubic(g0, d0, g1, d1, on_surface):
    """Where the Hermite cubic through values g and slopes d at 0 and 1 falls through zero, about; `on_surface`: not the root at 0."""
    b, c = 3.0 * (g1 - g0) - 2.0 * d0 - d1, 2.0 * (g0 - g1) + d0 + d1
    first, *others = (jnp.where(on_surface, low, high) for low, high in ((d0, g0), (b, d0), (c, b), (0.0, c)))  # a root at 0 divided out
    second, third, fourth = others

    def better(_, s):
        value = first + s * (second + s * (third + s * fourth))
        climb = second + s * (2.0 * third + s * (3.0 * fourth))
        return jnp.clip(s - value / jnp.where(climb == 0.0, -1.0, climb), 0.0, 1.0)

    falls = first - g1
    return jax.lax.fori_loop(0, GUESSES, better, jnp.clip(first / jnp.where(falls > 0.0, falls, 1.0), 0.0, 1.0))
