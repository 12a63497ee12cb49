"""Sobol indices: which share of the variance of the cost comes from which group of parameters."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import SearchError
from plantfit.findings.results.sensitivity import Sensitivities, VarianceShare
from plantfit.trust.sensitivity.salib_extra import need_salib
from plantfit.trust.sensitivity.sampled_costs import (
    Costed,
    Groups,
    box_around,
    check_confidence,
    costs_at,
    whole_number,
)


@dataclass(frozen=True)
class SobolIndices:
    """Shares of the variance of the cost by group (g,), for coordinates that are uniform over the box that was looked
    at.

    `first`: by the group alone; `total`: with all its interactions; each with the half width of its bootstrap interval.
    `dropped` of `samples` held a run that failed, so that the indices are those of the part of the box that runs.
    """

    groups: tuple[str, ...]
    sizes: tuple[int, ...]  # coordinates in each group
    first: np.ndarray
    first_half_width: np.ndarray
    total: np.ndarray
    total_half_width: np.ndarray
    samples: int
    dropped: int
    evaluations: int
    radius: float | None
    confidence: float

    @property
    def typed(self) -> Sensitivities:
        """The same as a record."""
        rows = zip(
            self.groups, self.sizes, self.first, self.first_half_width, self.total, self.total_half_width, strict=True
        )
        return Sensitivities(
            method="sobol", radius=self.radius, confidence=self.confidence, evaluations=self.evaluations,
            samples=self.samples,
            dropped=self.dropped,
            groups=[
                VarianceShare(
                    group=g, coordinates=n, first=float(own), first_half_width=float(half), total=float(whole),
                    total_half_width=float(wide),
                )
                for g, n, own, half, whole, wide in rows
            ],
        )  # fmt: skip


def sobol_indices(
    problem: Costed,
    at: Any = None,
    *,
    radius: float | None = None,
    groups: Groups | None = None,
    samples: int = 1024,
    confidence: float = 0.95,
    resamples: int = 1000,
    seed: int = 1,
    progress: Callable[[Any], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> SobolIndices:
    """First-order and total indices of the cost over the cube, or over `at` +- `radius` of its edge, clipped to it.

    `samples` (a power of two) times (groups + 2) evaluations at scrambled Sobol points. A sample with a run that failed
    is left out with all its copies.

    Sampling and analysis are SALib's (T. Iwanaga, W. Usher, J. Herman, SESMO 4 (2022) 18155): A. Saltelli et al., Comp.
    Phys. Comm. 181 (2010) 259, table 2 (b) and (f). Raises SpaceError, SearchError, MissingExtra, Interrupted.
    """
    need_salib()
    from SALib.analyze import sobol as analyze
    from SALib.sample import sobol as sample

    whole_number("samples", samples, 2)
    whole_number("resamples", resamples, 2)
    check_confidence(confidence)
    if samples & (samples - 1):
        raise SearchError(
            f"samples = {samples} is no power of two; give {1 << (samples.bit_length() - 1)} or "
            f"{1 << samples.bit_length()}."
        )
    box = box_around(problem.space, at, radius, groups)
    design = box.design(problem.space.names)
    draws, resampling = np.random.default_rng(seed).spawn(2)
    rows = sample.sample(design, samples, calc_second_order=False, seed=draws)
    costs = costs_at(problem, box.points(rows), progress, stop)
    copies = len(box.names) + 2
    kept = np.all(np.isfinite(costs.reshape(-1, copies)), axis=1)
    costs = costs[np.repeat(kept, copies)]
    if np.sum(kept) < 2 or np.ptp(costs) == 0:
        reason = (
            f"only {np.sum(kept)} of {samples} samples ran without a failure"
            if np.sum(kept) < 2
            else "the cost is the same everywhere"
        )
        raise SearchError(
            f"No variance can be shared out: {reason}; look at a box where the model runs and the cost changes."
        )
    found = analyze.analyze(
        design, costs, calc_second_order=False, num_resamples=resamples, conf_level=confidence, seed=resampling
    )
    first, first_half, total, total_half = (
        np.asarray(found[k], dtype=float) for k in ("S1", "S1_conf", "ST", "ST_conf")
    )
    sizes = tuple(box.groups.count(name) for name in box.names)
    dropped = int(samples - np.sum(kept))
    return SobolIndices(
        box.names, sizes, first, first_half, total, total_half, samples, dropped, samples * copies, radius, confidence
    )
