"""Which local searches ended in the same place: bookkeeping for multi-start methods."""

from typing import Any

import numpy as np

from plantfit.optimize.local.one_search import Found

ELSEWHERE, FAR = 8, 0.05  # points of the best cost that are kept, and how far apart they are in the cube
NEARLY = 1.5  # times the best cost up to which the ends of searches are kept: noise may have put another optimum lowest
DOUBT = 0.1  # share of the box that may be unseen when the budget ends a run that is called converged


class Basins:
    """Counts local searches and how many independent ones reached the best cost.

    Two costs are the same when they agree to `relative` of the best, or to `floor` (a perfect fit has cost 0, to which
    nothing is relative). The best cost is that of all searches, also of one that was cut off: hits are counted against
    the answer that is returned. Only a search that came to its own end is evidence; one that a limit of steps or the
    budget cut off is not.

    Keeps in `extra`: `starts` (searches that came to their end), `cut_searches`, `skipped_starts` (points that could
    not be simulated), `basin_hits` (independent searches that ended at the best cost), `optima` (different costs at
    which independent searches ended), `unseen`, `local_costs` (of the searches that ended), `basin_cost` (the lowest of
    all), `elsewhere` (points (d,) of the best cost that are far from the best point and from each other), `nearly`
    (points (d,) like these where searches ended at other costs, up to half as much again).
    """

    def __init__(self, extra: dict[str, Any], relative: float = 1e-6, floor: float = 1e-20):
        self.extra, self.relative, self.floor = extra, relative, floor
        self.extra.update(
            starts=0,
            cut_searches=0,
            skipped_starts=0,
            basin_hits=0,
            optima=0,
            unseen=1.0,
            local_costs=[],
            elsewhere=[],
            nearly=[],
        )
        self._independent: list[float] = []
        self._ends: list[tuple[float, np.ndarray]] = []
        self._cut: list[float] = []
        self._unknown = 0  # independent searches that were cut off
        self._kept_for: Any = None  # on what `elsewhere` and `nearly` depend

    @property
    def hits(self) -> int:
        return self.extra["basin_hits"]

    @property
    def searches(self) -> int:
        return self.extra["starts"]

    @property
    def several(self) -> bool:
        """Whether independent searches ended in more than one optimum."""
        return self.extra["optima"] > 1

    @property
    def best(self) -> float:
        """The lowest cost of all searches, cut ones too."""
        return min([*self.extra["local_costs"], *self._cut], default=np.inf)

    @property
    def unseen(self) -> float:
        """Expected share of the box from which a search would end in an optimum that none has found yet.

        Each independent search that was cut off may be on its way to an optimum of its own, and counts as one.
        """
        return self._share(self._unknown)

    def _share(self, unknown: int) -> float:
        """w (w + 1) / (n (n - 1)) after n independent searches that ended in w optima: Boender and Rinnooy Kan 1987,
        Mathematical Programming 37:59, eq. 14 (Bayes with a uniform prior on number and shares of the optima)."""
        n, w = len(self._independent) + unknown, self.extra["optima"] + unknown
        return min(1.0, w * (w + 1) / (n * (n - 1))) if n > 1 else 1.0

    @property
    def best_ended(self) -> float:
        """The lowest cost of the searches that came to their end."""
        return min(self.extra["local_costs"], default=np.inf)

    def agreed(self, agree: int, searches: int = 0, unseen: float = 1.0) -> bool:
        """Whether so many independent searches, of so many or more, ended at the best cost of all, with nothing cut
        off below it and no more than this share, or `DOUBT`, unseen."""
        seen = self.extra["optima"] < 2 or self.unseen <= max(unseen, DOUBT)
        return self.hits >= agree and self.searches >= searches and seen

    def enough(self, agree: int, searches: int = 0, unseen: float = 1.0) -> bool:
        """Whether, of the searches that ended, so many agree on their best cost, of so many or more, and at most this
        share is unseen.

        A search that was cut off below that cost is not looked at here: whoever asks has to let it go on first.
        """
        seen = self.extra["optima"] < 2 or self._share(0) <= unseen
        return self._at(self.best_ended) >= agree and self.searches >= searches and seen

    def add(self, found: Found, independent: bool = True) -> None:
        """Book a local search; one that began near the best point is not `independent` evidence."""
        if not found.started:
            self.extra["skipped_starts"] += 1
            return
        if found.finished:
            self.extra["starts"] += 1
            self.extra["local_costs"].append(float(found.cost))
            self._ends.append((float(found.cost), np.asarray(found.x, dtype=float)))
            if independent:
                self._independent.append(float(found.cost))
        else:
            self.extra["cut_searches"] += 1
            self._cut.append(float(found.cost))
            self._unknown += independent
        self._count()

    def reopen(self, cost: float, independent: bool = True) -> None:
        """A search that was cut off at this cost goes on."""
        self._cut.remove(float(cost))
        self._unknown -= independent
        self.extra["cut_searches"] -= 1
        self._count()

    def _same(self, best: float) -> float:
        """Up to which cost another one is the same as this."""
        return best + self.relative * abs(best) + self.floor if np.isfinite(best) else -np.inf

    def _at(self, best: float) -> int:
        """Independent searches that ended at this cost."""
        return int(np.sum(np.asarray(self._independent) <= self._same(best)))

    def _apart(self, most: float) -> list[list[float]]:
        """The points of at most this cost that are far from the best of them and from each other."""
        apart: list[np.ndarray] = []
        for _, x in sorted((end for end in self._ends if end[0] <= most), key=lambda end: end[0]):
            if len(apart) <= ELSEWHERE and all(np.max(np.abs(x - other)) > FAR for other in apart):
                apart.append(x)
        return [x.tolist() for x in apart[1:]]

    def _count(self) -> None:
        ended = np.sort(self._independent)
        apart = np.diff(ended) > self.relative * np.abs(ended[1:]) + self.floor
        self.extra["basin_hits"] = self._at(self.best)
        self.extra["optima"] = int(np.sum(apart)) + (len(ended) > 0)
        self.extra["unseen"] = self.unseen
        if np.isfinite(self.best):
            self.extra["basin_cost"] = self.best
        # most searches that are booked or go on were cut off, and change none of these points
        if self._kept_for == (kept_for := (len(self._ends), self.best, self._same(self.best))):
            return
        self._kept_for = kept_for
        self.extra["elsewhere"] = self._apart(self._same(self.best))
        self.extra["nearly"] = [x for x in self._apart(NEARLY * self.best) if x not in self.extra["elsewhere"]]
