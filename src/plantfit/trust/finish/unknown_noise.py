"""Outputs of few samples: what intervals may count on where residuals do not show how large an output's errors are."""

import numpy as np

from plantfit.problem.measure.scale_source import ScaleSource
from plantfit.problem.problem import Problem

LEAST_FREE = 8.0  # independent samples beyond the parameters, below which intervals are too short
NOTHING = 1e9  # spreads of an output that count as 1: its samples say nothing
FEW = "few samples"


def unknown_noise(problem: Problem) -> tuple[str, ...]:
    """The outputs that can be followed exactly, and whose errors neither residuals nor the user tell."""
    return tuple(o for o in problem.outputs if problem.scale_sources[o].kind == FEW)


def as_known(problem: Problem) -> Problem:
    """The problem that intervals are made of: samples whose errors nobody knows fix nothing."""
    names = unknown_noise(problem)
    return problem.with_scales({o: NOTHING * _size(problem, o) for o in names}, ScaleSource(FEW)) if names else problem


def few_samples(problem: Problem) -> frozenset[str]:
    """The outputs with no more samples than there are free parameters: their residuals may be nothing whatever their
    errors are."""
    counts = {o: sum(len(own[o]) for own in problem.data["index"].values()) for o in problem.outputs}
    return frozenset(o for o, n in counts.items() if n <= problem.space.dimension)


def rest_on_it(problem: Problem, jacobian: np.ndarray) -> np.ndarray:
    """Which coordinates (d,) move an output of unknown noise, by the derivatives (m, d) of the residuals."""
    silent, start, found = unknown_noise(problem), 0, np.zeros(jacobian.shape[1], dtype=bool)
    for name in problem.data["drive"]:
        for output in problem.outputs:
            count = len(problem.data["index"][name][output])
            if output in silent:
                found |= np.any(jacobian[start : start + count] != 0.0, axis=0)
            start += count
    return found


def _size(problem: Problem, output: str) -> float:
    y = np.concatenate([own[output] for own in problem.data["measured"].values()])
    return float(np.std(y)) or float(np.max(np.abs(y), initial=0.0)) or 1.0
