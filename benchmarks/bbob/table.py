"""What the results say, as text: areas of everybody, methods against their references, rates."""

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from benchmarks.bbob.ecdf import Difference, areas, differences, running_times, shares
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
    """One line a method, best first: mean area, areas by group of functions, functions met, runs that met 1e-8,
    time."""
    rows = []
    for method, results in of.items():
        area = {f: areas(r.hits(), dimension).mean() for f, r in results.items()}
        met = [np.isfinite(r.hits()[:, -1]) for r in results.values()]
        groups = [
            np.mean([area[f] for f in fs if f in area]) if any(f in area for f in fs) else np.nan
            for fs in GROUPS.values()
        ]
        microseconds = (
            1e6 * sum(r.seconds for r in results.values()) / max(1, sum(r.spent.sum() for r in results.values()))
        )
        rows.append(
            (np.mean(list(area.values())), method, groups, sum(m.any() for m in met), np.concatenate(met), microseconds)
        )
    rows.sort(key=lambda row: -row[0])
    lines = [
        f"{dimension}-D, area under the ECDF (1: all targets within d evaluations)",
        f"{'method':28}{'all':>7}"
        + "".join(f"{g:>12}" for g in GROUPS)
        + f"{'functions':>11}{'runs':>10}{'us/eval':>9}",
    ]
    for mean, method, groups, solved, met, microseconds in rows:
        part = "" if len(of[method]) == len(FUNCTIONS) else f"  ({len(of[method])} functions)"
        lines.append(
            f"{method:28}{mean:7.3f}"
            + "".join(f"{g:12.3f}" for g in groups)
            + f"{solved:11}{met.mean():10.1%}{microseconds:9.1f}{part}"
        )
    return lines


def paired(of: ByMethod, pairs: Iterable[tuple[str, str]]) -> list[tuple[str, str]]:
    """The pairs that have a function in common."""
    return [(a, b) for a, b in pairs if a in of and b in of and set(of[a]) & set(of[b])]


def common_runs(of: ByMethod, pair: tuple[str, str]) -> tuple[dict[int, Result], dict[int, Result]]:
    """Results of both on the functions and instances that both have."""
    ours, theirs = (of[m] for m in pair)
    functions = sorted(set(ours) & set(theirs))
    found = [(f, np.intersect1d(ours[f].instances, theirs[f].instances)) for f in functions]
    found = [(f, instances) for f, instances in found if len(instances)]
    return {f: ours[f].only(i) for f, i in found}, {f: theirs[f].only(i) for f, i in found}


def compared(
    of: ByMethod, pairs: Iterable[tuple[str, str]], measure: Callable[[Result], np.ndarray], without: Iterable[int] = ()
) -> list[Difference]:
    """Differences of a measure (runs,) over the functions of each pair, but for those in `without`; Holm over the
    pairs."""
    each: dict[str, dict[int, np.ndarray]] = {}
    names: list[tuple[str, str]] = []
    for k, pair in enumerate(pairs):
        # a reference may have more instances for one method than for another
        name = f"{k} {pair[0]}", f"{k} {pair[1]}"
        for key, results in zip(name, common_runs(of, pair), strict=True):
            each[key] = {f: measure(r) for f, r in results.items() if f not in without}
        names.append(name)
    found = differences(each, names)
    return [replace(d, method=a, reference=b) for d, (a, b) in zip(found, pairs, strict=True)]


def area(result: Result) -> np.ndarray:
    return areas(result.hits(), result.dimension)


def at_the_end(result: Result) -> np.ndarray:
    return shares(result.hits())


def comparison_table(of: ByMethod, pairs: Iterable[tuple[str, str]], dimension: int) -> list[str]:
    """One line a pair: areas, wins and losses, signed-rank p after Holm, A12, and the ratio of expected running
    times to 1e-8."""
    there = paired(of, pairs)
    if not there:
        return []
    lines = [
        f"{dimension}-D, methods against references (p: Wilcoxon over functions, Holm over the lines of this table)",
        f"{'method':28}{'reference':24}{'area':>7}{'its':>7}{'won':>5}{'lost':>5}{'p':>10}{'p Holm':>10}{'A12':>7}"
        f"{'ERT ratio':>11}{'on':>4}",
    ]
    for d in compared(of, there, area):
        ratio, both = ert_ratio(*common_runs(of, (d.method, d.reference)))
        lines.append(
            f"{d.method:28}{d.reference:24}{d.area:7.3f}{d.reference_area:7.3f}{d.better:5}{d.worse:5}{d.p:10.2g}{d.p_holm:10.2g}"
            f"{d.effect:7.3f}{ratio:11.2f}{both:4}"
        )
    return lines


SLOPE = (5,)  # the linear slope, whose optimum is a corner of the box: it tells how bounds are kept and little else


def page_table(of: ByMethod, pairs: Iterable[tuple[str, str]], dimension: int) -> list[str]:
    """The two tables of docs/bbob.md for one dimension, in Markdown: areas, then the same without f5 and targets at the
    end.

    A method that is behind by more than chance (p < 0.05 after Holm) stands in bold.
    """
    there = paired(of, pairs)
    if not there:
        return []
    areas_of, end, sloped = compared(of, there, area), compared(of, there, at_the_end), compared(of, there, area, SLOPE)
    first = [
        f"Area in {dimension}-D:", "",
        "| ours | reference | instances | area | its | won | lost | p (Holm) | A12 | ratio of ERT |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]  # fmt: skip
    second = [
        "", f"Without the linear slope f5, and targets reached at the end of the budget, in {dimension}-D:", "",
        "| ours | reference | area without f5 | its | won | lost | p (Holm) | reached | its | won | lost | p (Holm) |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]  # fmt: skip
    for a, e, s in zip(areas_of, end, sloped, strict=True):
        common = common_runs(of, (a.method, a.reference))
        ratio, _ = ert_ratio(*common)
        runs = min(len(r.instances) for r in common[0].values())
        part = "" if len(common[0]) == len(FUNCTIONS) else f" ({len(common[0])} functions)"
        first.append(
            f"| {_name(a.method, a)} | {a.reference}{part} | {runs} | {_cells(a)} | {a.effect:.3f} | {ratio:.2f} |"
        )
        second.append(f"| {_name(a.method, s, e)} | {a.reference}{part} | {_cells(s)} | {_cells(e)} |")
    return first + second


def _name(method: str, *differences: Difference) -> str:
    behind = any(d.p_holm < 0.05 and d.area < d.reference_area for d in differences)
    return f"**`{method}`**" if behind else f"`{method}`"


def _cells(d: Difference) -> str:
    return f"{d.area:.3f} | {d.reference_area:.3f} | {d.better} | {d.worse} | {d.p_holm:.2g}"


def ert_ratio(ours: Mapping[int, Result], theirs: Mapping[int, Result]) -> tuple[float, int]:
    """Geometric mean over functions of ERT / reference's ERT at the hardest target that both met, and how many
    functions."""
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
    lines = [
        f"{dimension}-D, expected running time / d",
        f"{'method':28}{'f':>3}" + "".join(f"{t:>10.0e}" for t in SHOWN) + f"{'met':>7}",
    ]
    for method in methods:
        for f, r in sorted(of.get(method, {}).items()):
            times = running_times(r.hits(), r.spent)[columns] / dimension
            met = int(np.isfinite(r.hits()[:, -1]).sum())
            lines.append(f"{method:28}{f:3}" + "".join(f"{t:10.4g}" for t in times) + f"{met:4}/{len(r.spent)}")
    return lines
