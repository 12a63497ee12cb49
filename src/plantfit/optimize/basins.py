"""Which local searches ended in the same place: bookkeeping for multi-start methods."""

from typing import Any

import numpy as np

from plantfit.optimize.local import Found


class Basins:
    """Counts local searches and how many independent ones reached the best cost.

    Two costs are the same when they agree to `relative` of the best, or to `floor` (a perfect fit has
    cost 0, to which nothing is relative). Keeps `starts`, `skipped_starts`, `basin_hits` and
    `local_costs` up to date in `extra`.
    """

    def __init__(self, extra: dict[str, Any], relative: float = 1e-6, floor: float = 1e-20):
        self.extra, self.relative, self.floor = extra, relative, floor
        self.extra.update(starts=0, skipped_starts=0, basin_hits=0, local_costs=[])
        self._independent: list[float] = []

    @property
    def hits(self) -> int:
        return self.extra["basin_hits"]

    @property
    def searches(self) -> int:
        return self.extra["starts"]

    def add(self, found: Found, independent: bool = True) -> None:
        """Book a local search; one that began near the best point is not `independent` evidence."""
        if not found.started:
            self.extra["skipped_starts"] += 1
            return
        costs = self.extra["local_costs"]
        costs.append(float(found.cost))
        self.extra["starts"] += 1
        if independent:
            self._independent.append(float(found.cost))
        best = min(costs)
        same = best + self.relative * abs(best) + self.floor
        self.extra["basin_hits"] = int(np.sum(np.asarray(self._independent) <= same))
