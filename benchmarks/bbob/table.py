"""What the results say, as text: areas of everybody, methods against their references, rates."""

from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np

from benchmarks.bbob.ecdf import areas, differences, running_times
from benchmarks.bbob.results import Result
from benchmarks.bbob.suite import FUNCTIONS, TARGETS

SHOWN = (1e1, 1e-1, 1e-3, 1e-5, 1e-8)  # targets whose expected running times are printed
GROUPS = {
    "separable": range(1, 6),
    "moderate": range(6, 10),
    "ill-cond.": range(10, 15),
    "multimodal": range(15, 20),
    "weak": range(20, 25),
}

ByMethod = Mapping[str, Mapping[int, Result]]


def by_method(results: Iterable[Result], dimension: int) -> dict[str, dict[int, Result]]:
    found: dict[str, dict[int, Result]] = defaultdict(dict)
    for r in results:
        if r.dimension == dimension:
            found[r.method][r.function] = r
    return dict(found)


def area_table(of: ByMethod, dimension: int) -> list[str]:
    """One line a method, best first: mean area, areas by group of functions, functions met, runs that met 1e-8, time."""
    rows = []
    for method, results in of.items():
        area = {f: areas(r.hits(), dimension).mean() for f, r in results.items()}
        met = [np.isfinite(r.hits()[:, -1]) for r in results.values()]
        groups = [np.mean([area[f] for f in fs if f in area]) if any(f in area for f in fs) else np.nan for fs in GROUPS.values()]
        microseconds = 1e6 * sum(r.seconds for r in results.values()) / max(1, sum(r.spent.sum() for r in results.values()))
        rows.append((np.mean(list(area.values())), method, groups, sum(m.any() for m in met), np.concatenate(met), microseconds))
    rows.sort(key=lambda row: -row[0])
    lines = [
        f"{dimension}-D, area under the ECDF (1: all targets within d evaluations)",
        f"{'method':28}{'all':>7}" + "".join(f"{g:>12}" for g in GROUPS) + f"{'functions':>11}{'runs':>10}{'us/eval':>9}",
    ]
    for mean, method, groups, solved, met, microseconds in rows:
        part = "" if len(of[method]) == len(FUNCTIONS) else f"  ({len(of[method])} functions)"
        lines.append(
            f"{method:28}{mean:7.3f}" + "".join(f"{g:12.3f}" for g in groups) + f"{solved:11}{met.mean():10.1%}{microseconds:9.1f}{part}"
        )
    return lines


def comparison_table(of: ByMethod, pairs: Iterable[tuple[str, str]], dimension: int) -> list[str]:
    """One line a pair: areas, wins and losses, signed-rank p after Holm, A12, and the ratio of expected running times to 1e-8."""
    there = [(a, b) for a, b in pairs if a in of and b in of and set(of[a]) & set(of[b])]
    if not there:
        return []
    each = {m: {f: areas(r.hits(), dimension) for f, r in of[m].items()} for m in {m for pair in there for m in pair}}
    lines = [
        f"{dimension}-D, methods against references (p: Wilcoxon over functions, Holm over the lines of this table)",
        f"{'method':28}{'reference':24}{'area':>7}{'its':>7}{'won':>5}{'lost':>5}{'p':>10}{'p Holm':>10}{'A12':>7}"
        f"{'ERT ratio':>11}{'on':>4}",
    ]
    for d in differences(each, there):
        ratio, both = ert_ratio(of[d.method], of[d.reference])
        lines.append(
            f"{d.method:28}{d.reference:24}{d.area:7.3f}{d.reference_area:7.3f}{d.better:5}{d.worse:5}{d.p:10.2g}{d.p_holm:10.2g}"
            f"{d.effect:7.3f}{ratio:11.2f}{both:4}"
        )
    return lines


def ert_ratio(ours: Mapping[int, Result], theirs: Mapping[int, Result]) -> tuple[float, int]:
    """Geometric mean over functions of ERT / reference's ERT at the hardest target that both met, and how many functions."""
    logs = []
    for f in sorted(set(ours) & set(theirs)):
        mine, other = (running_times(r.hits(), r.spent) for r in (ours[f], theirs[f]))
        both = np.flatnonzero(np.isfinite(mine) & np.isfinite(other))
        if len(both):
            logs.append(np.log(mine[both[-1]] / other[both[-1]]))
    return (float(np.exp(np.mean(logs))), len(logs)) if logs else (float("nan"), 0)


def running_time_table(of: ByMethod, methods: Iterable[str], dimension: int) -> list[str]:
    """Expected evaluations / d until the targets SHOWN, one line a method and function."""
    columns = [int(np.argmin(np.abs(np.log(TARGETS / t)))) for t in SHOWN]
    lines = [f"{dimension}-D, expected running time / d", f"{'method':28}{'f':>3}" + "".join(f"{t:>10.0e}" for t in SHOWN) + f"{'met':>7}"]
    for method in methods:
        for f, r in sorted(of.get(method, {}).items()):
            times = running_times(r.hits(), r.spent)[columns] / dimension
            met = int(np.isfinite(r.hits()[:, -1]).sum())
            lines.append(f"{method:28}{f:3}" + "".join(f"{t:10.4g}" for t in times) + f"{met:4}/{len(r.spent)}")
    return lines
