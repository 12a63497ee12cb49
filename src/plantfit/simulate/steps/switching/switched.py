"""A step in which something may happen.

Most steps hold no event. `Switching` takes a step as if nothing happened and looks at both its ends; only where
something may have happened is the step taken again, cut at what happens. Native code skips the second where no lane of
a vector needs it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import plantfit.runtime  # noqa: F401
from plantfit.simulate.steps.switching.crossings import KEPT
from plantfit.simulate.steps.vector import Scalars

import jax
import jax.numpy as jnp

Stepper = Callable[..., Scalars]


@dataclass(frozen=True, eq=False)
class Switching:
    """A stepper in which something may happen: `whole` follows what does, however little; `values` is the same without
    derivatives.

    `quiet` takes the same and gives the step as if nothing happened in it, which is right where nothing did, and
    whether something may.
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

        return either(may, whole, plain, *given)

    def valued(
        self,
        rate: Callable[..., Scalars],
        x: Scalars,
        u0: Scalars,
        u1: Scalars,
        h: Any,
        p: Any,
        varying: bool,
        pattern: Any = None,
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
    """What a rate is given in place of the parameters `p`: these, which may be `Given` in turn, and what is fixed over
    a step.

    So rates are functions that close over nothing, and a step with one of them is traced once.
    """

    p: Any
    fixed: Any


def parameters(p: Any) -> Scalars:
    """The model's own parameters."""
    return parameters(p.p) if isinstance(p, Given) else p


def traced(step: Callable[..., Any]) -> Callable[..., Any]:
    """A stepper that is traced once for each rate, however often it is called; what its rate needs of a step stands
    in `Given`."""
    once = jax.jit(step, static_argnums=(0, 6, 7))

    def traced(rate, x, u0, u1, h, p, varying, pattern=None):
        # numbers of Python are of a weak type, which would be another program
        given = jax.tree.map(lambda v: jnp.asarray(v, dtype=float), (tuple(x), tuple(u0), tuple(u1), h, p))
        return once(rate, *given, varying, pattern)

    return traced


def once(step: Stepper) -> Stepper:
    """A stepper that is traced once for each rate."""
    return step if isinstance(step, Switching) else traced(step)


def segments(segment: Callable[..., Any], most: int, derived: bool, x: Scalars, u0: Scalars, h: Any, *more: Any) -> Any:
    """The carry after at most `most` + 1 segments of a step, one program for all; `derived` where derivatives are taken
    of it."""
    carry = jax.tree.map(lambda v: jnp.asarray(v, dtype=float), (tuple(x), tuple(u0), h, *more))
    if not derived:
        # ends with the last lane that has something left, and hands its carry on without a selection
        def next_one(counted):
            count, carry = counted
            return count + 1, segment(carry, count == most)

        begin = jnp.zeros((), dtype=jnp.int32), carry
        return jax.lax.while_loop(lambda counted: counted[1][2] != 0.0, next_one, begin)[1]

    followed = jax.checkpoint(segment, prevent_cse=False, policy=jax.checkpoint_policies.save_only_these_names(KEPT))

    def needed(carry, last):
        return jax.lax.cond(carry[2] != 0.0, followed, lambda carry, _: carry, carry, last), None

    return jax.lax.scan(needed, carry, jnp.arange(most + 1) == most)[0]


def either(happens: Any, whole: Callable[..., Any], plain: Callable[..., Any], *given: Any) -> Any:
    """`whole(*given)` where something happens, `plain(*given)` elsewhere; derivatives of `plain` that are NaN stay
    out of it there."""
    held = partial(jax.tree.map, lambda a: jnp.where(happens, jax.lax.stop_gradient(a), a))
    return jax.lax.cond(happens, whole, lambda *given: plain(*held(given)), *given)


def where(condition: Any, yes: Scalars, no: Scalars) -> Scalars:
    """`yes` where the condition holds, `no` elsewhere, state by state."""
    return tuple(jnp.where(condition, a, b) for a, b in zip(yes, no, strict=True))
