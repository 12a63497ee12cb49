"""The best cost of every problem, how it was found and how often a single local search finds it; kept in truths.json.

`python -m benchmarks.search_suite.truths [NAME ...]` makes them anew: thousands of starts of Levenberg-Marquardt,
hundreds of scipy's trust-region search from uniform points, and differential evolution, which needs no start and no
derivatives.
"""

import argparse
import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy import optimize
from scipy.stats import beta

import plantfit as pf
from benchmarks.search_suite.case import Case
from benchmarks.search_suite.descents import descend, descend_many
from benchmarks.search_suite.study_files import StudyCase

PATH = Path(__file__).with_name("truths.json")
SAME = 1e-6  # relative excess of a cost up to which it is the best one
PERFECT = 1e-14  # share of the ordinary cost below which a fit is perfect
ENOUGH = 0.3  # share of starts that may succeed
HOPELESS = 0.45  # share among the first 50 that ends the measuring
SEED = 20_17


@dataclass(frozen=True)
class Share:
    """How many of so many local searches from uniform points ended at the best cost; `failed` starts could not be
    simulated."""

    starts: int
    reached: int
    failed: int
    evaluations: float  # mean of one search, 0 where it was not counted

    @property
    def share(self) -> float:
        return self.reached / self.starts

    @property
    def most(self) -> float:
        """Upper end of the one-sided 95 % interval of Clopper and Pearson (1934, Biometrika 26:404)."""
        return (
            float(beta.ppf(0.95, self.reached + 1, self.starts - self.reached)) if self.reached < self.starts else 1.0
        )


@dataclass(frozen=True)
class Truth:
    """The certified optimum of one problem.

    `floor` is the absolute excess that counts as nothing (perfect fits); `others` are costs of other optima with the
    number of Levenberg-Marquardt searches that ended there, most frequent first; `truth_cost` is the cost of the
    parameters the data were made with (None when they lie outside the box); `at_bound` names coordinates that the
    optimum has on a bound.
    """

    name: str
    cost: float
    floor: float
    point: dict[str, float]
    at_bound: list[str]
    truth_cost: float | None
    trust_region: Share
    levenberg_marquardt: Share
    evolution: dict[str, float]
    spread: list[float]
    others: list[tuple[float, int]]
    seconds: float

    def reached(self, cost: float) -> bool:
        """Whether a cost is the best one."""
        return bool(cost <= self.cost * (1 + SAME) + self.floor)


def load(path: Path = PATH) -> dict[str, Truth]:
    """Truths by name."""
    if not path.exists():
        return {}
    made = {}
    for name, record in json.loads(path.read_text("utf-8")).items():
        shares = {k: Share(**record[k]) for k in ("trust_region", "levenberg_marquardt")}
        others = [tuple(o) for o in record["others"]]
        made[name] = Truth(**dict[str, Any](record, **shares, name=name, others=others))
    return made


def save(truths: dict[str, Truth], path: Path = PATH) -> None:
    """One line of JSON for each problem, in the order given."""
    lines = []
    for name, truth in truths.items():
        record = {k: v for k, v in asdict(truth).items() if k != "name"}
        lines.append(f"{json.dumps(name)}: {json.dumps(record)}")
    path.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")


def make(
    case: Case | StudyCase, *, trust_region: int, levenberg_marquardt: int, evolution: int, limit: float
) -> Truth | None:
    """Search a problem from many starts; None where nearly every other succeeds.

    scipy's searches end after `limit` seconds, but not before 200.
    """
    began = time.perf_counter()
    problem = case.problem()
    d = problem.space.dimension
    rng = np.random.default_rng([SEED, *case.name.encode()])
    ordinary = np.asarray(problem.costs(rng.random((64, d))))
    floor = PERFECT * float(np.median(ordinary[np.isfinite(ordinary)])) if case.perfect else 0.0
    ends, started = [], time.perf_counter()
    for start in rng.random((trust_region, d)):
        if len(ends) >= 200 and time.perf_counter() - started > limit:
            break
        ends.append(descend(problem, start))
        if len(ends) == 50 and np.sum(
            [e.cost <= min(e.cost for e in ends) * (1 + SAME) + floor for e in ends]
        ) > HOPELESS * len(ends):
            return None
    points, costs = descend_many(problem, rng.random((levenberg_marquardt, d)))
    population, evolved, spent = _evolve(problem, evolution, rng)
    candidates = [points[np.argmin(costs)], min(ends, key=lambda e: e.cost).z, evolved.z, population]
    best = min((_polished(problem, z) for z in candidates), key=lambda e: e.cost)
    everything = np.concatenate([costs, [e.cost for e in ends]])
    lowest = min(best.cost, float(everything.min()))
    if lowest < best.cost:  # the last digit of a cost is the batch's
        best = type(best)(best.z, lowest, best.evaluations)
    same = best.cost * (1 + SAME) + floor
    physical = np.asarray(problem.space.physical(best.z))
    inside = all(
        low <= case.truth[n] <= high
        for n, low, high in zip(problem.space.names, problem.space.lower, problem.space.upper, strict=True)
    )
    at = problem.space.cube(problem.space.vector(case.truth))
    finite = costs[np.isfinite(costs)]
    trf = np.array([e.cost for e in ends])
    return Truth(
        case.name,
        best.cost,
        floor,
        dict(zip(problem.space.names, physical.tolist(), strict=True)),
        [n for n, z in zip(problem.space.names, best.z, strict=True) if z < 1e-9 or z > 1 - 1e-9],
        float(problem.costs(at[None])[0]) if inside else None,
        Share(
            len(trf),
            int(np.sum(trf <= same)),
            int(np.sum(~np.isfinite(trf))),
            round(float(np.mean([e.evaluations for e in ends])), 1),
        ),
        Share(len(costs), int(np.sum(costs <= same)), int(np.sum(~np.isfinite(costs))), 0.0),
        {"evaluations": spent, "cost": evolved.cost},
        [float(f"{q:.6g}") for q in np.quantile(finite, [0.0, 0.05, 0.25, 0.5, 0.75, 0.95])],
        _levels(finite[finite > same]),
        round(time.perf_counter() - began, 1),
    )


def _evolve(problem: pf.Problem, budget: int, rng: np.random.Generator):
    """The best member of differential evolution (Storn and Price 1997), where a local search from it ends, and
    evaluations spent."""
    d = problem.space.dimension
    members = 12 * d

    def costs(x: np.ndarray) -> np.ndarray:
        f = np.asarray(problem.costs(np.clip(x.T, 0.0, 1.0)))
        return np.where(np.isfinite(f), f, 1e300)

    answer = optimize.differential_evolution(
        costs, [(0.0, 1.0)] * d, popsize=12, maxiter=max(1, budget // members - 1), tol=1e-10, polish=False,
        vectorized=True,
        updating="deferred", mutation=(0.4, 0.9), recombination=0.9, rng=rng,
    )  # fmt: skip
    z = np.clip(answer.x, 0.0, 1.0)
    return z, descend(problem, z), int(answer.nfev)


def _polished(problem: pf.Problem, z: np.ndarray):
    """Both local searches in turn until neither gains, so that a coordinate on a bound gets there."""
    best = descend(problem, z)
    for _ in range(5):
        points, costs = descend_many(
            problem, np.stack([best.z, np.where(best.z < 1e-7, 0.0, np.where(best.z > 1 - 1e-7, 1.0, best.z))])
        )
        k = int(np.argmin(costs))
        if not costs[k] < best.cost * (1 - 1e-13):
            return type(best)(points[k], float(costs[k]), 0) if costs[k] <= best.cost else best
        best = type(best)(points[k], float(costs[k]), 0)
        again = descend(problem, best.z)
        best = again if again.cost < best.cost else best
    return best


def _levels(costs: np.ndarray, most: int = 8) -> list[tuple[float, int]]:
    """Costs that agree to 1e-4, with their number, most frequent first."""
    groups: list[tuple[float, int]] = []
    for cost in np.sort(costs):
        if groups and cost <= groups[-1][0] * (1 + 1e-4):
            groups[-1] = groups[-1][0], groups[-1][1] + 1
        else:
            groups.append((float(f"{cost:.8g}"), 1))
    return sorted(groups, key=lambda g: -g[1])[:most]


def line(truth: Truth) -> str:
    """One problem for a terminal."""
    trf, lm = truth.trust_region, truth.levenberg_marquardt
    found = "agrees" if truth.reached(truth.evolution["cost"]) else f"ends at {truth.evolution['cost']:.6g}"
    bound = f"; on a bound: {', '.join(truth.at_bound)}" if truth.at_bound else ""
    verdict = "" if trf.most < ENOUGH else "   TOO EASY"
    return (
        f"{truth.name:22} best {truth.cost:.8g}  trust region {100 * trf.share:5.1f} % of {trf.starts} "
        f"({trf.evaluations:.0f} evaluations)"
        f"  LM {100 * lm.share:5.1f} % of {lm.starts}  evolution {found}  {truth.seconds:.0f} s{bound}{verdict}"
    )


def main(arguments: list[str] | None = None) -> int:
    from benchmarks.search_suite.suite import WRITTEN

    parser = argparse.ArgumentParser(prog="python -m benchmarks.search_suite.truths", description=__doc__)
    parser.add_argument("names", nargs="*", help="problems, default all that have no truth yet")
    parser.add_argument("--all", action="store_true", help="make every truth anew")
    parser.add_argument("--trust-region", type=int, default=500)
    parser.add_argument("--levenberg-marquardt", type=int, default=2000)
    parser.add_argument("--evolution", type=int, default=40_000)
    parser.add_argument("--limit", type=float, default=5.0, help="seconds of scipy's searches after the first 200")
    options = parser.parse_args(arguments)
    kept = load()
    for name in options.names or [n for n in WRITTEN if options.all or n not in kept]:
        with np.errstate(all="ignore"):
            truth = make(
                WRITTEN[name], trust_region=options.trust_region, levenberg_marquardt=options.levenberg_marquardt,
                evolution=options.evolution, limit=options.limit,
            )  # fmt: skip
        if truth is None:
            print(f"{name:22} is too easy: more than {HOPELESS:.0%} of 50 searches agree", flush=True)
            continue
        kept[name] = truth
        print(line(truth), flush=True)
        save({n: kept[n] for n in WRITTEN if n in kept})
    return 0


if __name__ == "__main__":
    sys.exit(main())
