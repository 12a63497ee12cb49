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
from functools import cache, partial
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.parts.switching import Backlash, Event, Friction
from plantfit.simulate.steps.crossings import NEAR, SETTLED_NEAR, Function, Surface, arrived, between, change, fall, slope
from plantfit.simulate.steps.steppers import plus, times
from plantfit.simulate.steps.times import fixed, moment, straight, timed
from plantfit.simulate.steps.vector import Scalars, VectorModel

import jax
import jax.numpy as jnp

Stepper = Callable[..., Scalars]

AROUND = 1e-4  # of a step's travel: so near to the surface at an end of a step it is looked at closely, far more than NEAR


@dataclass(frozen=True, eq=False)
class Switching:
    """A stepper in which something may happen: `whole` follows what does, however little; `values` is the same without derivatives.

    `quiet` takes the same and gives the step as if nothing happened in it, which is right where nothing did, and whether something may.
    """

    values: Stepper
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

    def valued(
        self, rate: Callable[..., Scalars], x: Scalars, u0: Scalars, u1: Scalars, h: Any, p: Any, varying: bool, pattern: Any = None
    ) -> Scalars:
        """The step for where no derivatives are taken: half as much to compile."""
        given = x, u0, u1, h, p
        end, may = self.quiet(rate, *given, varying, pattern)
        return jax.lax.cond(may, lambda given: self.values(rate, *given, varying, pattern), lambda _: end, given)


def values_of(step: Stepper) -> Stepper:
    """A stepper for where no derivatives are taken."""
    return step.valued if isinstance(step, Switching) else step


def quiet_step(step: Stepper) -> Callable[..., tuple[Scalars, Any]]:
    """The step as if nothing happened in it, and whether something may, of any stepper."""
    if isinstance(step, Switching):
        return step.quiet
    return lambda *given: (step(*given), jnp.zeros((), dtype=bool))


class Given(NamedTuple):
    """What a rate is given in place of the parameters `p`: these, which may be `Given` in turn, and what is fixed over a step.

    So rates are functions that close over nothing, and a step with one of them is traced once.
    """

    p: Any
    fixed: Any


def parameters(p: Any) -> Scalars:
    """The model's own parameters."""
    return parameters(p.p) if isinstance(p, Given) else p


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
    """A `Friction` on tuples of scalars; `effect` gives the rate of every state per unit of force, the number 0.0 where it has none."""

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
    effect = _changed(friction.effect, vector, "the effect of friction", lambda x: (0.0,) * len(x), friction.velocity)
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
    if not events:
        return step
    step = _once(step)
    by_time = any(e.timed for e in events)
    # steps end at moments that are known beforehand, so that these meet in one
    most = most + sum(e.straight and not e.fixed for e in events) + any(e.straight and e.fixed for e in events)

    def quiet(rate, x, u0, u1, h, p, varying, pattern=None):
        end, may = quiet_step(step)(rate, x, u0, u1, h, p, varying, pattern)
        return end, may | possible(rate, x, end, u0, u1, h, p, varying, NEAR)

    def possible(rate, x, end, u0, u1, h, p, varying, near):
        """Whether an event may be in the step from x to `end`."""
        may = jnp.zeros((), dtype=bool)
        for e in events:
            if e.straight:
                may = may | _moment(e, x, u0, u1, h, p).passed
                continue
            side, moves = _side(e, rate, x, u0, u1, h, p, near), change(u0, u1, varying)
            g0, travel = slope(partial(_falling(e), side=side), rate, x, u0, moves, h, p)
            g1 = _falling(e)(x if e.timed else end, u1 if varying else u0, p, side)
            room = (AROUND + near) * (jnp.abs(g1 - g0) + jnp.abs(travel))
            may = may | ((g0 > -room) & (g1 < room))
        return may

    def stepper(derived, rate, x, u0, u1, h, p, varying, pattern=None):
        whole = jax.lax.stop_gradient(h)

        def looked_at(x, u0, u1, h, p):
            """A step without derivatives, which may be NaN where it does not count."""
            return values_of(step)(rate, *jax.lax.stop_gradient((x, u0, u1, h, p)), varying, pattern)

        def stepped(x, u0, u1, h, p):
            return step(rate, x, u0, u1, h, p, varying, pattern)

        def surface(e):
            # the states need not be moved to see what depends on time alone
            move, look = (_still, _still) if e.timed else (stepped, looked_at)
            return Surface(move, look, rate, _falling(e), varying, SETTLED_NEAR, by_time)

        def near(h):
            """`NEAR` as a share of what is left of the step."""
            return NEAR * whole / jax.lax.stop_gradient(jnp.where(h == 0.0, 1.0, h))

        def met(e, x, u0, h, end):
            """Whether an event is in the step, at which share of it, and the states there."""
            given = x, u0, u1, h, p, _side(e, rate, x, u0, u1, h, p, near(h))
            found = fall(surface(e), x, end, u0, u1, h, p, given[-1], near(h))
            share, there = jax.lax.cond(
                found.crossed, lambda given: arrived(surface(e), given, found), lambda given: (jnp.ones_like(h), given[0]), given
            )
            return found.crossed, share, there

        def segment(carry, last):
            x, u0, h, end = carry
            moments = [_moment(e, x, u0, u1, h, p) if e.straight else None for e in events]
            found = [met(e, x, u0, h, end) if m is None else (m.passed, m.share, x) for e, m in zip(events, moments, strict=True)]
            first, chosen, there = jnp.full_like(h, 2.0), jnp.full_like(h, -1.0), x
            for k, (crossed, share, arriving) in enumerate(found):
                sooner = crossed & (share < first)
                first, chosen, there = jnp.where(sooner, share, first), jnp.where(sooner, k, chosen), _where(sooner, arriving, there)
            happens = first <= 1.0

            def reset(x, u0, h, _, first, there):
                at = between(u0, u1, first, varying, by_time)
                # the moment itself, so that what comes after begins behind it
                now = at[-1]
                for k, m in enumerate(moments):
                    now = now if m is None else jnp.where(chosen == k, m.time, now)
                at = (*at[:-1], now)
                by_clock = [chosen == k for k, e in enumerate(events) if e.timed]
                if by_clock:
                    here, move = (x, u0, at, first * h, p), stepped if derived else looked_at
                    by = jnp.any(jnp.stack(by_clock))
                    there = jax.lax.cond(by, lambda _, here=here, move=move: move(*here), lambda there: there, there)
                for k, (event, m) in enumerate(zip(events, moments, strict=True)):
                    happening = chosen == k if m is None else m.passed & (m.time == now)
                    there = _where(happening, event.then(there, at, p), there)
                left = (1.0 - first) * h
                given = there, at, u1, left, p
                end = looked_at(*given)
                more = possible(rate, *jax.lax.stop_gradient((there, end, *given[1:])), varying, near(left))
                return there, at, jnp.where(more, left, 0.0), _either(more, lambda *_: end, stepped, *given) if derived else end

            def ended(x, u0, h, end, *_):
                end = stepped(x, u0, u1, h, p) if derived else end
                return x, u0, jnp.zeros_like(h), tuple(jnp.where(happens, jnp.nan, v) for v in end)

            return _either(happens & ~last, reset, ended, x, u0, h, end, first, there)

        return _segments(segment, most, x, u0, h, looked_at(x, u0, u1, h, p))[3]

    return Switching(_traced(partial(stepper, False)), _traced(partial(stepper, True)), _traced(quiet))


def with_friction(step: Stepper, friction: DryFriction, most: int = 2) -> Stepper:
    """A stepper for rates without dry friction that adds it: the velocity is exactly 0 while stuck.

    The mass sticks when its velocity meets 0 and the force needed to hold it is at most the breakaway force (never
    taken below the sliding one), and breaks away when more is needed: D. Karnopp, J. Dyn. Sys. Meas. Control 107
    (1985) 100, with exact times instead of a band. Up to `most` changes in one step; after these a velocity that
    meets 0 is held until the step ends. Wrap once per friction when several do not act on each other's velocity.
    `pattern` is not used: friction adds entries to the Jacobian.
    """
    step, i = _once(step), friction.velocity

    def breakaway(x, u, p):
        """The largest rate of the velocity that friction takes up at rest."""
        p = parameters(p)
        return jnp.maximum(friction.breakaway(x, u, p), friction.sliding(x, u, p)) * jnp.abs(friction.effect(x, u, p)[i])

    def state(rate, x, u, p, breaks=False):
        """Which way the mass slides, +-1, and 0 where it sticks; `breaks` where it has just broken away."""
        free, at_rest = rate(x, u, p)[i], x[i] == 0.0
        sticks = at_rest & (jnp.abs(free) <= breakaway(x, u, p)) & ~breaks
        backwards = jnp.where(at_rest, free * friction.effect(x, u, parameters(p))[i], x[i]) < 0.0
        return jax.lax.stop_gradient(jnp.where(sticks, 0.0, jnp.where(backwards, -1.0, 1.0)))

    @cache
    def rubbed(rate):
        """The rate with friction, `Given` which way the mass slides."""

        def rubbed(x, u, given):
            way, p = given.fixed, parameters(given)
            free, effect = rate(x, u, given.p), friction.effect(x, u, p)
            # a force that keeps the velocity where the mass sticks acts on other states too
            others = any(not isinstance(e, float) for k, e in enumerate(effect) if k != i)
            sliding = -way * friction.sliding(x, u, p)
            force = jnp.where(way == 0.0, -free[i] / effect[i], sliding) if others else sliding
            rates = [plus(f, times(force, e)) for f, e in zip(free, effect, strict=True)]
            rates[i] = jnp.where(way == 0.0, 0.0, rates[i])
            return tuple(rates)

        return rubbed

    def reserve(rate):
        """What falls through zero when the mass comes to rest or breaks away."""

        def held(x, u, p, _):
            return breakaway(x, u, p) - jnp.abs(rate(x, u, p)[i])

        def slides(x, _, __, way):
            return way * x[i]

        # what holds a mass is not asked of those that slide
        return lambda x, u, given, side=None: jax.lax.cond(given.fixed == 0.0, held, slides, x, u, *given)

    def at_zero(where, x):
        return tuple(jnp.where(where, 0.0, v) if k == i else v for k, v in enumerate(x))

    def quiet(rate, x, u0, u1, h, p, varying, pattern=None):
        given = Given(p, state(rate, x, u0, p))
        end, may = quiet_step(step)(rubbed(rate), x, u0, u1, h, given, varying, None)
        return at_zero(given.fixed == 0.0, end), may | possible(rate, end, u1 if varying else u0, given)

    def possible(rate, end, u, given):
        """Whether the mass may have come to rest or broken away in a step."""
        return reserve(rate)(end, u, given) <= 0.0

    def stepper(derived, rate, x, u0, u1, h, p, varying, pattern=None):
        def stepped(x, u0, u1, h, given, step=step):
            return at_zero(given.fixed == 0.0, step(rubbed(rate), x, u0, u1, h, given, varying, None))

        def looked_at(*given):
            return stepped(*jax.lax.stop_gradient(given), step=values_of(step))

        surface = Surface(stepped, looked_at, rubbed(rate), reserve(rate), varying)

        def segment(carry, last):
            x, u0, h, end, way = carry
            found = fall(surface, x, end, u0, u1, h, Given(p, way))

            def turned(x, u0, h, _, way):
                share, there = arrived(surface, (x, u0, u1, h, Given(p, way), None), found)
                at, there, left = between(u0, u1, share, varying), at_zero(True, there), (1.0 - share) * h
                later = Given(p, state(rate, there, at, p, way == 0.0))
                given = there, at, u1, left, later
                end = looked_at(*given)
                more = possible(rate, *jax.lax.stop_gradient((end, u1 if varying else at, later)))
                end = _either(more, lambda *_: end, stepped, *given) if derived else end
                return there, at, jnp.where(more, left, 0.0), end, later.fixed

            def ended(x, u0, h, end, way):
                end = stepped(x, u0, u1, h, Given(p, way)) if derived else end
                return x, u0, jnp.zeros_like(h), at_zero(found.crossed, end), way

            return _either(found.crossed & ~last, turned, ended, *carry)

        way = state(rate, x, u0, p)
        return _segments(segment, most, x, u0, h, looked_at(x, u0, u1, h, Given(p, way)), way)[3]

    return Switching(_traced(partial(stepper, False)), _traced(partial(stepper, True)), _traced(quiet))


def with_backlash(step: Stepper, play: Play) -> Stepper:
    """A stepper in which the state of `play` follows its drive with a gap, exactly while the drive moves one way.

    The play operator y1 = min(max(y0, drive - gap), drive + gap): M. Brokate, J. Sprekels, Hysteresis and Phase
    Transitions, Springer 1996, sec. 2.3. The rates see the moving y inside the step. Take steps shorter than a reversal.
    `pattern` is not used: the play adds entries to the Jacobian.
    """

    def followed(x, u, p, begin):
        p = parameters(p)
        drive, gap = play.drive(x, u, p), play.gap(x, u, p)
        y = jnp.minimum(jnp.maximum(begin, drive - gap), drive + gap)
        return tuple(y if k == play.state else v for k, v in enumerate(x))

    @cache
    def driven(rate):
        """The rate of what follows, `Given` the state of the play at the start."""

        def driven(x, u, given):
            rates = rate(followed(x, u, *given), u, given.p)
            return tuple(jnp.zeros_like(r) if k == play.state else r for k, r in enumerate(rates))

        return driven

    def stepper(rate, x, u0, u1, h, p, varying, pattern=None):
        given = Given(p, x[play.state])
        return followed(step(driven(rate), x, u0, u1, h, given, varying), u1 if varying else u0, *given)

    return stepper


def _traced(step: Callable[..., Any]) -> Callable[..., Any]:
    """A stepper that is traced once for each rate, however often it is called; what its rate needs of a step stands in `Given`."""
    once = jax.jit(step, static_argnums=(0, 6, 7))

    def traced(rate, x, u0, u1, h, p, varying, pattern=None):
        # numbers of Python are of a weak type, which would be another program
        given = jax.tree.map(lambda v: jnp.asarray(v, dtype=float), (tuple(x), tuple(u0), tuple(u1), h, p))
        return once(rate, *given, varying, pattern)

    return traced


def _still(x, *_):
    return x


def _once(step: Stepper) -> Stepper:
    return step if isinstance(step, Switching) else _traced(step)


def _segments(segment, most, x, u0, h, *more):
    """The carry after `most` + 1 segments of a step, one program for all."""
    carry = jax.tree.map(lambda v: jnp.asarray(v, dtype=float), (tuple(x), tuple(u0), h, *more))

    def needed(carry, last):
        return jax.lax.cond(carry[2] != 0.0, jax.checkpoint(segment, prevent_cse=False), lambda carry, _: carry, carry, last), None

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


def _falling(event):
    """The event's function, turned so that the crossing asked for is a falling one; `side` as of `_side`."""
    return lambda x, u, p, side: (event.sign or side) * event.when(x, u, p)


def _side(event, rate, x, u0, u1, h, p, share):
    """The sign of an event's function at the start of a step, where crossings both ways are events; None where one is."""
    if event.sign:
        return None
    value, travel = slope(event.when, rate, x, u0, change(u0, u1, True), h, p)
    near = jnp.abs(value) <= share * jnp.abs(travel)
    return jax.lax.stop_gradient(jnp.sign(jnp.where(near, travel, value)))


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
        return tuple(jnp.asarray(given[n], dtype=float) if n in given else old for n, old in zip(vector.states, otherwise(x), strict=True))

    return complete


def _place(state, vector, what):
    if state not in vector.states:
        raise ModelError(f"Model {vector.model.name!r}: {what} acts on {state!r}, which is not one of the states {list(vector.states)}.")
    return vector.states.index(state)
