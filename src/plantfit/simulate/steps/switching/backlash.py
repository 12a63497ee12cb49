"""Backlash inside a step: a state that follows its drive with a gap."""

from functools import cache

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.switching.declared import Play
from plantfit.simulate.steps.switching.switched import Given, Stepper, parameters

import jax.numpy as jnp


def with_backlash(step: Stepper, *plays: Play) -> Stepper:
    """A stepper in which the states of `plays` follow their drives with a gap, exactly while the drives move one way;
    where a drive depends on another play, that one is listed before.

    The play operator y1 = min(max(y0, drive - gap), drive + gap): M. Brokate, J. Sprekels, Hysteresis and Phase
    Transitions, Springer 1996, sec. 2.3. The rates see the moving y inside the step, which `step` takes in the other
    states alone: y is a function of them. Take steps shorter than a reversal. `pattern` is not used: the play adds
    entries to the Jacobian.
    """
    if not plays:
        return step
    played = {play.state: k for k, play in enumerate(plays)}

    def others(x):
        return tuple(v for k, v in enumerate(x) if k not in played)

    def followed(x, u, p, begin):
        """All states, of the others and what the plays begin with."""
        p, left = parameters(p), iter(x)
        x = tuple(begin[played[k]] if k in played else next(left) for k in range(len(x) + len(plays)))
        for play, y in zip(plays, begin, strict=True):
            drive, gap = play.drive(x, u, p), play.gap(x, u, p)
            y = jnp.minimum(jnp.maximum(y, drive - gap), drive + gap)
            x = tuple(y if k == play.state else v for k, v in enumerate(x))
        return x

    @cache
    def driven(rate):
        """The rates of the other states, `Given` the states of the plays at the start."""
        return lambda x, u, given: others(rate(followed(x, u, *given), u, given.p))

    def stepper(rate, x, u0, u1, h, p, varying, pattern=None):
        given = Given(p, tuple(x[play.state] for play in plays))
        return followed(step(driven(rate), others(x), u0, u1, h, given, varying), u1 if varying else u0, *given)

    return stepper
