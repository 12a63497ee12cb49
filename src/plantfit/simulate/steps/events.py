"""Events inside a step: crossings located and stepped to exactly, dry friction that sticks, backlash.

Everything here wraps a stepper into a stepper. The time of a crossing is solved for with constants, then corrected once
with the true derivatives, which is the implicit function theorem: what follows the event then knows how its time
moves (the saltation matrix; R. I. Leine, H. Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems,
Springer 2004, sec. 7.2).

Most steps hold no event. `Switching` takes a step as if nothing happened and looks at both its ends; only where something may have
happened is the step taken again, cut at what happens. Native code skips the second where no lane of a vector needs it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.parts.switching import Backlash, Event, Friction
from plantfit.simulate.steps.crossings import NEAR, Function, between, change, crossing, slope
from plantfit.simulate.steps.times import fixed, moment, straight, timed
from plantfit.simulate.steps.vector import Scalars, VectorModel

import jax
import jax.numpy as jnp

Stepper = Callable[..., Scalars]

AROUND = 1e-4  # of a step's travel: so near to the surface at an end of a step it is looked at closely, far more than NEAR


@dataclass(frozen=True, eq=False)
class Switching:
    """A stepper in which something may happen: `whole` follows what does, however little.

    `quiet` takes the same and gives the step as if nothing happened in it, which is right where nothing did, and whether something may.
    """

    whole: Stepper
    quiet: Callable[..., tuple[Scalars, Any]]

    def __call__(self, rate, x, u0, u1, h, p, varying, pattern=None) -> Scalars:
        given = x, u0, u1, h, p
        may = self.quiet(rate, *jax.lax.stop_gradient(given), varying, pattern)[1]

        def whole(*given):
            return self.whole(rate, *given, varying, pattern)

        def plain(*given):
            return self.quiet(rate, *given, varying, pattern)[0]

        return _either(may, whole, plain, *given)


def quiet_step(step: Stepper) -> Callable[..., tuple[Scalars, Any]]:
    """The step as if nothing happened in it, and whether something may, of any stepper."""
    if isinstance(step, Switching):
        return step.quiet
    return lambda *given: (step(*given), jnp.zeros((), dtype=bool))


@dataclass(frozen=True, eq=False)
class Trigger:
    """An `Event` on tuples of scalars; `sign` +1 falling, -1 rising, 0 both.

    `timed` events depend on time alone, `straight` ones among these are straight lines in time, `fixed` ones depend on no
    parameter (see `times`).
    """

    when: Function
    then: Function
    sign: int
    timed: bool = False
    straight: bool = False
    fixed: bool = False


@dataclass(frozen=True, eq=False)
class DryFriction:
    """A `Friction` on tuples of scalars; `effect` gives the rate of every state per unit of force."""

    velocity: int
    sliding: Function
    breakaway: Function
    effect: Function


@dataclass(frozen=True, eq=False)
class Play:
    """A `Backlash` on tuples of scalars."""

    state: int
    drive: Function
    gap: Function


def bind_event(event: Event, vector: VectorModel) -> Trigger:
    """The declared event on tuples in the order of `vector`; raises ModelError for an unknown direction."""
    signs = {"falling": 1, "rising": -1, "both": 0}
    if event.direction not in signs:
        raise ModelError(f"Event {event.name!r} has direction {event.direction!r}; use one of {list(signs)}.")
    what = f"event {event.name!r}"
    when = _scalar(event.when, vector)
    by_time = timed(when, vector)
    line = by_time and straight(when, vector)
    then = _changed(event.then, vector, what, lambda x: x)
    return Trigger(when, then, signs[event.direction], by_time, line, by_time and fixed(when, vector))


def bind_friction(friction: Friction, vector: VectorModel) -> DryFriction:
    """The declared friction on tuples in the order of `vector`; raises ModelError for an unknown velocity."""
    place = _place(friction.velocity, vector, "friction")
    effect = _changed(friction.effect, vector, "the effect of friction", lambda x: tuple(jnp.zeros_like(v) for v in x), friction.velocity)
    return DryFriction(place, _scalar(friction.sliding, vector), _scalar(friction.breakaway, vector), effect)


def bind_backlash(backlash: Backlash, vector: VectorModel) -> Play:
    """The declared backlash on tuples in the order of `vector`; raises ModelError for an unknown state."""
    return Play(_place(backlash.state, vector, "backlash"), _scalar(backlash.drive, vector), _scalar(backlash.gap, vector))


def with_events(step: Stepper, events: Sequence[Trigger], most: int = 2) -> Stepper:
    """A stepper that ends a step at the first crossing, resets there and goes on, up to `most` times in one step.

    The state is NaN when yet another crossing follows, so take shorter steps or raise `most`; events that pile up
    without end (a ball coming to rest) must be ended by the model: let `then` stop what has become slow. A pair of
    crossings of one surface within a step is not seen. Events at a straight line in time are followed however many there are,
    exactly, and those that meet in one moment all happen, in their order.
    """
    by_time = any(e.timed for e in events)
    # steps end at moments that are known beforehand, so that these meet in one
    most = most + sum(e.straight and not e.fixed for e in events) + any(e.straight and e.fixed for e in events)

    def quiet(rate, x, u0, u1, h, p, varying, pattern=None):
        end, may = quiet_step(step)(rate, x, u0, u1, h, p, varying, pattern)
        for e in events:
            if e.straight:
                may = may | _moment(e, x, u0, u1, h, p).passed
                continue
            falling = _falling(e, rate, x, u0, u1, h, p, NEAR)
            g0, travel = slope(falling, rate, x, u0, change(u0, u1, varying), h, p)
            g1 = falling(x if e.timed else end, u1 if varying else u0, p)
            room = AROUND * (jnp.abs(g1 - g0) + jnp.abs(travel))
            may = may | ((g0 > -room) & (g1 < room))
        return end, may

    def stepper(rate, x, u0, u1, h, p, varying, pattern=None):
        inner, whole = partial(step, pattern=pattern), jax.lax.stop_gradient(h)

        def found_crossing(e, x, u0, h):
            near = NEAR * whole / jax.lax.stop_gradient(jnp.where(h == 0.0, 1.0, h))  # as a share of what is left of the step
            falling = _falling(e, rate, x, u0, u1, h, p, near)
            # the states need not be moved to see what depends on time alone
            moved = (lambda rate, x, *_: x) if e.timed else inner
            return crossing(moved, rate, falling, x, u0, u1, h, p, varying, near, by_time=by_time)

        def segment(carry, last):
            x, u0, h = carry
            moments = [_moment(e, x, u0, u1, h, p) if e.straight else None for e in events]
            found = [found_crossing(e, x, u0, h) if m is None else (m.passed, m.share) for e, m in zip(events, moments, strict=True)]
            first, chosen = jnp.full_like(h, 2.0), jnp.full_like(h, -1.0)
            for k, (crossed, share) in enumerate(found):
                sooner = crossed & (share < first)
                first, chosen = jnp.where(sooner, share, first), jnp.where(sooner, k, chosen)
            happens = first <= 1.0
            share = jnp.where(happens & ~last, first, 1.0)
            at = between(u0, u1, share, varying, by_time)
            # the moment itself, so that what comes after begins behind it
            now = at[-1]
            for k, m in enumerate(moments):
                now = now if m is None else jnp.where((chosen == k) & ~last, m.time, now)
            at = (*at[:-1], now)
            x = _moved(happens & ~last, inner, rate, x, u0, at, u1, share * h, h, p, varying)
            for k, (event, m) in enumerate(zip(events, moments, strict=True)):
                happening = chosen == k if m is None else m.passed & happens & (m.time == now)
                x = _where(happening & ~last, event.then(x, at, p), x)
            x = tuple(jnp.where(happens & last, jnp.nan, v) for v in x)
            return (x, at, (1.0 - share) * h), None

        return _segments(segment, most, x, u0, h)[0]

    return Switching(stepper, quiet) if events else step


def with_friction(step: Stepper, friction: DryFriction, most: int = 2) -> Stepper:
    """A stepper for rates without dry friction that adds it: the velocity is exactly 0 while stuck.

    The mass sticks when its velocity meets 0 and the force needed to hold it is at most the breakaway force (never
    taken below the sliding one), and breaks away when more is needed: D. Karnopp, J. Dyn. Sys. Meas. Control 107
    (1985) 100, with exact times instead of a band. Up to `most` changes in one step; after these a velocity that
    meets 0 is held until the step ends. Wrap once per friction when several do not act on each other's velocity.
    `pattern` is not used: friction adds entries to the Jacobian.
    """
    i = friction.velocity

    def holding(rate, x, u, p):
        """The force that keeps the velocity."""
        return -rate(x, u, p)[i] / friction.effect(x, u, p)[i]

    def breakaway(x, u, p):
        return jnp.maximum(friction.breakaway(x, u, p), friction.sliding(x, u, p))

    def ruled(rate, x, u0, p, leaving):
        """Whether the mass sticks, else which way it slides; the rate with friction; what falls through zero when that ends.

        `leaving` is +-1 where the mass has just broken away.
        """
        need = holding(rate, x, u0, p)
        at_rest = (x[i] == 0.0) & (leaving == 0.0)
        stuck = at_rest & (jnp.abs(need) <= breakaway(x, u0, p))
        way = jax.lax.stop_gradient(jnp.where(leaving != 0.0, leaving, jnp.where(at_rest, -jnp.sign(need), jnp.sign(x[i]))))

        def rubbed(x, u, p):
            free, effect = rate(x, u, p), friction.effect(x, u, p)
            force = jnp.where(stuck, -free[i] / effect[i], -way * friction.sliding(x, u, p))
            rates = [f + e * force for f, e in zip(free, effect, strict=True)]
            rates[i] = jnp.where(stuck, 0.0, rates[i])
            return tuple(rates)

        def reserve(x, u, p):
            return jnp.where(stuck, breakaway(x, u, p) - jnp.abs(holding(rate, x, u, p)), way * x[i])

        return stuck, way, rubbed, reserve

    def at_zero(where, x):
        return tuple(jnp.where(where, 0.0, v) if k == i else v for k, v in enumerate(x))

    def quiet(rate, x, u0, u1, h, p, varying, pattern=None):
        stuck, way, rubbed, reserve = ruled(rate, x, u0, p, 0.0)
        end, may = quiet_step(step)(rubbed, x, u0, u1, h, p, varying)
        at_end = end, u1 if varying else u0, p
        # what holds a mass is not asked of those that slide
        left = jax.lax.cond(stuck, reserve, lambda x, u, p: way * x[i], *at_end)
        return at_zero(stuck, end), may | (left <= 0.0)

    def stepper(rate, x, u0, u1, h, p, varying, pattern=None):
        def segment(carry, last):
            x, u0, h, leaving = carry
            stuck, _, rubbed, reserve = ruled(rate, x, u0, p, leaving)
            crossed, share = crossing(step, rubbed, reserve, x, u0, u1, h, p, varying)
            share = jnp.where(last, 1.0, share)
            at = between(u0, u1, share, varying)
            x = at_zero(stuck | crossed, _moved(crossed & ~last, step, rubbed, x, u0, at, u1, share * h, h, p, varying))
            leaving = jnp.where(stuck & crossed, -jnp.sign(holding(rate, x, at, p)), 0.0)
            return (x, at, (1.0 - share) * h, leaving), None

        return _segments(segment, most, x, u0, h, jnp.zeros(()))[0]

    return Switching(stepper, quiet)


def with_backlash(step: Stepper, play: Play) -> Stepper:
    """A stepper in which the state of `play` follows its drive with a gap, exactly while the drive moves one way.

    The play operator y1 = min(max(y0, drive - gap), drive + gap): M. Brokate, J. Sprekels, Hysteresis and Phase
    Transitions, Springer 1996, sec. 2.3. The rates see the moving y inside the step. Take steps shorter than a reversal.
    `pattern` is not used: the play adds entries to the Jacobian.
    """

    def stepper(rate, x, u0, u1, h, p, varying, pattern=None):
        begin = x[play.state]

        def followed(x, u, p):
            drive, gap = play.drive(x, u, p), play.gap(x, u, p)
            y = jnp.minimum(jnp.maximum(begin, drive - gap), drive + gap)
            return tuple(y if k == play.state else v for k, v in enumerate(x))

        def driven(x, u, p):
            rates = rate(followed(x, u, p), u, p)
            return tuple(jnp.zeros_like(r) if k == play.state else r for k, r in enumerate(rates))

        return followed(step(driven, x, u0, u1, h, p, varying), u1 if varying else u0, p)

    return stepper


def _segments(segment, most, x, u0, h, *more):
    """The carry after `most` + 1 segments of a step, one program for all."""
    carry = jax.tree.map(lambda v: jnp.asarray(v, dtype=float), (tuple(x), tuple(u0), h, *more))

    def needed(carry, last):
        return jax.lax.cond(carry[2] != 0.0, jax.checkpoint(segment, prevent_cse=False), lambda carry, _: (carry, None), carry, last)

    return jax.lax.scan(needed, carry, jnp.arange(most + 1) == most)[0]


class _Moment(NamedTuple):
    """When a straight line in time passes zero, whether that is within the step, and at which share of it (1 where not)."""

    time: Any
    passed: Any
    share: Any


def _moment(event, x, u0, u1, h, p):
    time, slope = moment(event.when, u0, p, x)
    begin, end = u0[-1], u1[-1]
    turned = slope != 0.0 if event.sign == 0 else -event.sign * slope > 0.0
    passed = turned & (begin < time) & (time <= end) & (h != 0.0)
    share = (time - begin) / jnp.where(passed, end - begin, 1.0)
    return _Moment(time, passed, jnp.where(passed, share, 1.0))


def _falling(event, rate, x, u0, u1, h, p, share):
    """The event's function, turned so that the crossing asked for is a falling one."""
    if event.sign:
        return lambda x, u, p: event.sign * event.when(x, u, p)
    moves = tuple(h * f for f in rate(x, u0, p)), tuple(b - a for a, b in zip(u0, u1, strict=True))
    value, travel = jax.jvp(lambda x, u: event.when(x, u, p), (x, u0), moves)
    near = jnp.abs(value) <= share * jnp.abs(travel)
    sign = jax.lax.stop_gradient(jnp.sign(jnp.where(near, travel, value)))
    return lambda x, u, p: sign * event.when(x, u, p)


def _moved(cut, step, rate, x, u0, at, u1, part, h, p, varying):
    """The states after the `part` of the step that ends at the inputs `at` where that is `cut`, after the whole step elsewhere."""

    def cut_short(x, u0, at, u1, part, h, p):
        return step(rate, x, u0, at, part, p, varying)

    def to_the_end(x, u0, at, u1, part, h, p):
        return step(rate, x, u0, u1, h, p, varying)

    return _either(cut, cut_short, to_the_end, x, u0, at, u1, part, h, p)


def _either(happens, whole, plain, *given):
    """`whole(*given)` where something happens, `plain(*given)` elsewhere; derivatives of `plain` that are NaN stay out of it there."""
    held = partial(jax.tree.map, lambda a: jnp.where(happens, jax.lax.stop_gradient(a), a))
    return jax.lax.cond(happens, whole, lambda *given: plain(*held(given)), *given)


def _where(condition, yes, no):
    return tuple(jnp.where(condition, a, b) for a, b in zip(yes, no, strict=True))


def _named(vector, x, u, p):
    return (
        dict(zip(vector.states, x, strict=True)),
        dict(zip(vector.channels, u, strict=True)),
        dict(zip(vector.parameters, p, strict=True)),
    )


def _scalar(function, vector):
    return lambda x, u, p: jnp.asarray(function(*_named(vector, x, u, p)), dtype=float)


def _changed(function, vector, what, otherwise, needed=None):
    """A function that names some states as one that gives all, the others from `otherwise(x)`."""

    def complete(x, u, p):
        given = function(*_named(vector, x, u, p))
        unknown = [name for name in given if name not in vector.states]
        if unknown or (needed is not None and needed not in given):
            reason = f"names {unknown[0]!r}, which is not one of the states" if unknown else f"leaves out {needed!r} of the states"
            raise ModelError(f"Model {vector.model.name!r}: {what} {reason} {list(vector.states)}; give names of states.")
        return tuple(jnp.asarray(given.get(name, old), dtype=float) for name, old in zip(vector.states, otherwise(x), strict=True))

    return complete


def _place(state, vector, what):
    if state not in vector.states:
        raise ModelError(f"Model {vector.model.name!r}: {what} acts on {state!r}, which is not one of the states {list(vector.states)}.")
    return vector.states.index(state)
