"""Where something falls through zero within a step, and how that place moves with all that the step depends on.

The place is solved for with constants; its derivatives follow from the residue there by the implicit function theorem.
The states on the way are those of the stepper itself, so that a step to the place ends on the surface.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.vector import Scalars

import jax
import jax.numpy as jnp
from jax.ad_checkpoint import checkpoint_name

GUESSES = 2  # on a cubic, cheap
PLACES = 12  # that are tried with the stepper itself, at most; two are usual
SETTLED = 1e-8  # of a step: what a correction may be, for it to be the last
SETTLED_NEAR = 1e-9  # the same where NEAR tells whether a crossing has been
BENT = 0.1  # of a correction: what the bend of g may change in it
LEFT = 1e-15  # of the way to a crossing: what the last correction may leave, as far as the slopes of g tell it
NEAR = 1e-9  # of a step's travel: the start of a step counts as on the surface

KEPT = "where something happens"  # the name of what `kept` marks

Function = Callable[[Scalars, Scalars, Scalars], Any]


@dataclass(frozen=True, eq=False)
class Surface:
    """What may fall through zero within a step: `g(x, u, p, side)`, whatever `side` is for it.

    `step(x, u0, u1, h, p)` moves the states, `values` does so without derivatives; their rates are `rate(x, u, p)`. A
    crossing is found when a correction of its share of the step is at most `settled`; `by_time` as in `between`.
    """

    step: Callable[..., Scalars]
    values: Callable[..., Scalars]
    rate: Callable[..., Scalars]
    g: Callable[..., Any]
    varying: bool
    settled: float = SETTLED
    by_time: bool = False

    def at(self, share: Any, u0: Scalars, u1: Scalars) -> Scalars:
        """The inputs at a share of the step."""
        return between(u0, u1, share, self.varying, self.by_time)

    def slope(self, x: Scalars, u: Scalars, moves: Scalars, h: Any, p: Any, side: Any) -> tuple[Any, Any]:
        """As the function `slope`."""
        return slope(lambda x, u, p: self.g(x, u, p, side), self.rate, x, u, moves, h, p)

    def course(self, x: Scalars, u: Scalars, moves: Scalars, h: Any, p: Any, side: Any) -> tuple[Scalars, Scalars, Any]:
        """What the states move by in a step as fast as at x, what that changes by, and g with the same of it."""

        def motion(x, u):
            return tuple(h * f for f in self.rate(x, u, p))

        def moving(x, u):
            along = motion(x, u)
            return along, jax.jvp(lambda x, u: self.g(x, u, p, side), (x, u), (along, moves))

        (along, (value, climb)), (twice, (_, bend)) = jax.jvp(moving, (x, u), (motion(x, u), moves))
        return along, twice, (value, climb, bend)


class Fall(NamedTuple):
    """Whether g falls through zero within a step, and g and its travel, as fast as there, at both ends; constants."""

    crossed: Any
    on_surface: Any
    ends: tuple[Any, Any, Any, Any]


def fall(
    surface: Surface,
    x: Scalars,
    end: Scalars,
    u0: Scalars,
    u1: Scalars,
    h: Any,
    p: Any,
    side: Any = None,
    whole: Any = None,
) -> Fall:
    """Whether g falls through zero within the step from x to `end`.

    With `whole`, the length of the step of which this is the rest, a start that is NEAR of that to the surface has
    passed it and an end that near to it passes it, so that rounding lets no crossing happen twice or never.
    """
    x, end, u0, u1, h, p = jax.lax.stop_gradient((x, end, u0, u1, h, p))
    moves = change(u0, u1, surface.varying)
    g0, travel0 = surface.slope(x, u0, moves, h, p, side)
    g1, travel1 = surface.slope(end, u1 if surface.varying else u0, moves, h, p, side)

    def near(g, travel):
        return jnp.abs(g) <= NEAR * jnp.abs(travel) if whole is None else close(g, travel, h, whole)

    # a start on the surface, moving off it, is a root that must not be found again
    at_start = near(g0, travel0)
    on_surface = at_start & (travel0 > 0.0)
    crossed = ((g0 > 0.0) | on_surface) & (g1 <= 0.0) & ((g1 < 0.0) | (travel1 < 0.0))
    if whole is not None:
        at_end = (g0 > 0.0) & (g1 > 0.0) & near(g1, travel1) & (travel1 < 0.0)
        crossed = (crossed | at_end) & ~(at_start & (travel0 < 0.0)) & (h != 0.0)
    return Fall(crossed, on_surface, (g0, travel0, g1, travel1))


Place = tuple[Any, Scalars]
"""A share of a step, and the states there."""


def searched(surface: Surface, given: tuple[Any, ...], found: Fall) -> Place:
    """Where in a step g falls through zero, without derivatives; `given` = (x, u0, u1, h, p, side)."""
    given = jax.lax.stop_gradient(given)
    _, u0, u1, h, p, side = given
    moves = change(u0, u1, surface.varying)

    def corrected(search):
        tries, low, share, high, _, _ = search
        u = surface.at(share, u0, u1)
        x = surface.values(given[0], u0, u, share * h, p)
        motion, twice, (value, climb, bend) = surface.course(x, u, moves, h, p, side)
        low, high = jnp.where(value > 0.0, share, low), jnp.where(value > 0.0, high, share)
        # all but the division and what follows from it is known before it is done
        back, on = low - share, high - share
        inverse = -1.0 / jnp.where(climb == 0.0, -1.0, climb)
        newton = value * inverse
        bent = 0.5 * bend * inverse * newton  # Halley's share of Newton's step
        newton = jnp.where(jnp.abs(bent) < BENT, newton + bent * newton, newton)
        inside = (newton >= back - NEAR) & (newton <= on + NEAR)  # NaN is not
        clipped = jnp.where(newton < back, back, jnp.where(newton > on, on, newton))
        more = jnp.where(inside, clipped, 0.5 * (back + on))
        better = share + more
        # what is left is of third order; near the start of a stiff step each order is larger by 1 / share
        bends, way = more * (steepest + jnp.abs(climb)), share * jnp.abs(climb)
        little = bends * bends * jnp.abs(more) <= LEFT * way * way * share
        settled = (tries + 1 >= PLACES) | little | ~(jnp.abs(more) > surface.settled)
        # a correction so small takes the states along as they move there; a larger one has them made anew
        x = tuple(a + more * (b + 0.5 * more * c) for a, b, c in zip(x, motion, twice, strict=True))
        return tries + 1, low, better, high, settled, x

    share = _root_of_cubic(*found.ends, found.on_surface)
    steepest = jnp.maximum(jnp.abs(found.ends[1]), jnp.abs(found.ends[3]))
    states = tuple(jnp.asarray(v, dtype=float) for v in given[0])
    begin = 0, jnp.zeros_like(share), share, jnp.ones_like(share), jnp.zeros((), dtype=bool), states
    _, _, share, _, _, states = jax.lax.while_loop(lambda search: ~search[4], corrected, begin)
    return share, states


def kept(place: Place) -> Place:
    """The same, which a segment that is followed once more for its derivatives does not search again."""
    return jax.tree.map(lambda a: checkpoint_name(a, KEPT), place)


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def arrived(surface: Surface, given: tuple[Any, ...], place: Place) -> Place:
    """The place that was `searched`, with the derivatives that it has of `given`."""
    return place


@arrived.defjvp
def _(surface, primals, tangents):
    given, (share, x) = primals

    def at(share, given):
        x, u0, u1, h, p, side = given
        u = surface.at(share, u0, u1)
        x = surface.step(x, u0, u, share * h, p)
        return x, surface.g(x, u, p, side)

    along, climb = jax.jvp(lambda share: at(share, given), (share,), (jnp.ones_like(share),))[1]
    # only what is linear may see the tangents, so that loops inside of a step can be transposed
    moved, residue = jax.linearize(lambda given: at(share, given), given)[1](tangents[0])
    # the share moves against the residue
    by = -residue / jnp.where(climb == 0.0, -1.0, climb)
    return (share, x), (by, tuple(m + a * by for m, a in zip(moved, along, strict=True)))


def slope(
    g: Function, rate: Callable[..., Scalars], x: Scalars, u: Scalars, moves: Scalars, h: Any, p: Any
) -> tuple[Any, Any]:
    """g, and its change over a step of length h in which the inputs change by `moves`, as fast as at x."""
    return jax.jvp(lambda x, u: g(x, u, p), (x, u), (tuple(h * f for f in rate(x, u, p)), moves))


def close(g: Any, travel: Any, h: Any, whole: Any) -> Any:
    """Whether g is zero but for NEAR of what it moves by in a step of length `whole`, as `travel` is in one of h."""
    return jnp.abs(g) * h <= NEAR * whole * jnp.abs(travel)


def change(u0: Scalars, u1: Scalars, varying: bool) -> Scalars:
    """What the inputs change by."""
    return tuple(b - a for a, b in zip(u0, u1, strict=True)) if varying else tuple(jnp.zeros_like(a) for a in u0)


def between(u0: Scalars, u1: Scalars, share: Any, varying: bool, by_time: bool = False) -> Scalars:
    """The inputs at a share of the step; `by_time` has the time at its end to the last bit, so that no moment is
    seen twice or never."""
    if not varying:
        return u0
    u = tuple(a + share * (b - a) for a, b in zip(u0, u1, strict=True))
    if not by_time:
        return u
    rounding = jax.lax.stop_gradient(jnp.where(share == 1.0, u1[-1] - u[-1], 0.0))
    return (*u[:-1], u[-1] + rounding)


def _root_of_cubic(g0, d0, g1, d1, on_surface):
    """Where the Hermite cubic through values g and slopes d at 0 and 1 falls through zero, about; `on_surface`: not
    the root at 0."""
    b, c = 3.0 * (g1 - g0) - 2.0 * d0 - d1, 2.0 * (g0 - g1) + d0 + d1
    # a root at 0 divided out
    first, *others = (jnp.where(on_surface, low, high) for low, high in ((d0, g0), (b, d0), (c, b), (0.0, c)))
    second, third, fourth = others

    falls = first - g1
    # for almost all a slope is near that of the chord: its inverse is made of the chord's, without a division
    chord = 1.0 / jnp.where(falls > 0.0, falls, 1.0)
    share = first * chord
    for _ in range(GUESSES):
        climb = second + share * (2.0 * third + share * (3.0 * fourth))
        value = first + share * (second + share * (third + share * fourth))
        share = share + value * (chord * (2.0 + climb * chord))
    return jnp.clip(share, 0.0, 1.0)
