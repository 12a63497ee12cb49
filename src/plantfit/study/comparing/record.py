"""Methods compared on one or several problems: one plain record with numbers, curves and sentences.

The record holds curves on common grids and thinned lists, so that its size does not grow with the number of runs.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from plantfit.study.comparing import sentences
from plantfit.study.comparing.across_problems import across
from plantfit.study.comparing.best_answers import best_runs, distinct_answers
from plantfit.study.comparing.pairwise import compare, detectable, hitting_order
from plantfit.study.comparing.problem_runs import ProblemRuns, by_method, costs_of, median_of, tied
from plantfit.study.comparing.profiles import best_costs, by_evaluations, by_seconds, ecdf, grid_of, hitting_times, leads, quartiles
from plantfit.study.comparing.sentences import Pair
from plantfit.study.comparing.statistics import expected_running_time, ratio_interval, running_time_interval, summarise, wilson_interval
from plantfit.study.comparing.targets import Scale, Target, profile_targets, scale_of, targets
from plantfit.study.store.records import RunRecord

KEPT_COSTS = 400  # sorted final costs per method
RESAMPLES = 2000
FEW = 10  # runs of a method below which its intervals are rough


def compared(problems: Sequence[ProblemRuns], *, asked: Sequence[float] = (), seed: int = 0) -> dict[str, Any]:
    """The comparison record of one problem or several; `asked` are costs to reach, `seed` drives every bootstrap.

    JSON types only, but for NaN and infinities. docs/comparing.md says what stands in it.
    """
    found = [_problem(p, asked, seed) for p in problems]
    return {
        "name": ", ".join(p.name for p in problems),
        "problems": found,
        "across": across(problems, found, seed) if len(problems) > 1 else None,
        "seed": seed,
    }


def _problem(problem: ProblemRuns, asked: Sequence[float], seed: int) -> dict[str, Any]:
    groups = by_method(problem.runs)
    costs = {m: costs_of(own) for m, own in groups.items()}
    scale = scale_of(problem.runs, problem.optimum)
    grid = grid_of(problem.runs)
    wanted = targets(scale, asked=asked, floor=problem.floor)
    pairs = _pairs(groups, costs, scale, grid, seed)
    reached = [_target(t, groups, seed) for t in wanted]
    main = _main_target(wanted)
    answers = distinct_answers(problem, scale)
    record = {
        "name": problem.name,
        "studies": list(problem.studies),
        "dimension": len(problem.runs[0].x) if problem.runs else 0,
        "floor": problem.floor,
        "optimum": problem.optimum,
        "scale": asdict(scale) if scale else None,
        "methods": [_method(m, own, seed) for m, own in groups.items()],
        "targets": reached,
        "main_target": main,
        "pairs": [asdict(p) | {"sentence": sentences.pair_sentence(p), "differs": p.differs} for p in pairs],
        "hitting": [] if main is None else _hitting(groups, costs, wanted[main]),
        "convergence": _convergence(groups, by_evaluations),
        "convergence_seconds": _convergence(groups, by_seconds),
        "ecdf": _ecdf(groups, scale, grid),
        "parallel": best_runs(problem, groups),
        "optima": answers,
        "notes": _notes(problem, groups),
    }
    return record | {"sentences": _sentences(record, pairs, costs)}


def _method(name: str, runs: Sequence[RunRecord], seed: int) -> dict[str, Any]:
    costs = costs_of(runs)
    ordered = np.sort(costs[np.isfinite(costs)])
    keep = np.unique(np.linspace(0, len(ordered) - 1, min(len(ordered), KEPT_COSTS)).round().astype(int))
    return {
        "name": name,
        "runs": len(runs),
        "cost": asdict(summarise(costs, seed=seed, resamples=RESAMPLES)),
        "evaluations": asdict(summarise([r.evaluations for r in runs], seed=seed, resamples=RESAMPLES)),
        "seconds": asdict(summarise([r.seconds for r in runs], seed=seed, resamples=RESAMPLES)),
        "sorted": {"rank": ((keep + 1) / max(len(runs), 1)).tolist(), "cost": ordered[keep].tolist()},
    }


def _pairs(
    groups: Mapping[str, list[RunRecord]], costs: Mapping[str, np.ndarray], scale: Scale | None, grid: np.ndarray, seed: int
) -> list[Pair]:
    found = compare(tied(costs, scale))
    curves = {m: best_costs(own, grid) for m, own in groups.items()} if len(groups) > 1 else {}
    medians = {m: median_of(c) for m, c in costs.items()}
    pairs = []
    for c in found:
        better = c.winner
        worse = c.second if better == c.first else c.first
        flip = better == c.first
        low, high = c.a12_interval
        ratio = medians[worse] / medians[better] if medians[better] > 0 and 0 < medians[worse] < np.inf else float("nan")
        pairs.append(
            Pair(
                better,
                worse,
                (len(groups[better]), len(groups[worse])),
                len(found),
                1 - c.a12 if flip else c.a12,
                (1 - high, 1 - low) if flip else (low, high),
                c.p,
                c.p_holm,
                (medians[better], medians[worse]),
                ratio,
                _ratio_interval(costs[worse], costs[better], seed) if np.isfinite(ratio) else (float("nan"), float("nan")),
                detectable(len(groups[better]), len(groups[worse]), len(found)),
                tuple(leads((c.first, curves[c.first]), (c.second, curves[c.second]), grid)),
            )
        )
    return pairs


def _ratio_interval(x: np.ndarray, y: np.ndarray, seed: int) -> tuple[float, float]:
    x, y = (np.where(np.isnan(v), np.inf, v) for v in (x, y))
    if min(len(x), len(y)) < 2:
        return float("nan"), float("nan")
    return ratio_interval(x, y, seed=seed, resamples=RESAMPLES)


def _main_target(wanted: Sequence[Target]) -> int | None:
    """The target on which times are compared, chosen before looking: asked for, else noise floor, else 10^-2."""
    for label in ("asked for", "noise floor", "10^-2"):
        for k, target in enumerate(wanted):
            if target.label == label:
                return k
    return 0 if wanted else None


def _target(target: Target, groups: Mapping[str, list[RunRecord]], seed: int) -> dict[str, Any]:
    return {"label": target.label, "cost": target.cost, "methods": {m: _reached(target, own, seed) for m, own in groups.items()}}


def _reached(target: Target, runs: Sequence[RunRecord], seed: int) -> dict[str, Any]:
    times = hitting_times(runs, [target.cost])[:, 0]
    seconds = hitting_times(runs, [target.cost], by_seconds)[:, 0]
    spent, lasted = [r.evaluations for r in runs], [r.seconds for r in runs]
    hits, n = int(np.isfinite(times).sum()), len(runs)
    return {
        "hits": hits,
        "n": n,
        "rate": hits / n,
        "rate_interval": wilson_interval(hits, n),
        "ert": expected_running_time(spent, times),
        "ert_interval": running_time_interval(spent, times, seed=seed),
        "ert_seconds": expected_running_time(lasted, seconds),
        "ert_seconds_interval": running_time_interval(lasted, seconds, seed=seed),
    }


def _hitting(groups: Mapping[str, list[RunRecord]], costs: Mapping[str, np.ndarray], target: Target) -> list[dict[str, Any]]:
    """All pairs by time to the target, misses behind all hits by final cost."""
    times = {m: hitting_times(own, [target.cost])[:, 0] for m, own in groups.items()}
    return [asdict(c) for c in compare(hitting_order(times, costs))]


def _convergence(groups: Mapping[str, list[RunRecord]], clock: Callable[[RunRecord], np.ndarray]) -> dict[str, Any]:
    """Quartiles of the best cost of each method on its own grid, from where every run of it has begun."""
    found = {}
    for m, own in groups.items():
        grid = grid_of(own, clock)
        costs = best_costs(own, grid, clock)
        low, middle, high = quartiles(costs)
        begun = np.isfinite(costs).sum(axis=0)
        shown = np.isfinite(middle) & (begun == begun.max(initial=0))
        found[m] = {"at": grid[shown].tolist(), "low": low[shown].tolist(), "median": middle[shown].tolist(), "high": high[shown].tolist()}
    return found


def _ecdf(groups: Mapping[str, list[RunRecord]], scale: Scale | None, grid: np.ndarray) -> dict[str, Any]:
    wanted = profile_targets(scale)
    if not len(wanted) or not len(grid):
        return {"targets": 0, "at": [], "methods": {}}
    shares = {m: ecdf(hitting_times(own, wanted), grid * (1 + 1e-12)).tolist() for m, own in groups.items()}
    return {"targets": len(wanted), "at": grid.tolist(), "methods": shares}


def _notes(problem: ProblemRuns, groups: Mapping[str, list[RunRecord]]) -> list[str]:
    """What makes the comparison less than fair."""
    found = list(problem.notes)
    budgets = {m: b for m, b in (problem.budgets or {}).items() if m in groups}
    if len(set(budgets.values())) > 1:
        told = ", ".join(f"{m} {sentences.evaluations(b)}" for m, b in budgets.items())
        found.append(f"The budgets differ ({told} evaluations): final costs do not compare like with like; read the curves.")
    few = [f"{m} {len(own)}" for m, own in groups.items() if len(own) < FEW]
    if few:
        found.append(f"Few runs ({', '.join(few)}): intervals and tests need about 10 or more.")
    failed = {m: int(np.sum(~np.isfinite(costs_of(own)))) for m, own in groups.items()}
    if any(failed.values()):
        told = ", ".join(f"{m} {n}" for m, n in failed.items() if n)
        found.append(f"Runs without a finite cost ({told}) rank last and are left out of means.")
    return found


def _sentences(record: Mapping[str, Any], pairs: Sequence[Pair], costs: Mapping[str, np.ndarray]) -> list[dict[str, str]]:
    """What to read first: the order, the best method against each other one, the main target, the answers."""
    found: list[dict[str, str]] = []

    def say(level: str, sentence: str) -> None:
        if sentence:
            found.append({"level": level, "sentence": sentence})

    medians = {m: median_of(c) for m, c in costs.items()}
    if len(medians) > 1:
        say("info", sentences.order_sentence(medians))
        best = min(medians, key=lambda m: medians[m])
        for p in pairs:
            if best in (p.better, p.worse):
                say("good" if p.differs else "info", sentences.pair_sentence(p))
        say("info", sentences.one_problem_sentence(len(c) for c in costs.values()))
    elif medians:
        say("info", f"Only {next(iter(medians))} ran here: there is nothing to compare it with.")
    if record["main_target"] is not None:
        main = record["targets"][record["main_target"]]
        label = main["label"] if main["label"][:2] != "10" else f"{main['label']} of the way from {record['scale']['source']} to the best"
        say("info", sentences.target_sentence(label, main["cost"], main["methods"]))
    answers = record["optima"]
    if answers["groups"]:
        level = "warning" if answers["count"] > 1 else "info"
        say(level, sentences.optima_sentence(answers["shares"], answers["within"], answers["widest"]))
    for note in record["notes"]:
        say("warning", note)
    return found
