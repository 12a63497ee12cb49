"""Events inside a step: crossings located and stepped to exactly.

The time of a crossing is solved for with constants, then corrected once with the true derivatives, which is the
implicit function theorem: what follows the event then knows how its time moves (the saltation matrix; R. I. Leine, H.
Nijmeijer, Dynamics and Bifurcations of Non-Smooth Mechanical Systems, Springer 2004, sec. 7.2).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.switching import switched
from plantfit.simulate.steps.switching.crossings import (
    NEAR,
    SETTLED_NEAR,
    Surface,
    arrived,
    between,
    change,
    close,
    fall,
    kept,
    searched,
    slope,
)
from plantfit.simulate.steps.switching.declared import Trigger
from plantfit.simulate.steps.switching.switched import Stepper, Switching, either, values_of, where
from plantfit.simulate.steps.times import moment
from plantfit.simulate.steps.vector import Scalars

import jax
import jax.numpy as jnp

AROUND = (
    1e-4  # of a step's travel: so near to the surface at an end of a step it is looked at closely, far more than NEAR
)


def with_events(step: Stepper, events: Sequence[Trigger], most: int = 2) -> Stepper:
    """A stepper that ends a step at the first crossing, resets there and goes on, up to `most` times in one step.

    The state is NaN when yet another crossing follows, so take shorter steps or raise `most`; events that pile up
    without end (a ball coming to rest) must be ended by the model: let `then` stop what has become slow. A pair of
    crossings of one surface within a step is not seen. Events at a straight line in time are followed however many
    there are, exactly, and those that meet in one moment all happen, in their order.
    """
    if not events:
        return step
    # steps end at moments that are known beforehand, so that these meet in one
    most = most + sum(e.straight and not e.fixed for e in events) + any(e.straight and e.fixed for e in events)
    cutter = _Cutter(switched.once(step), tuple(events), most)
    return Switching(
        switched.traced(partial(cutter.cut, False)),
        switched.traced(partial(cutter.cut, True)),
        switched.traced(cutter.quiet),
    )


@dataclass(frozen=True, eq=False)
class _Cutter:
    """Steps of `step`, cut at events, at most `most` times each."""

    step: Stepper
    events: tuple[Trigger, ...]
    most: int

    def quiet(self, rate, x, u0, u1, h, p, varying, pattern=None):
        """The step as if no event were in it, and whether one may be."""
        end, may = switched.quiet_step(self.step)(rate, x, u0, u1, h, p, varying, pattern)
        return end, may | self.possible(rate, x, end, u0, u1, h, p, varying, h)

    def possible(self, rate, x, end, u0, u1, h, p, varying, whole):
        """Whether an event may be in the step from x to `end`, the rest of one of length `whole`."""
        may = jnp.zeros((), dtype=bool)
        share = AROUND + _near(h, whole)
        for e in self.events:
            if e.straight:
                may = may | _moment(e, x, u0, u1, h, p).passed
                continue
            side, moves = _side(e, rate, x, u0, u1, h, p, whole), change(u0, u1, varying)
            g0, travel = slope(partial(_falling(e), side=side), rate, x, u0, moves, h, p)
            g1 = _falling(e)(x if e.timed else end, u1 if varying else u0, p, side)
            # each value is held against a share of the travel and of the other value, which is more than the travel
            # where it counts: as |g1 - g0| would be, with fewer operations
            room = share * jnp.abs(travel)
            may = may | ((g0 - share * g1 > -room) & (g1 - share * g0 < room))
        return may

    def cut(self, derived, rate, x, u0, u1, h, p, varying, pattern=None):
        """The step in segments that end at its events; `derived` where derivatives are taken of it."""
        within = _Within(self, derived, rate, u1, p, varying, pattern, jax.lax.stop_gradient(h))
        return switched.segments(within.segment, self.most, derived, x, u0, h, within.looked_at(x, u0, u1, h, p))[3]


@dataclass(frozen=True, eq=False)
class _Within:
    """One step that is cut: what is the same in all its segments; `whole` is its length."""

    of: _Cutter
    derived: bool
    rate: Callable[..., Scalars]
    u1: Scalars
    p: Any
    varying: bool
    pattern: Any
    whole: Any

    @property
    def by_time(self) -> bool:
        return any(e.timed for e in self.of.events)

    def looked_at(self, x, u0, u1, h, p):
        """A step without derivatives, which may be NaN where it does not count."""
        return values_of(self.of.step)(self.rate, *jax.lax.stop_gradient((x, u0, u1, h, p)), self.varying, self.pattern)

    def stepped(self, x, u0, u1, h, p):
        return self.of.step(self.rate, x, u0, u1, h, p, self.varying, self.pattern)

    def segment(self, carry, last):
        """What is left of the step behind its next event, or its end where none is left."""
        x, u0, h, end = carry
        moments = [_moment(e, x, u0, self.u1, h, self.p) if e.straight else None for e in self.of.events]
        both = zip(self.of.events, moments, strict=True)
        found = [self._met(e, x, u0, h, end) if m is None else (m.passed, m.share, x) for e, m in both]
        first, chosen, there = _soonest(found, x, h)
        happens = first <= 1.0

        def reset(x, u0, h, _, first, there):
            return self._reset(moments, chosen, x, u0, h, first, there)

        def ended(x, u0, h, end, *_):
            end = self.stepped(x, u0, self.u1, h, self.p) if self.derived else end
            return x, u0, jnp.zeros_like(h), tuple(jnp.where(happens, jnp.nan, v) for v in end)

        return either(happens & ~last, reset, ended, x, u0, h, end, first, there)

    def _surface(self, e):
        # the states need not be moved to see what depends on time alone
        move, look = (_still, _still) if e.timed else (self.stepped, self.looked_at)
        return Surface(move, look, self.rate, _falling(e), self.varying, SETTLED_NEAR, self.by_time)

    def _met(self, e, x, u0, h, end):
        """Whether an event is in the step, at which share of it, and the states there."""
        given = x, u0, self.u1, h, self.p, _side(e, self.rate, x, u0, self.u1, h, self.p, self.whole)
        found = fall(self._surface(e), x, end, u0, self.u1, h, self.p, given[-1], self.whole)
        surface = self._surface(e)

        def nowhere(given, *_):
            return jnp.ones_like(h), given[0]

        place = jax.lax.cond(
            found.crossed, lambda given: searched(surface, given, found), nowhere, jax.lax.stop_gradient(given)
        )
        if self.derived:
            place = jax.lax.cond(found.crossed, partial(arrived, surface), nowhere, given, kept(place))
        share, there = place
        return found.crossed, share, there

    def _reset(self, moments, chosen, x, u0, h, first, there):
        """What is left of the step behind event `chosen`, which is at the share `first` with the states `there`."""
        at = between(u0, self.u1, first, self.varying, self.by_time)
        # the moment itself, so that what comes after begins behind it
        now = at[-1]
        for k, m in enumerate(moments):
            now = now if m is None else jnp.where(chosen == k, m.time, now)
        at = (*at[:-1], now)
        there = self._moved_by_clock(chosen, x, u0, at, first * h, there)
        for k, (event, m) in enumerate(zip(self.of.events, moments, strict=True)):
            happening = chosen == k if m is None else m.passed & (m.time == now)
            there = where(happening, event.then(there, at, self.p), there)
        left = (1.0 - first) * h
        given = there, at, self.u1, left, self.p
        end = self.looked_at(*given)
        more = self.of.possible(self.rate, *jax.lax.stop_gradient((there, end, *given[1:])), self.varying, self.whole)
        return (
            there,
            at,
            jnp.where(more, left, 0.0),
            either(more, lambda *_: end, self.stepped, *given) if self.derived else end,
        )

    def _moved_by_clock(self, chosen, x, u0, at, h, there):
        """The states at an event that depends on time alone, for which nothing has moved them yet; `there` at
        another."""
        by_clock = [chosen == k for k, e in enumerate(self.of.events) if e.timed]
        if not by_clock:
            return there
        move = self.stepped if self.derived else self.looked_at
        return jax.lax.cond(
            jnp.any(jnp.stack(by_clock)), lambda _: move(x, u0, at, h, self.p), lambda there: there, there
        )


class _Moment(NamedTuple):
    """When a straight line in time passes zero, whether that is within the step, and at which share of it (1 where
    not)."""

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


def _side(event, rate, x, u0, u1, h, p, whole):
    """The sign of an event's function at the start of a step, where crossings both ways are events; None where one
    is."""
    if event.sign:
        return None
    value, travel = slope(event.when, rate, x, u0, change(u0, u1, True), h, p)
    return jax.lax.stop_gradient(jnp.sign(jnp.where(close(value, travel, h, whole), travel, value)))


def _near(h, whole):
    """`NEAR` of a step of length `whole` as a share of one of length h."""
    if h is whole:
        return NEAR
    return NEAR * jax.lax.stop_gradient(whole / jnp.where(h == 0.0, 1.0, h))


def _soonest(found, x, h):
    """(share, place in the list, states there) of the event that is met first; share 2 where none is."""
    first, chosen, there = jnp.full_like(h, 2.0), jnp.full_like(h, -1.0), x
    for k, (crossed, share, arriving) in enumerate(found):
        sooner = crossed & (share < first)
        first, chosen, there = (
            jnp.where(sooner, share, first),
            jnp.where(sooner, k, chosen),
            where(sooner, arriving, there),
        )
    return first, chosen, there


def _still(x, *_):
    return x
