"""Many local least-squares searches side by side: which begin, which go on, and when enough of them agree."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from plantfit.errors import Status
from plantfit.optimize.local.basins import Basins
from plantfit.optimize.local.damped_steps import Lanes, Rows
from plantfit.optimize.local.one_search import Found
from plantfit.optimize.local.rungs import FIRST, Rungs
from plantfit.optimize.loop.counter import BudgetSpent, Counter

WIDTH = (
    8  # searches side by side unless told otherwise: beyond it a step gains little and a small budget is spread thin
)
REACH = 30  # a search begins beside others only when each may take so many steps
AGAIN = 0.1  # share of the steps for searches that were set aside


class Start(NamedTuple):
    """Where a search begins: cube point (d,), whether it is independent evidence, and whether the user asked for it."""

    x: np.ndarray
    independent: bool = True
    asked: bool = False


def project(counter: Counter, solve_linear: str) -> bool:
    """Let the counter solve for what the residuals are affine in; whether there is any of it.

    `solve_linear` "no" leaves it to the search.
    """
    objective = counter.objective
    if solve_linear == "yes" and objective.projected is not None and objective.separable is None:
        counter.projected = objective.projected()
    counter.extra["solved_for"] = 0 if counter.projected is None else objective.dimension - len(counter.projected.kept)
    return counter.projected is not None


def solved_at_once(counter: Counter, basins: Basins) -> bool:
    """Whether nothing is left to search because the residuals are affine in all coordinates; the answer is then
    booked."""
    if counter.projected is None or len(counter.projected.kept):
        return False
    rows = counter.projected_rows(np.zeros((1, 0)))
    basins.add(
        Found(rows.points[0], float(rows.squares[0] / rows.r.shape[1]), started=bool(np.isfinite(rows.squares[0])))
    )
    counter.extra["linear"] = True
    return basins.searches > 0


def one_after_another(
    counter: Counter,
    starts: Iterator[Start],
    search: Callable[[np.ndarray, int], Found],
    basins: Basins,
    *,
    agree: int,
    max_steps: int,
    searches: int = 0,
    unseen: float = 1.0,
) -> Status:
    """Run `search(x, steps)` from one start after another until enough agree (`Basins.enough`).

    A search that was cut off goes on before an answer above it is called converged, and when `agree` of them stand
    below all that ended: then searches need more steps here, and later ones get them. One that the user asked for goes
    on at once.
    """
    try:
        _until_enough(starts, search, basins, agree, max_steps, searches, unseen)
    except BudgetSpent:
        if counter.best_cost < basins.best:
            basins.add(Found(counter.best_x, counter.best_cost, finished=False), independent=False)
    return Status.converged if basins.agreed(agree, searches, unseen) else Status.budget


def _until_enough(
    starts: Iterator[Start], search: Callable[[np.ndarray, int], Found], basins: Basins, agree: int, max_steps: int,
    searches: int,
    unseen: float,
) -> None:  # fmt: skip
    aside: list[tuple[Found, int, bool]] = []
    for start in starts:
        found, steps = search(start.x, max_steps), max_steps
        while start.asked and found.started and not found.finished:
            steps *= 2
            found = search(found.x, steps)
        basins.add(found, start.independent)
        if found.started and not found.finished:
            aside.append((found, steps, start.independent))
        while aside and (basins.enough(agree, searches, unseen) or len(aside) >= agree):
            best = min(range(len(aside)), key=lambda k: aside[k][0].cost)
            if aside[best][0].cost > basins.best_ended:
                break
            last, steps, independent = aside.pop(best)
            basins.reopen(last.cost, independent)
            max_steps = max(max_steps, 2 * steps)
            found = search(last.x, 2 * steps)
            basins.add(found, independent)
            if not found.finished:
                aside.append((found, 2 * steps, independent))
        if basins.enough(agree, searches, unseen):
            return


@dataclass
class LocalSearches:
    """Searches from `starts`, `width` at a time but no more than are wanted; one that ends makes room for the next.

    No start is admitted any more once `agree` independent searches ended at the best cost, of `searches` or more, and
    the share of the box whose optimum none has seen is below `unseen` (`Basins.enough`). What was admitted is run to
    its end all the same: the searches that end first are those on plateaus. Once several optima are known, a search is
    set aside where it falls behind the others (`Rungs`), in any case after `max_steps`, never one that the user asked
    for. Of those that fell behind the best one goes on for a share of the steps, and all of them before the search
    converges. The best of those that took `max_steps` goes on when everything else has ended and none of that is
    better, and when `agree` of them stand below all that ended: then searches need more steps here, and later ones get
    them.
    """

    counter: Counter
    starts: Iterator[Start]
    basins: Basins
    agree: int
    max_steps: int
    searches: int = 0
    unseen: float = 1.0
    width: int = WIDTH
    aside: list[Lanes] = field(default_factory=list)  # after `max_steps`
    behind: list[Lanes] = field(default_factory=list)
    rungs: Rungs = field(default_factory=Rungs)
    # of searches once set aside, and of others
    steps: dict[bool, int] = field(default_factory=lambda: {False: 0, True: 0})

    def run(self) -> Status:
        """Converged when enough searches agree on the answer; where the budget ends them first, as `Basins.agreed`
        says."""
        lanes: Lanes | None = None
        try:
            while True:
                lanes = self._admit(lanes)
                if not len(lanes):
                    if not self._aside_is_better():
                        return Status.converged
                    lanes = self._reopen()
                lanes = self._afford(lanes)
                lanes = self._step(lanes)
        except BudgetSpent:
            for k in range(0 if lanes is None else len(lanes)):
                self._book(lanes[np.array([k])], finished=False)  # pyrefly: ignore[unsupported-operation]
            return Status.converged if self.basins.agreed(self.agree, self.searches, self.unseen) else Status.budget

    @property
    def _charge(self) -> float:
        projected = self.counter.projected
        return self.counter.objective.jacobian_charge if projected is None else projected.charge

    def _evaluate(self, x: np.ndarray, below: np.ndarray | None = None) -> Rows:
        counter = self.counter
        return counter.rows(x, self.width) if counter.projected is None else counter.projected_rows(x, below)

    def _admit(self, lanes: Lanes | None) -> Lanes:
        """The lanes with others beside them, where there is room and more are wanted."""
        while not self._enough() or self.behind:
            under_way = 0 if lanes is None else len(lanes)
            most = min(
                self.width, max(self.agree, self.searches), max(1, int(self.counter.remaining / (REACH * self._charge)))
            )
            room = most - under_way
            if lanes is not None and room <= 0:
                break
            begun = self._next(max(room, 1))
            lanes = begun if lanes is None else lanes.join(begun)
        assert lanes is not None
        return lanes

    def _next(self, room: int) -> Lanes:
        """One that was set aside, or as many new ones as there is room for."""
        if self.behind and (self._enough() or self.steps[True] < AGAIN * sum(self.steps.values())):
            lane = self._best_of(self.behind)
            lane.most = np.minimum(2 * lane.most, self.max_steps)
            return lane
        if len(self.aside) >= self.agree and self._aside_is_better():
            return self._reopen()
        return self._begin(room)

    def _enough(self) -> bool:
        return self.basins.enough(self.agree, self.searches, self.unseen)

    def _begin(self, count: int) -> Lanes:
        """The next `count` starts, without those that cannot be simulated."""
        points, independent, asked = zip(*(next(self.starts) for _ in range(count)), strict=True)
        x = np.clip(np.stack(points), 0.0, 1.0)
        if self.counter.projected is not None:
            x = x[:, self.counter.projected.kept]
        begun = Lanes.begin(
            x, self._evaluate(x), np.asarray(independent), np.asarray(asked), min(FIRST, self.max_steps)
        )
        works = np.isfinite(begun.squares)
        for failed in x[~works]:
            self.basins.add(Found(failed, np.inf, started=False))
        return begun[works]

    def _afford(self, lanes: Lanes) -> Lanes:
        """The lanes for whose next step the budget lasts, those asked for and the best ones; the others are cut off."""
        affordable = max(1, int(self.counter.remaining / self._charge))
        if affordable >= len(lanes):
            return lanes
        order = np.lexsort((lanes.squares, ~lanes.asked))
        for k in order[affordable:]:
            self._book(lanes[np.array([k])], finished=False)
        return lanes[np.sort(order[:affordable])]

    def _step(self, lanes: Lanes) -> Lanes:
        """One step of every lane; those that are still under way."""
        step, promised = lanes.propose()
        trial = np.clip(lanes.x + step, 0.0, 1.0)
        ended = lanes.take(promised, trial, self._evaluate(trial, lanes.squares / lanes.r.shape[1]))
        for once in (False, True):
            self.steps[once] += int(np.sum(lanes.again == once))
        for k in np.flatnonzero(ended):
            one = lanes[np.array([k])]
            self._book(one, finished=True)
            self.rungs.ended(int(one.steps[0]), self._cost(one))
        late = np.flatnonzero(~ended & (lanes.steps >= lanes.most))
        stays = ended.copy()
        stays[late[~self._pass(lanes, late)]] = True
        for k in np.flatnonzero(stays & ~ended):
            one = lanes[np.array([k])]
            (self.aside if one.steps[0] >= self.max_steps else self.behind).append(one)
            self._book(one, finished=False)
        return lanes[~stays]

    def _pass(self, lanes: Lanes, late: np.ndarray) -> np.ndarray:
        """Which of the lanes `late` (n,), at their limits, go on; these are then doubled."""
        passed, cost, mark = (
            np.zeros(len(late), dtype=bool),
            lanes.squares / lanes.r.shape[1],
            lanes.mark / lanes.r.shape[1],
        )
        for rung in np.unique(lanes.steps[late]):
            here = lanes.steps[late] == rung
            if rung < self.max_steps:
                at = late[here]
                good = self.rungs.arrived(int(rung), cost[at], mark[at])
                passed[here] = good | (not self.basins.several) | (cost[at] <= self.basins.best_ended) | self._enough()
        on = late[passed]
        lanes.mark[on], lanes.most[on] = lanes.squares[on], np.minimum(2 * lanes.most[on], self.max_steps)
        return passed

    def _cost(self, lane: Lanes) -> float:
        return float(lane.squares[0] / lane.r.shape[1])

    def _book(self, lane: Lanes, *, finished: bool) -> None:
        self.basins.add(Found(lane.points[0], self._cost(lane), finished=finished), bool(lane.independent[0]))

    def _aside_is_better(self) -> bool:
        """Whether a search that was set aside may hold the answer: it stands no higher than the best of those that
        ended."""
        return bool(self.aside) and min(map(self._cost, self.aside)) <= self.basins.best_ended

    def _reopen(self) -> Lanes:
        """The best of those that took `max_steps`, with twice as many."""
        lane = self._best_of(self.aside)
        lane.most = 2 * lane.most
        self.max_steps = max(self.max_steps, int(lane.most[0]))
        return lane

    def _best_of(self, among: list[Lanes]) -> Lanes:
        """Taken from those that were set aside."""
        lane = among.pop(min(range(len(among)), key=lambda k: self._cost(among[k])))
        self.basins.reopen(self._cost(lane), bool(lane.independent[0]))
        lane.mark, lane.again = lane.squares.copy(), np.array([True])
        return lane
