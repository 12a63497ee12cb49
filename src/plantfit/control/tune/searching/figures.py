"""Figures of a loop that a search makes small, and how each is counted."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.tune.loop_scores import LoopScores
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SpecError

import jax.numpy as jnp

MEANING = {
    "iae": "integral of the absolute error of the step",
    "itae": "the same, each moment times its time",
    "load_iae": "integral of the absolute error after the load",
    "load_peak": "largest error after the load",
    "settling": "time to within 2 % of the step",
    "overshoot": "beyond the set point",
    "travel": "all moves of the input together",
    "input_noise": "what noise moves the input",
}


def known_figures(names: Sequence[str], where: str) -> None:
    """Raises SpecError for a figure that there is not."""
    for name in names:
        if name not in MEANING:
            raise SpecError(f"{where} names {name!r}; the figures are {', '.join(MEANING)}.")


def figure(name: str, scores: LoopScores, moved: Any, half: Any) -> Any:
    """One figure of loops; a loop that does not settle counts as twice the `half` (s) that it has. jax-traceable."""
    if name == "input_noise":
        return moved
    value = getattr(scores, name)
    return jnp.where(jnp.isposinf(value), 2.0 * half, value) if name == "settling" else value


def sizes_of(scores: LoopScores, wishes: Wishes, half: float) -> dict[str, float]:
    """What every figure is counted in: that of SIMC on the best fit, or what is asked for where that says nothing."""
    instead = {"overshoot": wishes.overshoot, "input_noise": wishes.input_noise, "settling": half}
    found = {}
    for name in MEANING:
        value = float(getattr(scores, name)[0, 0]) if name not in ("input_noise", "overshoot") else np.nan
        found[name] = value if 0 < value < np.inf else instead.get(name, 1.0)
    return found


def weights_of(minimise: Mapping[str, float]) -> dict[str, float]:
    """Shares that add up to 1."""
    total = sum(minimise.values())
    return {name: value / total for name, value in minimise.items() if value > 0}
