"""A slow drift of an output as a curve in time, for the study file: where its nodes are and what its values may be."""

from dataclasses import dataclass

import numpy as np

from plantfit.models.extensions import parameter_name
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.trust.diagnosis.plant.timeless.static import unordered
from plantfit.trust.validate.wandering import Wandering

KIND, NAME = "slow_drift", "slow drift of {}"
FEWEST, MOST = 20, 50  # nodes
APART = 2.0  # times the samples over which the smoothing of a walk looks, between nodes


@dataclass(frozen=True)
class Curve:
    """The drift of an `output` within `bounds` (low, high), in its unit, through `count` even nodes from `begin` to
    `end` s; `several` recordings have one each."""

    output: str
    bounds: tuple[float, float]
    begin: float
    end: float
    count: int
    several: bool

    @property
    def name(self) -> str:
        return NAME.format(self.output)

    @property
    def parameter(self) -> str:
        return parameter_name(KIND, self.output)


def driftable(problem: Problem) -> dict[str, str]:
    """What may be asked for: "slow drift of y" -> y, of the outputs of a model that is simulated and has none yet; none
    where rows are in no order."""
    if not isinstance(problem.model, Model) or unordered(problem):
        return {}
    had = {p.name for p in problem.model.parameters}
    return {NAME.format(y): y for y in problem.outputs if parameter_name(KIND, y) not in had}


def curve_of(problem: Problem, output: str, walk: Wandering | None = None, least: int = FEWEST) -> Curve:
    """The curve for an output: over the fitted samples, its values within the range that was measured. Nodes are as
    dense as the smoothing of a `walk` asks for, so that they follow it; without one the `least`."""
    fitted = {n: e.mask("fit") & np.isfinite(e.recording[output]) for n, e in problem.experiments.items()}
    used = {n: e for n, e in problem.experiments.items() if fitted[n].any()}
    times = [e.recording.t[fitted[n]] for n, e in used.items()]
    wide = float(np.ptp(np.concatenate([e.recording[output][fitted[n]] for n, e in used.items()])))
    samples, count = max(map(len, times)), min(max(least, FEWEST), MOST)
    if walk is not None:
        count = int(np.clip(samples * walk.gain / APART, FEWEST, MOST))
    count = max(min(count, samples // 3), 3)
    begin, end = min(float(t[0]) for t in times), max(float(t[-1]) for t in times)
    return Curve(output, (-wide, wide), begin, end, count, len(used) > 1)


__all__ = ["KIND", "Curve", "curve_of", "driftable"]
