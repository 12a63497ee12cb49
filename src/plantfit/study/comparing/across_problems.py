"""Methods over several problems, which are the replicates then."""

from collections.abc import Mapping, Sequence

import numpy as np

from plantfit.findings.record import Number
from plantfit.findings.results.methods_compared import (
    CostScale,
    Interval,
    OverProblems,
    PairOverProblems,
    ProblemComparison,
    RankTest,
    SharesReached,
)
from plantfit.study.comparing import friedman as ranks
from plantfit.study.comparing import sentences
from plantfit.study.comparing.pairwise import a12
from plantfit.study.comparing.problem_runs import ProblemRuns, by_method, costs_of, median_of, tied
from plantfit.study.comparing.profiles import GRID, data_profile, grid_of, hitting_times
from plantfit.study.comparing.statistics import NAN_INTERVAL, expected_running_time, running_times
from plantfit.study.comparing.targets import profile_targets, scale_of
from plantfit.study.store.records import RunRecord

RUN_RESAMPLES = 2000
RESAMPLES = 10_000
UNKNOWN = (float("nan"), NAN_INTERVAL)


def across(problems: Sequence[ProblemRuns], found: Sequence[ProblemComparison], seed: int) -> OverProblems | None:
    """Methods that ran on every problem; None if fewer than two did.

    Two methods are compared by signed ranks of their medians, more by Friedman's test and then the best with each other
    one.
    """
    groups = [by_method(p.runs) for p in problems]
    methods = [m for m in groups[0] if all(m in g for g in groups)]
    if len(methods) < 2:
        return None
    scales = [scale_of(p.runs, p.optimum) for p in problems]
    costs = [tied({m: costs_of(g[m]) for m in methods}, s) for g, s in zip(groups, scales, strict=True)]
    medians = np.array([[median_of(costs_of(g[m])) for m in methods] for g in groups])
    levelled = np.array([[float(np.median(c[m])) for m in methods] for c in costs])
    test = _friedman(methods, levelled) if len(methods) > 2 else None
    pairs = []
    for a, b in _tested(methods, test):
        pair = _pair(a, b, test, medians, levelled, methods, costs, seed)
        ratio, interval = _running_time_ratio(pair.better, pair.worse, groups, found, np.random.default_rng(seed), seed)
        pair = pair.model_copy(update={"ert_ratio": ratio, "ert_ratio_interval": interval})
        pairs.append(pair.model_copy(update={"sentence": sentences.across_sentence(pair)}))
    return OverProblems(
        methods=methods,
        problems=len(problems),
        medians=medians.tolist(),
        friedman=test,
        pairs=pairs,
        profile=_profile(problems, groups, methods, scales),
        sentences=([test.sentence] if test else []) + [p.sentence for p in pairs],
    )


def _tested(methods: Sequence[str], test: RankTest | None) -> list[tuple[str, str]]:
    """The pairs that are tested: the two methods, or the best of several with each other one."""
    return [(methods[0], methods[1])] if test is None else [(test.best, m) for m in methods if m != test.best]


def _friedman(methods: Sequence[str], costs: np.ndarray) -> RankTest:
    f = ranks.friedman(methods, costs)

    def of(values: Sequence[float]) -> dict[str, float | None]:
        return dict(zip(methods, values, strict=True))

    record = RankTest(
        methods=list(methods),
        problems=f.problems,
        mean_ranks=dict(zip(methods, f.mean_ranks, strict=True)),
        chi_square=f.chi_square,
        p_chi_square=f.p_chi_square,
        f=f.f,
        p=f.p,
        best=f.best,
        z=of(f.z),
        p_post_hoc=of(f.p_post_hoc),
        p_holm=of(f.p_holm),
    )
    return record.model_copy(update={"sentence": sentences.friedman_sentence(record)})


def _pair(
    first: str, second: str, test: RankTest | None, medians: np.ndarray, levelled: np.ndarray,
    methods: Sequence[str], costs: Sequence[Mapping[str, np.ndarray]], seed: int,
) -> PairOverProblems:  # fmt: skip
    # A12 as the share of pairs of runs in which `first` ends lower
    effect = float(np.mean([a12(c[second], c[first]) for c in costs]))
    better, worse = (first, second) if effect >= 0.5 else (second, first)
    rng = np.random.default_rng(seed)
    replicates = np.array([ranks.resampled_a12(c[worse], c[better], rng=rng, resamples=RESAMPLES) for c in costs])
    if test is None:
        p = p_holm = _signed_rank(medians, levelled, methods.index(first), methods.index(second))
    else:
        p = _known(test.p_post_hoc[second])
        # what the test of all methods did not find, no pair may claim
        p_holm = max(_known(test.p_holm[second]), test.p)
    return PairOverProblems(
        better=better,
        worse=worse,
        problems=len(costs),
        test="signed ranks of medians" if test is None else "mean ranks, Holm",
        a12=max(effect, 1 - effect),
        a12_interval=ranks.hierarchical_interval(replicates, rng=rng),
        p=p,
        p_holm=p_holm,
    )


def _known(p: Number) -> float:
    return float("nan") if p is None else p


def _signed_rank(medians: np.ndarray, levelled: np.ndarray, i: int, j: int) -> float:
    """Signed ranks of medians, those that differ by rounding only counting as equal."""
    equal = levelled[:, i] == levelled[:, j]
    return ranks.signed_rank(medians[:, i], np.where(equal, medians[:, i], medians[:, j]))


def _running_time_ratio(
    better: str, worse: str, groups: Sequence[Mapping[str, list[RunRecord]]], found: Sequence[ProblemComparison],
    rng: np.random.Generator, seed: int,
) -> tuple[float, Interval]:  # fmt: skip
    """Geometric mean over problems of the ratio of expected running times to the main target; NaN unless both reach
    it everywhere."""
    logs, replicates = [], []
    for g, record in zip(groups, found, strict=True):
        if record.main_target is None:
            return UNKNOWN
        cost = record.targets[record.main_target].cost
        drawn, value = [], []
        for m, own_seed in ((worse, seed), (better, seed + 1)):
            times, spent = hitting_times(g[m], [cost])[:, 0], [r.evaluations for r in g[m]]
            value.append(expected_running_time(spent, times))
            drawn.append(running_times(spent, times, seed=own_seed, resamples=RUN_RESAMPLES))
        if not np.all(np.isfinite(value)):
            return UNKNOWN
        logs.append(np.log(value[0] / value[1]))
        replicates.append(np.log(drawn[0] / drawn[1]))
    low, high = np.exp(ranks.hierarchical_interval(np.array(replicates), rng=rng))
    return float(np.exp(np.mean(logs))), (float(low), float(high))


def _profile(
    problems: Sequence[ProblemRuns],
    groups: Sequence[Mapping[str, list[RunRecord]]],
    methods: Sequence[str],
    scales: Sequence[CostScale | None],
) -> SharesReached:
    """Data profiles: share of (problem, target, run) reached within so many evaluations per dimension plus one."""
    wanted = [profile_targets(s) for s in scales]
    ends = [(grid, len(p.runs[0].x)) for p in problems if len(grid := grid_of(p.runs))]
    if not ends or not any(len(w) for w in wanted):
        return SharesReached(at=[], methods={})
    at = np.geomspace(min(g[0] / (d + 1) for g, d in ends), max(g[-1] / (d + 1) for g, d in ends), GRID)
    shares = {
        m: data_profile(
            [(hitting_times(g[m], w), len(p.runs[0].x)) for p, g, w in zip(problems, groups, wanted, strict=True)],
            at * (1 + 1e-12),
        )
        for m in methods
    }
    return SharesReached(at=at.tolist(), methods={m: s.tolist() for m, s in shares.items()})
