"""Backlash inside a step: a state that follows its drive with a gap."""

from functools import cache

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.switching.declared import Play
from plantfit.simulate.steps.switching.switched import Given, Stepper, parameters

import jax.numpy as jnp


def with_backlash(step: Stepper, play: Play) -> Stepper:
    """A stepper in which the state of `play` follows its drive with a gap, exactly while the drive moves one way.

    The play operator y1 = min(max(y0, drive - gap), drive + gap): M. Brokate, J. Sprekels, Hysteresis and Phase
    Transitions, Springer 1996, sec. 2.3. The rates see the moving y inside the step. Take steps shorter than a
    reversal. `pattern` is not used: the play adds entries to the Jacobian.
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
