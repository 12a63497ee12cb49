"""Controllers tuned on a family of plants in place of one: what is asked of every member, and how members are
weighed."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.steps.step_profile import StepProfile, StepScores
from plantfit.errors import SearchError, SimulationError
from plantfit.optimize import Objective, RunResult, minimise
from plantfit.simulate.loop.closed_loop import ClosedLoop
from plantfit.space import Parameter, Space

import jax
import jax.numpy as jnp

STEEPNESS = 10.0  # of the penalty: an excess of 10 % of a limit doubles the cost


@dataclass(frozen=True)
class Demand:
    """What is asked: a small mean IAE of the steps, within limits, over plants of which the worse count more.

    The cost on a plant is the mean of `StepScores.iae` over the steps (s), times 1 + 10 times the largest excess over
    `overshoot` (%) and over `travel` (unit of the input, of a step), as a share of the limit (of at least 1). The cost
    over plants is their conditional value at risk, the mean of the worst `share`: 1 is the mean of all, 0 the worst
    case (R. Rockafellar, S. Uryasev, J. Risk 2 (2000) 21), plus `mean` times (their mean minus it).
    """

    overshoot: float = np.inf
    travel: float = np.inf
    share: float = 0.0
    mean: float = 0.0

    def __post_init__(self) -> None:
        for name, low, high in (
            ("share", 0.0, 1.0),
            ("mean", 0.0, 1.0),
            ("overshoot", 0.0, np.inf),
            ("travel", 0.0, np.inf),
        ):
            if not low <= getattr(self, name) <= high:
                raise SimulationError(
                    f"The demand has {name} = {getattr(self, name)}; give a number from {low:g} to {high:g}."
                )

    def of_plant(self, scores: StepScores) -> Any:
        """The cost on one plant, inf where the loop does not stay finite."""
        cost = jnp.mean(scores.iae)
        for values, limit in ((scores.overshoot, self.overshoot), (scores.travel, self.travel)):
            if np.isfinite(limit):
                cost = cost * (1.0 + STEEPNESS * jnp.maximum(jnp.max(values) - limit, 0.0) / max(limit, 1.0))
        return jnp.where(jnp.isfinite(cost), cost, jnp.inf)

    def over_plants(self, costs: Any) -> Any:
        """The cost over the family, of costs (..., n)."""
        n = costs.shape[-1]
        count = max(self.share * n, 1.0)
        worst = -jnp.sort(-costs, axis=-1)
        tail = jnp.where(
            jnp.isinf(worst[..., 0]),
            jnp.inf,
            jnp.sum(_counted(worst, np.clip(count - np.arange(n), 0.0, 1.0)), -1) / count,
        )
        return tail if self.mean == 0 else tail + self.mean * (jnp.mean(costs, axis=-1) - tail)


def _counted(values: Any, weights: np.ndarray) -> Any:
    return jnp.where(weights > 0, values, 0.0) * weights


def judged(
    loop: ClosedLoop, controllers: Any, plants: Mapping[str, Any], profile: StepProfile, **given: Any
) -> StepScores:
    """Every controller on every plant: `StepScores` of arrays (controllers, plants, steps), all loops in one program.

    `controllers` is a pytree and `plants` parameters by name, all with a leading axis; `given` goes to
    `ClosedLoop.observe` (x0, inputs, noise), the same for all. Raises SimulationError for a loop over several signals.
    """
    if not (loop.parts.single_output and loop.parts.single_input):
        raise SimulationError(
            "Steps are judged in loops over one signal; close it with output and input each as one name, not a list."
        )
    observer, levels = profile.observer(), jnp.asarray(profile.reference(loop.period))
    rows = {name: jnp.asarray(values, dtype=float) for name, values in plants.items()}

    def one(controller, plant):
        return loop.observe(observer, controller, plant, levels, **given)

    return jax.vmap(lambda c: jax.vmap(lambda p: one(c, p))(rows))(controllers)


def costs_over(
    loop: ClosedLoop, controllers: Any, plants: Mapping[str, Any], profile: StepProfile, demand: Demand, **given: Any
) -> Any:
    """What `demand` makes of `judged`: costs (controllers,), jax-traceable."""
    scores = judged(loop, controllers, plants, profile, **given)
    return demand.over_plants(jax.vmap(jax.vmap(demand.of_plant))(scores))


@dataclass(frozen=True)
class Tuned:
    """The best controller found: its `parameters`, their `values` by name, the cost over the family, all runs of the
    search."""

    parameters: Any
    values: dict[str, float]
    cost: float
    runs: list[RunResult]


def robust_tuning(
    loop: ClosedLoop,
    plants: Mapping[str, Any],
    profile: StepProfile,
    gains: Mapping[str, Parameter],
    make: Callable[..., Any],
    demand: Demand = Demand(),
    *,
    method: str = "cmaes",
    budget: int = 300,
    runs: int = 1,
    seed: int = 1,
    settings: Mapping[str, Any] | None = None,
    progress: Callable[[Any], None] | None = None,
    stop: Callable[[], bool] | None = None,
    **given: Any,
) -> Tuned:
    """Search the `gains` (bounds and scales as `Parameter`) so that `demand` is met best over all `plants` at once.

    `make(**gains)` gives the controller's parameters, such as `Gains`. One plant (leading axes of 1) is the usual
    tuning. An evaluation simulates one controller on every plant. Raises SearchError where no controller keeps every
    plant finite.
    """
    space = Space(gains)

    def controller(z):
        return make(**dict(zip(space.names, space.physical(z), strict=True)))

    @jax.jit
    def costs(zs):
        return costs_over(loop, jax.vmap(controller)(zs), plants, profile, demand, **given)

    objective = Objective(space.dimension, costs, start=None if space.start is None else space.start[None, :])
    found = minimise(
        objective, method, budget=budget, runs=runs, seed=seed, settings=settings, progress=progress, stop=stop
    )
    best = min(found, key=lambda r: r.cost)
    if not np.isfinite(best.cost):
        raise SearchError(
            "No controller within the bounds of its gains keeps every plant of the family finite; lower or widen them."
        )
    values = dict(zip(space.names, np.asarray(space.physical(best.x)).tolist(), strict=True))
    return Tuned(make(**values), values, best.cost, found)


def stacked_controllers(parameters: Sequence[Any]) -> Any:
    """Parameters of controllers of one kind with a leading axis, as `judged` takes them."""
    return jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf, dtype=float) for leaf in leaves]), *parameters)
