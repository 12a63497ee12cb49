"""The scales that residuals of several outputs are divided by: those given stay, the others follow the residuals."""

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from plantfit.findings.recordings import Weight
from plantfit.problem.evaluate import points
from plantfit.problem.measure.scale_source import GIVEN, UNIT, ScaleSource
from plantfit.problem.problem import Problem
from plantfit.trust.finish.unknown_noise import few_samples

ROUNDS = 10  # of estimating scales and searching with them
SETTLED = 1e-4  # relative change of every scale that ends the rounds
EXACT = 1e-10  # of an output's spread: residuals this small are rounding, and no scale goes below
FEW = 0.01  # of the spread of an output with no more samples than parameters, below which no scale goes


def open_scales(problem: Problem) -> tuple[str, ...]:
    """The outputs whose scales are to be estimated: those that nobody gave, where there are several outputs."""
    return tuple(o for o in problem.outputs if problem.scale_sources[o] != GIVEN) if len(problem.outputs) > 1 else ()


def weighed(
    problem: Problem, z: np.ndarray, search: Callable[[Problem, np.ndarray], np.ndarray]
) -> tuple[Problem, np.ndarray]:
    """The problem with open scales as its residuals show them, and its answer z (d,) by `search` from there.

    Each scale becomes the root mean square of its residuals and the search goes on, until nothing changes: for
    independent residuals that is the maximum of the likelihood over parameters and scales (Seber and Wild 1989,
    Nonlinear Regression, sec.
    11.4), and each of the two steps raises it, so that the rounds cannot go round in a circle.

    That likelihood has no maximum where an output has no more samples than there are free parameters: with a scale that
    goes to zero these samples are followed exactly, at any cost to the other outputs. Such a scale stays at 1 % of the
    output's spread at least. Of the only output, whose scale changes nothing, it stays as it is, and its source tells
    that it says nothing of the errors.
    """
    names = open_scales(problem)
    for k in range(1, ROUNDS + 1) if names else ():
        scales = residual_scales(problem, z, names)
        settled = all(abs(scales[o] - problem.scales[o]) <= SETTLED * problem.scales[o] for o in names)
        few = {o for o in few_samples(problem).intersection(names) if scales[o] <= least_scale(problem, o)}
        problem = problem.with_scales(
            {o: s for o, s in scales.items() if o not in few}, ScaleSource("residuals", k, settled)
        )
        problem = (
            problem.with_scales({o: scales[o] for o in few}, ScaleSource("few samples", k, settled)) if few else problem
        )
        if settled:
            break
        z = search(problem, z)
    only = problem.outputs[0]
    if len(problem.outputs) == 1 and problem.scale_sources[only] == UNIT and only in few_samples(problem):
        exact = residual_scales(problem, z, (only,))[only] <= least_scale(problem, only)
        problem = problem.with_scales({only: problem.scales[only]}, ScaleSource("few samples")) if exact else problem
    return problem, z


def residual_scales(problem: Problem, z: np.ndarray, names: Sequence[str]) -> dict[str, float]:
    """Root mean square of the residuals of each of these outputs at the cube point z (d,), in its unit."""
    residuals, start = points.residuals(problem, z), 0
    squares: dict[str, list[np.ndarray]] = {o: [] for o in problem.outputs}
    for recording in problem.data["drive"]:
        for output in problem.outputs:
            count = len(problem.data["measured"][recording][output])
            squares[output].append(residuals[start : start + count] ** 2)
            start += count
    return {
        o: max(least_scale(problem, o), problem.scales[o] * float(np.sqrt(np.mean(np.concatenate(squares[o])))))
        for o in names
    }


def least_scale(problem: Problem, output: str) -> float:
    """The scale of an output, in its unit, below which no estimate goes."""
    y = np.concatenate(_measured(problem, output))
    spread = float(np.std(y))
    if output in few_samples(problem):
        return FEW * (spread or float(np.max(np.abs(y), initial=0.0))) or 1e-12
    return max(1e-12, EXACT * spread)


def _measured(problem: Problem, output: str) -> list[np.ndarray]:
    return [own[output] for own in problem.data["measured"].values()]


def who_chose(source: ScaleSource) -> str:
    """Who chose a scale, in words."""
    if source.kind == "residuals":
        text = f"estimated from the residuals in {source.rounds} round{'s' if source.rounds > 1 else ''}"
        return text if source.settled else f"{text}, still changing"
    if source.kind == "few samples" and not source.rounds:
        return "the only output, with no more samples than there are free parameters, so that its noise cannot be told"
    return _WORDS[source.kind]


_WORDS = {
    "given": "given",
    "spread": "standard deviation of the record",
    "unit": "the only output, so that its scale changes nothing",
    "few samples": "1 % of its spread: it has no more samples than there are free parameters, so that its noise cannot "
    "be told",
}


def _chosen(source: ScaleSource) -> Literal["given", "unit", "spread", "residuals"]:
    """As findings have it: a least scale of few samples comes from residuals, but that of the only output, which is
    1."""
    return source.kind if source.kind != "few samples" else "residuals" if source.rounds else "unit"


def weight_rows(problem: Problem) -> list[Weight]:
    """Rows of the findings record: the scale of every output in its unit, and who chose it."""
    return [
        Weight(
            output=o,
            unit=problem.model.outputs[o],
            scale=float(problem.scales[o]),
            chosen=_chosen(problem.scale_sources[o]),
            who=who_chose(problem.scale_sources[o]),
            rounds=problem.scale_sources[o].rounds,
            settled=problem.scale_sources[o].settled,
            few=problem.scale_sources[o].kind == "few samples",
        )
        for o in problem.outputs
    ]
