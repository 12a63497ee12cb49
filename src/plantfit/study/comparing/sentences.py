"""What a comparison of methods means, in plain sentences with their numbers."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.findings.results.methods_compared import SIGNIFICANCE, CostTarget, MethodPair, PairOverProblems, RankTest
from plantfit.study.comparing.friedman import smallest_p
from plantfit.study.comparing.pairwise import effect_word

MOST_CHANGES = 3  # leads told one by one
SAME = 1e-6  # medians this near, relatively, are called equal


def pair_sentence(pair: MethodPair) -> str:
    """Who wins, by how much, how sure, and when the order changed."""
    return f"{_outcome(pair)} {change_sentence(pair)}".strip()


def _outcome(pair: MethodPair) -> str:
    runs = f"{pair.runs[0]} and {pair.runs[1]} runs"
    effect = f"A12, the share of pairs won, {pair.a12:.2f} ({_interval(pair.a12_interval, '.2f')})"
    p = f"{p_value(pair.p_holm)}{f' after Holm for {pair.pairs} pairs' if pair.pairs > 1 else ''}"
    if pair.differs:
        size = effect_word(pair.a12)
        return f"{pair.better} beats {pair.worse}: {_margin(pair)}. {effect}, a {size} effect; {p}; {runs}."
    seen = (
        f"A12 above {pair.detectable:.2f} would have been seen 8 times in 10"
        if pair.detectable < 1
        else "only a difference in nearly all pairs would have been seen"
    )
    return f"No difference between {pair.better} and {pair.worse} that {runs} could show: {effect}, {p}; {seen}."


def _margin(pair: MethodPair) -> str:
    often = f"its runs end lower in {100 * pair.a12:.0f} % of pairs"
    better, worse = pair.medians
    if better == worse or abs(worse - better) <= SAME * abs(better):
        return f"{often}, though the median costs are equal"
    if not np.isfinite(worse):
        return f"{often} and the median run of {pair.worse} failed"
    if np.isfinite(pair.ratio):
        way, ratio, (low, high) = ("lower", pair.ratio, pair.ratio_interval)
        if ratio < 1:
            way, ratio, (low, high) = "higher", 1 / ratio, (1 / high if high else np.inf, 1 / low if low else np.inf)
        return f"{often} and its median cost is {_times(ratio)} times {way} ({_times(low)} to {_times(high)})"
    way = "lower" if better < worse else "higher"
    return f"{often} and its median cost is {way} by {abs(worse - better):.3g}"


def change_sentence(pair: MethodPair) -> str:
    """At which evaluations the order changed; empty if it never did."""
    if len(pair.leads) < 2:
        return ""
    last = pair.leads[-1]
    if len(pair.leads) > MOST_CHANGES:
        return (
            f"The lead changes {len(pair.leads) - 1} times, at last to {last.method} at about "
            f"{evaluations(last.start)} evaluations."
        )
    told = [
        f"{a.method} is ahead up to about {evaluations(b.start)} evaluations"
        for a, b in zip(pair.leads, pair.leads[1:], strict=False)
    ]
    return f"{', then '.join(told)}, then {last.method}."


def order_sentence(medians: Mapping[str, float]) -> str:
    """Methods by their median cost."""
    ranked = sorted(medians, key=lambda m: (not np.isfinite(medians[m]), medians[m]))
    return "Median final cost: " + ", ".join(f"{m} {_cost(medians[m])}" for m in ranked) + "."


def target_sentence(label: str, target: CostTarget) -> str:
    """How often and how fast each method reaches a cost."""
    told = []
    for method, r in target.methods.items():
        if not r.n:
            continue
        low, high = r.rate_interval
        if r.hits == 0:
            told.append(f"{method} never in {r.n} runs (success rate below {_share(high)})")
            continue
        share = f"{_share(r.rate)} of {r.n} runs ({_share(low)} to {_share(high)})"
        spent = f"{evaluations(r.ert)} expected evaluations ({_interval([evaluations(v) for v in r.ert_interval], '')})"
        told.append(f"{method} in {share} after {spent}, {duration(r.ert_seconds)}")
    return f"Cost {target.cost:.6g} ({label}) is reached by {'; by '.join(told)}." if told else ""


def optima_sentence(shares: Sequence[float], within: float, widest: tuple[str, float] | None) -> str:
    """Whether the best runs agree on one answer; `shares` of all runs in each group of the same cost."""
    if not shares:
        return ""
    same = f"within {within:.2g} of the lowest cost"
    if len(shares) > 1:
        return (
            f"{len(shares)} distinct answers lie {same}: the cost alone does not tell them apart "
            f"(shares of all runs: {', '.join(_share(s) for s in shares[:5])}{', ...' if len(shares) > 5 else ''})."
        )
    if widest and widest[1] > 0.1:
        return (
            f"The {_share(shares[0])} of runs {same} lie in one valley: "
            f"{widest[0]} varies over {_share(widest[1])} of its bounds."
        )
    return f"The {_share(shares[0])} of runs {same} agree on one answer."


def one_problem_sentence(runs: Iterable[int]) -> str:
    """What a test on one problem says and what it does not."""
    return (
        f"All replicates are runs of one problem ({', '.join(str(n) for n in runs)} "
        "runs): the tests say which method is better here, not on other problems."
    )


def friedman_sentence(record: RankTest) -> str:
    """Average ranks of the methods over problems and whether they differ."""
    ranks = record.mean_ranks
    ordered = ", ".join(f"{m} {ranks[m]:.2f}" for m in sorted(ranks, key=lambda m: ranks[m]))
    head = f"Over {record.problems} problems the mean ranks are {ordered} (1 is best)"
    if record.p >= SIGNIFICANCE:
        return (
            f"{head}: no difference that {record.problems} problems "
            f"could show ({p_value(record.p)}, Friedman, Iman-Davenport)."
        )
    behind = [m for m, p in record.p_holm.items() if p is not None and p < SIGNIFICANCE]
    tail = (
        f"{record.best} ranks better than {', '.join(behind)}"
        if behind
        else "no single method is shown to be worse than the best"
    )
    return f"{head}: they differ ({p_value(record.p)}, Friedman, Iman-Davenport); after Holm {tail}."


def across_sentence(record: PairOverProblems) -> str:
    """Two methods over several problems."""
    n = record.problems
    effect = f"mean A12 {record.a12:.2f}, 95 % interval over problems and runs {_interval(record.a12_interval, '.2f')}"
    p, ratio = p_value(record.p_holm), record.ert_ratio
    sooner = ""
    if np.isfinite(ratio):
        word, (low, high) = ("fewer", record.ert_ratio_interval)
        if ratio < 1:
            word, ratio, low, high = "more", 1 / ratio, 1 / high, 1 / low
        sooner = f"; {ratio:.3g} times {word} expected evaluations to the target, {low:.3g} to {high:.3g}"
    if record.p_holm < SIGNIFICANCE:
        return f"{record.better} beats {record.worse} over {n} problems ({effect}{sooner}; {p}, {record.test})."
    least = smallest_p(n)
    why = (
        f"; {n} problems cannot give a p below {least:.2g}"
        if least >= SIGNIFICANCE and record.test.startswith("signed")
        else ""
    )
    return (
        f"No difference between {record.better} and {record.worse} "
        f"shown over {n} problems ({effect}{sooner}; {p}{why})."
    )


def p_value(p: float) -> str:
    """`p 0.03`, or `p < 0.0001`."""
    return "p < 0.0001" if p < 1e-4 else f"p {p:.2g}"


def evaluations(value: float) -> str:
    """A count with three digits that say something: 1230, 45600."""
    if not np.isfinite(value):
        return "infinitely many"
    return f"{float(f'{value:.3g}'):.0f}"


def duration(seconds: float) -> str:
    """Seconds in the unit that reads best."""
    if not np.isfinite(seconds):
        return "no end"
    if seconds < 1:
        return f"{1000 * seconds:.3g} ms"
    return (
        f"{seconds:.3g} s"
        if seconds < 120
        else f"{seconds / 60:.3g} min"
        if seconds < 7200
        else f"{seconds / 3600:.3g} h"
    )


def _interval(interval: Sequence[Any], form: str) -> str:
    return f"{interval[0]:{form}} to {interval[1]:{form}}"


def _times(ratio: float) -> str:
    if not np.isfinite(ratio):
        return "infinitely many"
    digits = f"{ratio:.3f}" if ratio < 1.1 else f"{ratio:.2f}" if ratio < 10 else f"{ratio:.3g}"
    return digits


def _share(share: float) -> str:
    percent = 100 * share
    return f"{percent:.3g} %" if percent >= 99.5 or percent < 1 else f"{percent:.0f} %"


def _cost(cost: float) -> str:
    return f"{cost:.6g}" if np.isfinite(cost) else "failed"
