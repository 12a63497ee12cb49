"""Dry friction inside a step: a mass that slides, comes to rest, sticks and breaks away."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.steppers import plus, times
from plantfit.simulate.steps.switching import switched
from plantfit.simulate.steps.switching.crossings import Surface, arrived, between, fall, kept, searched
from plantfit.simulate.steps.switching.declared import DryFriction
from plantfit.simulate.steps.switching.switched import Given, Stepper, Switching, either, parameters, values_of
from plantfit.simulate.steps.vector import Scalars

import jax
import jax.numpy as jnp

Rate = Callable[..., Scalars]


def with_friction(step: Stepper, friction: DryFriction, most: int = 2) -> Stepper:
    """A stepper for rates without dry friction that adds it: the velocity is exactly 0 while stuck.

    The mass sticks when its velocity meets 0 and the force needed to hold it is at most the breakaway force (never
    taken below the sliding one), and breaks away when more is needed: D. Karnopp, J. Dyn. Sys. Meas. Control 107
    (1985) 100, with exact times instead of a band. Up to `most` changes in one step; after these a velocity that
    meets 0 is held until the step ends. Wrap once per friction when several do not act on each other's velocity.
    `pattern` is not used: friction adds entries to the Jacobian.
    """
    rubbing = _Rubbing(switched.once(step), friction, most)
    return Switching(
        switched.traced(partial(rubbing.cut, False)),
        switched.traced(partial(rubbing.cut, True)),
        switched.traced(rubbing.quiet),
    )


@dataclass(frozen=True, eq=False)
class _Rubbing:
    """Steps of `step` with dry friction, cut where the mass comes to rest or breaks away, at most `most` times each."""

    step: Stepper
    friction: DryFriction
    most: int
    rates: dict[Rate, Rate] = field(default_factory=dict)

    def rubbed(self, rate: Rate) -> Rate:
        """The rate with friction, `Given` which way the mass slides; one for each rate, so that a step with it is
        traced once."""
        if rate not in self.rates:
            self.rates[rate] = partial(self._rubbed, rate)
        return self.rates[rate]

    def quiet(self, rate, x, u0, u1, h, p, varying, pattern=None):
        """The step as if nothing changed in it, and whether something may."""
        given = Given(p, self._way(rate, x, u0, p))
        end, may = switched.quiet_step(self.step)(self.rubbed(rate), x, u0, u1, h, given, varying, None)
        return self.at_zero(given.fixed == 0.0, end), may | self.possible(rate, end, u1 if varying else u0, given)

    def possible(self, rate, end, u, given):
        """Whether the mass may have come to rest or broken away in a step."""
        return self.reserve(rate)(end, u, given) <= 0.0

    def cut(self, derived, rate, x, u0, u1, h, p, varying, pattern=None):
        """The step in segments that end where something changes; `derived` where derivatives are taken of it."""
        within = _Within(self, derived, rate, u1, p, varying)
        way = self._way(rate, x, u0, p)
        return switched.segments(
            within.segment, self.most, derived, x, u0, h, within.looked_at(x, u0, u1, h, Given(p, way)), way
        )[3]

    def reserve(self, rate):
        """What falls through zero when the mass comes to rest or breaks away."""
        i = self.friction.velocity

        def held(x, u, p, _):
            return self._breakaway(x, u, p) - jnp.abs(rate(x, u, p)[i])

        def slides(x, _, __, way):
            return way * x[i]

        # what holds a mass is not asked of those that slide
        return lambda x, u, given, side=None: jax.lax.cond(given.fixed == 0.0, held, slides, x, u, *given)

    def at_zero(self, where, x):
        """The states with the velocity exactly 0 where it is to be."""
        return tuple(jnp.where(where, 0.0, v) if k == self.friction.velocity else v for k, v in enumerate(x))

    def _breakaway(self, x, u, p):
        """The largest rate of the velocity that friction takes up at rest."""
        p, law = parameters(p), self.friction
        return jnp.maximum(law.breakaway(x, u, p), law.sliding(x, u, p)) * jnp.abs(law.effect(x, u, p)[law.velocity])

    def _way(self, rate, x, u, p, breaks=False):
        """Which way the mass slides, +-1, and 0 where it sticks; `breaks` where it has just broken away."""
        i = self.friction.velocity
        free, at_rest = rate(x, u, p)[i], x[i] == 0.0
        sticks = at_rest & (jnp.abs(free) <= self._breakaway(x, u, p)) & jnp.logical_not(breaks)
        backwards = jnp.where(at_rest, free * self.friction.effect(x, u, parameters(p))[i], x[i]) < 0.0
        return jax.lax.stop_gradient(jnp.where(sticks, 0.0, jnp.where(backwards, -1.0, 1.0)))

    def _rubbed(self, rate, x, u, given):
        i, way, p = self.friction.velocity, given.fixed, parameters(given)
        free, effect = rate(x, u, given.p), self.friction.effect(x, u, p)
        # a force that keeps the velocity where the mass sticks acts on other states too
        others = any(not isinstance(e, float) for k, e in enumerate(effect) if k != i)
        sliding = -way * self.friction.sliding(x, u, p)
        force = jnp.where(way == 0.0, -free[i] / effect[i], sliding) if others else sliding
        rates = [plus(f, times(force, e)) for f, e in zip(free, effect, strict=True)]
        rates[i] = jnp.where(way == 0.0, 0.0, rates[i])
        return tuple(rates)


@dataclass(frozen=True, eq=False)
class _Within:
    """One step that is cut: what is the same in all its segments."""

    of: _Rubbing
    derived: bool
    rate: Rate
    u1: Scalars
    p: Any
    varying: bool

    def stepped(self, x, u0, u1, h, given):
        return self._by(self.of.step, x, u0, u1, h, given)

    def looked_at(self, *given):
        """A step without derivatives."""
        return self._by(values_of(self.of.step), *jax.lax.stop_gradient(given))

    def segment(self, carry, last):
        """What is left of the step after the next change, or its end where none is left."""
        x, u0, h, end, way = carry
        surface = Surface(
            self.stepped, self.looked_at, self.of.rubbed(self.rate), self.of.reserve(self.rate), self.varying
        )
        found = fall(surface, x, end, u0, self.u1, h, Given(self.p, way))
        turns = found.crossed & ~last

        def given(x, u0, h, way):
            return x, u0, self.u1, h, Given(self.p, way), None

        def turned(x, u0, h, end, way, place=None):
            place = (
                searched(surface, given(x, u0, h, way), found)
                if place is None
                else arrived(surface, given(x, u0, h, way), place)
            )
            return self._turned(u0, h, way, *place)

        def ended(x, u0, h, end, way, *_):
            end = self.stepped(x, u0, self.u1, h, Given(self.p, way)) if self.derived else end
            return x, u0, jnp.zeros_like(h), self.of.at_zero(found.crossed, end), way

        if not self.derived:
            return either(turns, turned, ended, *carry)
        place = jax.lax.cond(
            turns,
            lambda given: searched(surface, given, found),
            lambda given: (jnp.ones_like(h), given[0]),
            jax.lax.stop_gradient(given(x, u0, h, way)),
        )
        return either(turns, turned, ended, *carry, kept(place))

    def _turned(self, u0, h, way, share, there):
        """What is left of the step behind the place where the mass came to rest or broke away."""
        at, there, left = between(u0, self.u1, share, self.varying), self.of.at_zero(True, there), (1.0 - share) * h
        later = Given(self.p, self.of._way(self.rate, there, at, self.p, way == 0.0))
        given = there, at, self.u1, left, later
        end = self.looked_at(*given)
        more = self.of.possible(self.rate, *jax.lax.stop_gradient((end, self.u1 if self.varying else at, later)))
        end = either(more, lambda *_: end, self.stepped, *given) if self.derived else end
        return there, at, jnp.where(more, left, 0.0), end, later.fixed

    def _by(self, step, x, u0, u1, h, given):
        return self.of.at_zero(
            given.fixed == 0.0, step(self.of.rubbed(self.rate), x, u0, u1, h, given, self.varying, None)
        )
