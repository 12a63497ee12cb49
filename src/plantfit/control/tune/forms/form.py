"""What a form of controller is for a search and a judgement."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.control.tune.weights.plan_weights import PlanShape
from plantfit.control.tune.wishes import Wishes
from plantfit.simulate.loop.closed_loop import Controller
from plantfit.sobol import Sobol
from plantfit.space import Space

STARTS = 64  # controllers spread evenly over the cube that are tried before a search begins at the best of them


@dataclass(frozen=True, eq=False)
class Form:
    """What a kind of controller is for a search.

    `build(z, data)` turns a point of the cube of `space` into parameters (a pytree; jax-traceable) of the `loop`'s
    controller, which takes (these, the input at rest, *`given`); programs are compiled once for a `build` and a
    `response`, for all `data` and `given`. `response(parameters, w, xp)` is C(e^(jwh)) (F,) from the error with no
    limit acting, that of a cascade (2, F); `unstable` counts the controller's own poles outside the unit circle,
    `integrators` those at 1, and `settled` says that whatever its parameters none lies outside. Of another form
    `parts(parameters, w, xp)` are the two (F,) whose quotient is the response, of poles inside the unit circle but for
    `parted` at 1, so that unstable loops are counted in a search. `starts` (k, d) are
    points of the cube to begin with; `plan` is that of an MPC, `ahead` the samples that a Smith predictor looks ahead,
    `inner` says that it measures an inner output too.
    """

    name: str
    space: Space
    build: Callable[[Any, Any], Any]
    response: Callable[..., Any]
    loop: Controller
    unstable: Callable[[Any], int]
    starts: np.ndarray
    plan: PlanShape | None = None
    ahead: int = 0
    inner: bool = False
    integrators: int = 1
    settled: bool = False
    parts: Callable[..., tuple[Any, Any]] | None = None
    parted: int = 0
    data: Any = ()
    given: tuple[Any, ...] = ()

    def made(self, z: Any) -> Any:
        """Parameters of the controller at a point z (d,) of the cube."""
        return self.build(z, self.data)


def spread(space: Space) -> np.ndarray:
    """`STARTS` points (k, d) of the cube of a space, evenly."""
    return Sobol(space.dimension, np.random.default_rng(1)).random(STARTS)


def change(wishes: Wishes) -> float:
    """The most that the input moves in a sample."""
    return wishes.rate * wishes.period
