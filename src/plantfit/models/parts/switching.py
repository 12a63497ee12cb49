"""What a model may declare beside its equations: events, dry friction, backlash and late states.

Functions take and give mappings from names, as those of `Model`: `x` states, `u` channels, `p` parameters.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

Named = Mapping[str, Any]
Scalar = Callable[[Named, Named, Named], Any]


@dataclass(frozen=True)
class Event:
    """When the smooth scalar `when(x, u, p)` passes zero, the states that `then(x, u, p)` names jump to its values.

    `direction` "falling" means from positive to negative. `when` must move with the states or with inputs that are
    straight lines; the jump of a held input at a sample is not a crossing.
    """

    name: str
    when: Scalar
    then: Callable[[Named, Named, Named], Named]
    direction: Literal["falling", "rising", "both"] = "falling"


@dataclass(frozen=True)
class Friction:
    """Coulomb friction that sticks, opposing the state `velocity`; the derivative of the model leaves it out.

    `sliding(x, u, p)` is the size of the friction force while moving (it may depend on the velocity, as Stribeck's
    does), `breakaway(x, u, p)` the largest force at rest (N or N m). `effect(x, u, p)` maps the states that the force
    acts on to their rate per unit of force: {"v": 1 / m}. It must name `velocity`.
    """

    velocity: str
    sliding: Scalar
    breakaway: Scalar
    effect: Callable[[Named, Named, Named], Named]


@dataclass(frozen=True)
class Backlash:
    """The state `state` (declared with derivative 0) follows `drive(x, u, p)` with play of `gap(x, u, p)` to each side.

    A smooth alternative needs no declaration: pass the force k dead_zone(drive - driven, gap) of a stiff spring k.
    """

    state: str
    drive: Scalar
    gap: Scalar


@dataclass(frozen=True)
class StateDelay:
    """A late copy of a state: `channel` holds state(t - parameter), the parameter in seconds, and state(t0) before
    t0."""

    channel: str
    state: str
    parameter: str
