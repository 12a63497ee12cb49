"""Morris screening: which groups of parameters the cost reacts to, from few evaluations, around a point or in the
whole box."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from plantfit.errors import SearchError
from plantfit.findings.results.sensitivity import ElementaryEffect, Sensitivities
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
class Screening:
    """Elementary effects by group, in units of the cost over the whole width of the box that was looked at.

    `mu_star` (g,): mean of their absolute values, `half_width` of its bootstrap interval; `mu` their mean and `sigma`
    their standard deviation, which groups of several coordinates do not have (nan, as in SALib). `dropped` of
    `trajectories` held a run that failed.
    """

    groups: tuple[str, ...]
    sizes: tuple[int, ...]  # coordinates in each group
    mu_star: np.ndarray
    half_width: np.ndarray
    mu: np.ndarray
    sigma: np.ndarray
    trajectories: int
    dropped: int
    evaluations: int
    radius: float | None
    confidence: float

    @property
    def typed(self) -> Sensitivities:
        """The same as a record."""
        rows = zip(self.groups, self.sizes, self.mu_star, self.half_width, self.mu, self.sigma, strict=True)
        return Sensitivities(
            method="morris", radius=self.radius, confidence=self.confidence, evaluations=self.evaluations,
            trajectories=self.trajectories, dropped=self.dropped,
            groups=[
                ElementaryEffect(group=g, coordinates=n, mu_star=float(star), half_width=float(half), mu=float(mu),
                                 sigma=float(sigma))
                for g, n, star, half, mu, sigma in rows
            ],
        )  # fmt: skip


def morris(
    problem: Costed,
    at: Any = None,
    *,
    radius: float | None = 0.01,
    groups: Groups | None = None,
    trajectories: int = 20,
    pool: int = 100,
    levels: int = 4,
    confidence: float = 0.95,
    resamples: int = 1000,
    seed: int = 1,
    progress: Callable[[Any], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Screening:
    """Elementary effects of groups of coordinates on the cost, `at` +- `radius` of the cube's edge, clipped to it
    (None: the whole cube).

    Of `pool` random trajectories on a grid of `levels` the `trajectories` that lie farthest apart are walked; each
    changes one group after the other. A trajectory with a run that failed is left out whole. `at` (d,) is the middle
    where it is left out.

    Sampling and analysis are SALib's (T. Iwanaga, W. Usher, J. Herman, SESMO 4 (2022) 18155): M. Morris, Technometrics
    33 (1991) 161; groups and mu*: F. Campolongo, J. Cariboni, A. Saltelli, Env. Modelling & Software 22 (2007) 1509;
    choice of trajectories: M. Ruano et al., Env. Modelling & Software 37 (2012) 103. Raises SpaceError, SearchError,
    MissingExtra, Interrupted.
    """
    need_salib()
    from SALib.analyze import morris as analyze

    whole_number("trajectories", trajectories, 2)
    whole_number("pool", pool, trajectories + 1)
    whole_number("levels", levels, 2)
    whole_number("resamples", resamples, 2)
    check_confidence(confidence)
    if levels % 2:
        raise SearchError(f"levels = {levels}; give an even number, such as 4.")
    box = box_around(problem.space, at, radius, groups)
    design = box.design(problem.space.names)
    _, resampling = np.random.default_rng(seed).spawn(2)
    rows = _walks(box.groups, trajectories, pool, levels, seed) * (box.high - box.low) + box.low
    costs = costs_at(problem, box.points(rows), progress, stop)
    walk = len(box.names) + 1
    kept = np.all(np.isfinite(costs.reshape(-1, walk)), axis=1)
    if np.sum(kept) < 2:
        raise SearchError(
            f"Only {np.sum(kept)} of {trajectories} trajectories ran without "
            "a failure; narrow radius, or look at it where the model runs."
        )
    rows, costs = rows[np.repeat(kept, walk)], costs[np.repeat(kept, walk)]
    found = analyze.analyze(
        design, rows, costs, num_levels=levels, num_resamples=resamples, conf_level=confidence, seed=resampling
    )
    mu_star, half, mu, sigma = (
        np.asarray(np.ma.filled(found[k], np.nan), dtype=float) for k in ("mu_star", "mu_star_conf", "mu", "sigma")
    )
    sizes = tuple(box.groups.count(name) for name in box.names)
    names = tuple(str(n) for n in found["names"])
    dropped = int(trajectories - np.sum(kept))
    return Screening(
        names, sizes, mu_star, half, mu, sigma, trajectories, dropped, trajectories * walk, radius, confidence
    )


@lru_cache(maxsize=4)
def _walks(groups: tuple[str, ...], trajectories: int, pool: int, levels: int, seed: int) -> np.ndarray:
    """Rows of the chosen trajectories in a box from 0 to 1, one coordinate for each of `groups`; they are the same
    around every point."""
    from SALib.sample import morris as sample

    count = len(groups)
    unit = {
        "num_vars": count,
        "names": [f"x{i}" for i in range(count)],
        "groups": list(groups),
        "bounds": [(0.0, 1.0)] * count,
    }
    draws, _ = np.random.default_rng(seed).spawn(2)
    rows = sample.sample(unit, pool, num_levels=levels, optimal_trajectories=trajectories, seed=draws)
    rows.flags.writeable = False
    return rows
