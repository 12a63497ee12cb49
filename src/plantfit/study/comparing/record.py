"""Methods compared on one or several problems: one record with numbers, curves and sentences.

The record holds curves on common grids and thinned lists, so that its size does not grow with the number of runs.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from plantfit.findings.record import Level
from plantfit.findings.results.methods_compared import (
    SIGNIFICANCE,
    ComparisonOfMethods,
    CostScale,
    CostTarget,
    MethodPair,
    MethodRuns,
    PairInTime,
    ProblemComparison,
    Quartiles,
    Reached,
    SameCostAnswers,
    SharesReached,
    SortedCosts,
)
from plantfit.findings.verdict import Sentence
from plantfit.study.comparing import sentences
from plantfit.study.comparing.across_problems import across
from plantfit.study.comparing.best_answers import best_runs, distinct_answers
from plantfit.study.comparing.pairwise import compare, detectable, hitting_order
from plantfit.study.comparing.problem_runs import ProblemRuns, by_method, costs_of, median_of, tied
from plantfit.study.comparing.profiles import (
    best_costs,
    by_evaluations,
    by_seconds,
    ecdf,
    grid_of,
    hitting_times,
    leads,
    quartiles,
)
from plantfit.study.comparing.statistics import (
    NAN_INTERVAL,
    expected_running_time,
    ratio_interval,
    running_time_interval,
    summarise,
    wilson_interval,
)
from plantfit.study.comparing.targets import profile_targets, scale_of, targets
from plantfit.study.store.records import RunRecord

KEPT_COSTS = 400  # sorted final costs per method
RESAMPLES = 2000
FEW = 10  # runs of a method below which its intervals are rough


def compared(problems: Sequence[ProblemRuns], *, asked: Sequence[float] = (), seed: int = 0) -> ComparisonOfMethods:
    """The comparison of one problem or several; `asked` are costs to reach, `seed` drives every bootstrap."""
    found = [_problem(p, asked, seed) for p in problems]
    return ComparisonOfMethods(
        name=", ".join(p.name for p in problems),
        problems=found,
        across=across(problems, found, seed) if len(problems) > 1 else None,
        seed=seed,
    )


def _problem(problem: ProblemRuns, asked: Sequence[float], seed: int) -> ProblemComparison:
    groups = by_method(problem.runs)
    costs = {m: costs_of(own) for m, own in groups.items()}
    scale = scale_of(problem.runs, problem.optimum)
    grid = grid_of(problem.runs)
    wanted = targets(scale, asked=asked, floor=problem.floor)
    pairs = _pairs(groups, costs, scale, grid, seed)
    reached = [_target(t, groups, seed) for t in wanted]
    main = _main_target(wanted)
    answers, notes = distinct_answers(problem, scale), _notes(problem, groups)
    return ProblemComparison(
        name=problem.name,
        studies=list(problem.studies),
        dimension=len(problem.runs[0].x) if problem.runs else 0,
        floor=problem.floor,
        optimum=problem.optimum,
        scale=scale,
        methods=[_method(m, own, seed) for m, own in groups.items()],
        targets=reached,
        main_target=main,
        pairs=pairs,
        hitting=[] if main is None else _hitting(groups, costs, wanted[main]),
        convergence=_convergence(groups, by_evaluations),
        convergence_seconds=_convergence(groups, by_seconds),
        ecdf=_ecdf(groups, scale, grid),
        parallel=best_runs(problem, groups),
        optima=answers,
        notes=notes,
        sentences=_sentences(pairs, costs, None if main is None else reached[main], scale, answers, notes),
    )


def _method(name: str, runs: Sequence[RunRecord], seed: int) -> MethodRuns:
    costs = costs_of(runs)
    ordered = np.sort(costs[np.isfinite(costs)])
    keep = np.unique(np.linspace(0, len(ordered) - 1, min(len(ordered), KEPT_COSTS)).round().astype(int))
    return MethodRuns(
        name=name,
        runs=len(runs),
        cost=summarise(costs, seed=seed, resamples=RESAMPLES),
        evaluations=summarise([r.evaluations for r in runs], seed=seed, resamples=RESAMPLES),
        seconds=summarise([r.seconds for r in runs], seed=seed, resamples=RESAMPLES),
        sorted=SortedCosts(rank=((keep + 1) / max(len(runs), 1)).tolist(), cost=ordered[keep].tolist()),
    )


def _pairs(
    groups: Mapping[str, list[RunRecord]],
    costs: Mapping[str, np.ndarray],
    scale: CostScale | None,
    grid: np.ndarray,
    seed: int,
) -> list[MethodPair]:
    found = compare(tied(costs, scale))
    curves = {m: best_costs(own, grid) for m, own in groups.items()} if len(groups) > 1 else {}
    medians = {m: median_of(c) for m, c in costs.items()}
    pairs = []
    for c in found:
        better = c.winner
        worse = c.second if better == c.first else c.first
        flip = better == c.first
        low, high = c.a12_interval
        ratio = (
            medians[worse] / medians[better] if medians[better] > 0 and 0 < medians[worse] < np.inf else float("nan")
        )
        pair = MethodPair(
            better=better,
            worse=worse,
            runs=(len(groups[better]), len(groups[worse])),
            pairs=len(found),
            a12=1 - c.a12 if flip else c.a12,
            a12_interval=(1 - high, 1 - low) if flip else (low, high),
            p=c.p,
            p_holm=c.p_holm,
            medians=(medians[better], medians[worse]),
            ratio=ratio,
            ratio_interval=_ratio_interval(costs[worse], costs[better], seed) if np.isfinite(ratio) else NAN_INTERVAL,
            detectable=detectable(len(groups[better]), len(groups[worse]), len(found)),
            leads=leads((c.first, curves[c.first]), (c.second, curves[c.second]), grid),
            differs=c.p_holm < SIGNIFICANCE,
        )
        pairs.append(pair.model_copy(update={"sentence": sentences.pair_sentence(pair)}))
    return pairs


def _ratio_interval(x: np.ndarray, y: np.ndarray, seed: int) -> tuple[float, float]:
    x, y = (np.where(np.isnan(v), np.inf, v) for v in (x, y))
    if min(len(x), len(y)) < 2:
        return NAN_INTERVAL
    return ratio_interval(x, y, seed=seed, resamples=RESAMPLES)


def _main_target(wanted: Sequence[CostTarget]) -> int | None:
    """The target on which times are compared, chosen before looking: asked for, else noise floor, else 10^-2."""
    for label in ("asked for", "noise floor", "10^-2"):
        for k, target in enumerate(wanted):
            if target.label == label:
                return k
    return 0 if wanted else None


def _target(target: CostTarget, groups: Mapping[str, list[RunRecord]], seed: int) -> CostTarget:
    return target.model_copy(update={"methods": {m: _reached(target, own, seed) for m, own in groups.items()}})


def _reached(target: CostTarget, runs: Sequence[RunRecord], seed: int) -> Reached:
    times = hitting_times(runs, [target.cost])[:, 0]
    seconds = hitting_times(runs, [target.cost], by_seconds)[:, 0]
    spent, lasted = [r.evaluations for r in runs], [r.seconds for r in runs]
    hits, n = int(np.isfinite(times).sum()), len(runs)
    return Reached(
        hits=hits,
        n=n,
        rate=hits / n,
        rate_interval=wilson_interval(hits, n),
        ert=expected_running_time(spent, times),
        ert_interval=running_time_interval(spent, times, seed=seed),
        ert_seconds=expected_running_time(lasted, seconds),
        ert_seconds_interval=running_time_interval(lasted, seconds, seed=seed),
    )


def _hitting(
    groups: Mapping[str, list[RunRecord]], costs: Mapping[str, np.ndarray], target: CostTarget
) -> list[PairInTime]:
    """All pairs by time to the target, misses behind all hits by final cost."""
    times = {m: hitting_times(own, [target.cost])[:, 0] for m, own in groups.items()}
    return compare(hitting_order(times, costs))


def _convergence(
    groups: Mapping[str, list[RunRecord]], clock: Callable[[RunRecord], np.ndarray]
) -> dict[str, Quartiles]:
    """Quartiles of the best cost of each method on its own grid, from where every run of it has begun."""
    found = {}
    for m, own in groups.items():
        grid = grid_of(own, clock)
        costs = best_costs(own, grid, clock)
        low, middle, high = quartiles(costs)
        begun = np.isfinite(costs).sum(axis=0)
        shown = np.isfinite(middle) & (begun == begun.max(initial=0))
        found[m] = Quartiles(
            at=grid[shown].tolist(), low=low[shown].tolist(), median=middle[shown].tolist(), high=high[shown].tolist()
        )
    return found


def _ecdf(groups: Mapping[str, list[RunRecord]], scale: CostScale | None, grid: np.ndarray) -> SharesReached:
    wanted = profile_targets(scale)
    if not len(wanted) or not len(grid):
        return SharesReached(targets=0, at=[], methods={})
    shares = {m: ecdf(hitting_times(own, wanted), grid * (1 + 1e-12)).tolist() for m, own in groups.items()}
    return SharesReached(targets=len(wanted), at=grid.tolist(), methods=shares)


def _notes(problem: ProblemRuns, groups: Mapping[str, list[RunRecord]]) -> list[str]:
    """What makes the comparison less than fair."""
    found = list(problem.notes)
    budgets = {m: b for m, b in (problem.budgets or {}).items() if m in groups}
    if len(set(budgets.values())) > 1:
        told = ", ".join(f"{m} {sentences.evaluations(b)}" for m, b in budgets.items())
        found.append(
            f"The budgets differ ({told} evaluations): final costs do not compare like with like; read the curves."
        )
    few = [f"{m} {len(own)}" for m, own in groups.items() if len(own) < FEW]
    if few:
        found.append(f"Few runs ({', '.join(few)}): intervals and tests need about 10 or more.")
    failed = {m: int(np.sum(~np.isfinite(costs_of(own)))) for m, own in groups.items()}
    if any(failed.values()):
        told = ", ".join(f"{m} {n}" for m, n in failed.items() if n)
        found.append(f"Runs without a finite cost ({told}) rank last and are left out of means.")
    return found


def _sentences(
    pairs: Sequence[MethodPair], costs: Mapping[str, np.ndarray], main: CostTarget | None, scale: CostScale | None,
    answers: SameCostAnswers, notes: Sequence[str],
) -> list[Sentence]:  # fmt: skip
    """What to read first: the order, the best method against each other one, the main target, the answers."""
    found: list[Sentence] = []

    def say(level: Level, sentence: str) -> None:
        if sentence:
            found.append(Sentence(level=level, sentence=sentence))

    medians = {m: median_of(c) for m, c in costs.items()}
    if len(medians) > 1:
        say("info", sentences.order_sentence(medians))
        best = min(medians, key=lambda m: medians[m])
        for p in pairs:
            if best in (p.better, p.worse):
                say("good" if p.differs else "info", p.sentence)
        say("info", sentences.one_problem_sentence(len(c) for c in costs.values()))
    elif medians:
        say("info", f"Only {next(iter(medians))} ran here: there is nothing to compare it with.")
    if main is not None:
        label = (
            f"{main.label} of the way from {scale.source} to the best"
            if scale and main.label.startswith("10")
            else main.label
        )
        say("info", sentences.target_sentence(label, main))
    if answers.groups:
        say(
            "warning" if answers.count > 1 else "info",
            sentences.optima_sentence(answers.shares, answers.within, answers.widest),
        )
    for note in notes:
        say("warning", note)
    return found
