"""What tuning found, in numbers, words and a block for the study file."""

import json
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from plantfit.study.comparing.pairwise import compare
from plantfit.study.comparing.statistics import ratio_interval

TIE = 1e-6  # costs this near, relatively, count as equal; evaluations then decide
LEVEL = 0.05
SLIGHT = 1.05  # ratio of costs below which a difference is told in percent
SMALLEST = 1e-300


@dataclass(frozen=True)
class Finish:
    """How a run ended: final cost, and evaluations until it came within TIE of that cost."""

    cost: float
    reached: float

    def score(self, budget: int) -> float:
        """The cost, raised by at most a TIE of itself for a late arrival: one number that breaks ties. inf if
        failed."""
        if not np.isfinite(self.cost):
            return np.inf
        return self.cost + TIE * max(abs(self.cost), SMALLEST) * self.reached / budget


def finish(cost: float, history_evaluations: np.ndarray, history_cost: np.ndarray) -> Finish:
    """A run from its final cost and its best cost (k,) after so many evaluations (k,)."""
    if not np.isfinite(cost):
        return Finish(np.inf, np.inf)
    near = np.flatnonzero(np.asarray(history_cost) <= cost + TIE * abs(cost))
    return Finish(float(cost), float(np.asarray(history_evaluations)[near[0] if len(near) else -1]))


@dataclass(frozen=True)
class Trial:
    """Settings that were tried; `runs` seeds were spent on them, `median` is of the final costs of these."""

    settings: dict[str, Any]
    runs: int
    median: float
    dropped: bool


@dataclass(frozen=True)
class Contest:
    """Tuned against default settings on `runs` fresh seeds.

    `a12` is the probability that a tuned run ends better than a default one (0.5 is a draw), `p` the two-sided
    Mann-Whitney p value; both count equal costs by evaluations. `ratio` is median default over median tuned cost
    with a 95 % bootstrap interval, NaN where a median is not above zero; `evaluations_ratio` likewise the medians
    of the evaluations until the final cost.
    """

    runs: int
    tuned_median: float
    default_median: float
    a12: float
    p: float
    ratio: float
    ratio_interval: tuple[float, float]
    evaluations_ratio: float

    @property
    def pays(self) -> bool:
        """Whether tuned runs end better beyond chance."""
        return self.p < LEVEL and self.a12 > 0.5

    @property
    def tied(self) -> bool:
        """Whether the typical costs are equal."""
        gap = abs(self.default_median - self.tuned_median)
        return self.default_median == self.tuned_median or gap <= TIE * min(
            abs(self.default_median), abs(self.tuned_median)
        )


def contest(tuned: list[Finish], default: list[Finish], budget: int, seed: int) -> Contest:
    """Compare two lists of runs, at least two each."""
    scores = {name: [f.score(budget) for f in runs] for name, runs in (("tuned", tuned), ("default", default))}
    pair = compare(scores)[0]
    costs = [np.array([f.cost for f in runs]) for runs in (default, tuned)]
    medians = [float(np.median(c)) for c in costs]
    late = [float(np.median([f.reached for f in runs])) for runs in (default, tuned)]
    ratio = _ratio(*medians)
    interval = ratio_interval(*costs, seed=seed) if np.isfinite(ratio) else (float("nan"), float("nan"))
    return Contest(len(tuned), medians[1], medians[0], 1 - pair.a12, pair.p, ratio, interval, _ratio(*late))


@dataclass(frozen=True)
class Tuned:
    """The best settings of a method on a problem and what they are worth.

    `best` and `default` hold the settings that were tuned; `dials` say over which values. `search_runs` and
    `fresh_runs` are the (first, last) run numbers of the seed on which settings were chosen and compared;
    they share none. `contest` is None when the default was best or the user stopped before it.
    """

    method: str
    outer: str
    best: dict[str, Any]
    default: dict[str, Any]
    dials: list[dict[str, Any]]
    trials: list[Trial]
    contest: Contest | None
    interrupted: bool
    budget: int
    seed: int
    search_runs: tuple[int, int]
    fresh_runs: tuple[int, int]
    evaluations: float
    seconds: float

    @property
    def pays(self) -> bool:
        """Whether the tuned settings were shown to be better."""
        return self.contest is not None and self.contest.pays

    @property
    def sentence(self) -> str:
        """What came out, for a person."""
        tried = f"{len(self.trials)} setting{'s' if len(self.trials) != 1 else ''}"
        if not self.trials:
            return f"Stopped before the default settings of {self.method} were measured; nothing was learnt."
        if self.interrupted:
            what = "the default is still the best" if self.best == self.default else "the best so far is kept"
            return f"Stopped after {tried}: {what}, not yet compared on fresh seeds."
        if self.contest is None:
            return (
                f"None of {tried} was better than the default of "
                f"{self.method} on the seeds of the search: keep the default."
            )
        return _verdict(self.method, self.contest)

    def toml(self) -> str:
        """A block for the study file; values that did not prove better stand in comments."""
        head = [
            f"# plantfit tune-search: {self.method} tuned by {self.outer}, "
            f"{len(self.trials)} settings, seed {self.seed}, {self.budget} evaluations a run",
            f"# {self.sentence}",
            f"[search.settings.{self.method}]",
        ]
        silent = "" if self.pays or self.interrupted else "# "
        values = [f"{silent}{name} = {json.dumps(value)}" for name, value in self.best.items() if value is not None]
        return "\n".join([*head, *values]) + "\n"

    def record(self) -> dict[str, Any]:
        """Everything as JSON types, with the sentence and the block."""
        found = asdict(self)
        found.update(pays=self.pays, sentence=self.sentence, toml=self.toml())
        return found


def _verdict(method: str, c: Contest) -> str:
    share = f"A12 {c.a12:.2f}, p {c.p:.2g}, {c.runs} fresh seeds"
    if c.tied and not np.isfinite(c.evaluations_ratio):
        outcome = f"ends at the same cost as the default ({share})"
    elif c.tied:
        how, many = ("fewer", c.evaluations_ratio) if not c.evaluations_ratio < 1 else ("more", 1 / c.evaluations_ratio)
        outcome = f"ends at the same cost as the default with {many:.2g} times {how} evaluations ({share})"
    elif np.isfinite(c.ratio):
        how, many = ("lower", c.ratio) if c.ratio > 1 else ("higher", 1 / c.ratio)
        low, high = c.ratio_interval if c.ratio > 1 else (1 / c.ratio_interval[1], 1 / c.ratio_interval[0])
        size = "{} % {}" if many < SLIGHT else "{} times {}"
        told = _percent if many < SLIGHT else _times
        outcome = (
            f"ends {size.format(told(many), how)} than the default (95 % interval {told(low)} to {told(high)}, {share})"
        )
    else:
        outcome = f"ends at a median cost of {c.tuned_median:.4g}, the default at {c.default_median:.4g} ({share})"
    if c.pays:
        return f"Tuned {method} {outcome}: use it."
    if c.p < LEVEL:
        return f"Tuned {method} {outcome}: it was lucky in the search, keep the default."
    return f"No gain beyond chance: tuned {method} {outcome}; keep the default."


def _percent(ratio: float) -> str:
    return f"{100 * (ratio - 1):.2g}"


def _times(ratio: float) -> str:
    return f"{ratio:.3g}" if ratio < 999.5 else f"{ratio:.2g}"


def _ratio(above: float, below: float) -> float:
    return above / below if 0 < above < np.inf and 0 < below < np.inf else float("nan")
