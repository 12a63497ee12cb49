"""Whether the estimates of several methods differ by more than chance lets them."""

from collections.abc import Mapping, Sequence

import numpy as np

from plantfit.estimate.comparison import SURE, Comparison, compare_estimates
from plantfit.estimate.estimate import Estimate
from plantfit.findings.results.estimated import MethodPair

Estimated = tuple[Estimate, Mapping[str, tuple[float | None, float | None]]]
"""An estimate, and the 95 % interval (low, high) of each parameter; None for an end that is not known."""


def agreement(estimates: Mapping[str, Estimated], tested: MethodPair | None = None) -> list[MethodPair]:
    """Every two methods, with p-values corrected for how many pairs there are (Holm); one pair may have been `tested`
    by a test of its own."""
    pairs: list[tuple[str, str, MethodPair | Comparison]] = []
    methods = list(estimates)
    for i, a in enumerate(methods):
        for b in methods[i + 1 :]:
            names = [n for n in estimates[a][0].names if _known(estimates[a], n) and _known(estimates[b], n)]
            if not names:
                continue
            if tested is not None and {a, b} == {tested.first, tested.second}:
                pairs.append((b, a, tested))
                continue
            found = compare_estimates(_part(estimates[b][0], names), _part(estimates[a][0], names), (b, a))
            pairs.append((b, a, found))
    worst, adjusted = 0.0, {}
    for k, (b, a, found) in enumerate(sorted(pairs, key=lambda pair: _chance(pair[2]))):
        worst = max(worst, min(1.0, (len(pairs) - k) * _chance(found)))
        adjusted[b, a] = worst
    return [
        MethodPair(
            first=b, second=a, statistic=found.statistic, degrees=found.degrees, p=_chance(found),
            sentence=found.sentence,
            p_adjusted=adjusted[b, a], differs=adjusted[b, a] < SURE,
        )
        for b, a, found in pairs
    ]  # fmt: skip


def _chance(found: MethodPair | Comparison) -> float:
    return found.p_value if isinstance(found, Comparison) else found.p if found.p is not None else 1.0


def _known(estimated: Estimated, name: str) -> bool:
    """Whether a method gives a parameter an error and both ends of an interval."""
    estimate, interval = estimated
    if name not in estimate.names or None in interval[name]:
        return False
    error = estimate.standard_error[estimate.names.index(name)]
    return bool(np.isfinite(error) and error > 0)


def _part(estimate: Estimate, names: Sequence[str]) -> Estimate:
    at = [estimate.names.index(n) for n in names]
    return Estimate(tuple(names), estimate.values[at], estimate.covariance[np.ix_(at, at)])
