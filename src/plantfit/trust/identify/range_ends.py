"""What the data determine where ranges end: what holds at the answer alone is no statement about the data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate import points
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.parameter_rows import ROUGH
from plantfit.trust.intervals.ranges import Linear, Range

FAR = 100.0  # sizes of a value that nothing moves further than: a factor of a sum has few digits


def free_inverse(rows: np.ndarray) -> np.ndarray:
    """The inverse (d, d) of R' R of rows R (k, d)."""
    _, singular, right = np.linalg.svd(rows, full_matrices=False)
    return (right.T / singular**2) @ right


@dataclass(frozen=True)
class EndPoint:
    """A point of about the answer's cost: values (d,), their `size` (d,), and `rows` (k, d) of derivatives by relative
    changes of these over the noise, as those of `Linear`."""

    values: np.ndarray
    size: np.ndarray
    rows: np.ndarray

    def known(self, weights: np.ndarray, held: Sequence[int] = ()) -> bool:
        """Whether the sum of relative changes with these weights (d,) is determined here, coordinates `held` at what
        they are."""
        kept = [i for i in range(len(weights)) if i not in held]
        if not np.all(np.isfinite(self.rows)):
            return False
        # by the inverse itself, of which open directions make entries large, what is known would be rounding
        _, singular, right = np.linalg.svd(self.rows[:, kept], full_matrices=False)
        return bool(np.linalg.norm(right @ weights[kept] / singular) <= ROUGH)


class Ends:
    """Where ranges end: the points that were met with the least and the largest value of a parameter.

    What holds at the answer alone is no statement about the data: another parameter may do there what it does not do
    here, as a friction of nearly zero.
    """

    def __init__(self, problem: Problem, linear: Linear, ranges: Mapping[int, Range]):
        self.problem, self.linear, self.ranges = problem, linear, ranges
        self.kept: dict[int, list[EndPoint]] = {}

    def of(self, k: int) -> list[EndPoint]:
        """Those of coordinate k; none where its range was not followed."""
        if k not in self.kept:
            met = self.ranges[k].points if k in self.ranges else []
            ends = [choose(met, key=lambda z: float(z[k])) for choose in (min, max)] if met else []
            self.kept[k] = [self._at(z) for z in ends]
        return self.kept[k]

    def _at(self, z: np.ndarray) -> EndPoint:
        values = np.asarray(self.problem.space.physical(z))
        residuals, jacobian = points.compressed(self.problem, z)
        scale = np.sqrt(sum(self.problem.parts.counts.values()) / len(residuals) / self.linear.variance)
        size = np.maximum(self.linear.size, np.abs(values))
        rows = np.vstack([jacobian / self.problem.space.slopes(z) * size * scale, np.eye(len(size)) / FAR])
        return EndPoint(values, size, rows)
