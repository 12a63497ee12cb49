"""Which local searches go on: after 6, 12, 24, ... steps each is compared with all that came so far.

Searches that lead to the best of many optima are among the best after few steps, as a rule; most steps go into slow
descents to high costs (docs/search-suite.md). Successive halving without waiting: Li and others 2020, Proceedings of
MLSys 2:230.
"""

from dataclasses import dataclass, field

import numpy as np

FIRST = 6  # steps
PASS = 0.2  # share of the searches, the best ones, that go on
FALLING = 0.2  # of its cost at the rung before: a search that has come below it goes on
FEW = 8  # searches to compare with, below which all go on


@dataclass
class Rungs:
    """Costs of searches after as many steps; of one that ended before, its last one."""

    costs: dict[int, list[float]] = field(default_factory=dict)
    ends: list[tuple[int, float]] = field(default_factory=list)

    def ended(self, steps: int, cost: float) -> None:
        """Note a search that came to its end after so many steps."""
        self.ends.append((steps, cost))
        for rung, costs in self.costs.items():
            if rung >= steps:
                costs.append(cost)

    def arrived(self, rung: int, costs: np.ndarray, before: np.ndarray) -> np.ndarray:
        """Which of the searches that arrive at a rung go on (n,), by their costs and those at the rung before (n,)."""
        seen = self.costs.setdefault(rung, [cost for steps, cost in self.ends if steps <= rung])
        seen.extend(float(c) for c in costs)
        return (costs <= np.quantile(seen, PASS)) | (costs <= FALLING * before) | (len(seen) < FEW)
