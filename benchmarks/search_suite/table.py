"""Tables for a terminal."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.search_suite.judge import Verdict
from benchmarks.search_suite.nist import WANTED, Score
from benchmarks.search_suite.truths import Truth


def suite_table(verdicts: Sequence[Verdict], truths: Mapping[str, Truth]) -> list[str]:
    """One line for each problem, the sums below."""
    lines = [
        f"{'problem':22}{'one search':>11}{'found':>8}{'converged':>11}{'false':>7}{'unfin.':>8}"
        f"{'miscnt':>8}{'stray':>9}{'evaluations':>13}{'seconds':>9}"
    ]
    for name in dict.fromkeys(v.problem for v in verdicts):
        own = [v for v in verdicts if v.problem == name]
        lines.append(_row(name, f"{100 * truths[name].trust_region.share:.1f} %", own))
    lines.append(_row(f"all {len({v.problem for v in verdicts})} problems", "", verdicts))
    whole = [n for n in dict.fromkeys(v.problem for v in verdicts) if all(v.found for v in verdicts if v.problem == n)]
    lines.append(
        f"found in {100 * sum(v.found for v in verdicts) / len(verdicts):.1f} % of the runs; "
        f"{len(whole)} of {len({v.problem for v in verdicts})} problems with every seed"
    )
    return lines


def _row(name: str, single: str, own: Sequence[Verdict]) -> str:
    count = lambda field: sum(getattr(v, field) for v in own)  # noqa: E731
    found, converged = f"{count('found')}/{len(own)}", sum(v.status == "converged" for v in own)
    return (
        f"{name:22}{single:>11}{found:>8}{converged:>11}{count('false_convergence'):>7}{count('unfinished'):>8}"
        f"{count('miscounted'):>8}{count('stray'):>5}/{count('rerun'):<3}{count('evaluations') / len(own):>13.0f}"
        f"{count('seconds') / len(own):>9.2f}"
    )


def nist_table(scores: Sequence[Score]) -> list[str]:
    """One line for each fit, the counts below."""
    begin, end = (
        f"{'set':10}{'begin':>9}{'seed':>6}{'digits':>8}{'squares/certified':>19}  ",
        f"{'starts':>8}{'evals':>8}{'s':>7}",
    )
    lines = [f"{begin}{'status':10}{'hits':>6}{end}"]
    for s in scores:
        mark = "" if s.passed else "  <"
        lines.append(
            f"{s.name:10}{s.begin:>9}{s.seed:>6}{s.digits:>8.1f}{s.squares_ratio:>19.10g}  "
            f"{s.status:10}{s.hits!s:>6}{s.starts!s:>8}"
            f"{s.evaluations:>8.0f}{s.seconds:>7.2f}{mark}"
        )
    for begin in dict.fromkeys(s.begin for s in scores):
        own = [s for s in scores if s.begin == begin]
        lines.append(
            f"{WANTED:.0f} digits, {'no start' if begin == 'none' else begin}: "
            f"{sum(s.passed for s in own)} of {len(own)}"
        )
    return lines


def change_table(before: Mapping[str, Any], after: Mapping[str, Any]) -> list[str]:
    """Problems of both records: found, false convergence and mean evaluations before and after; fits of NIST with
    their digits."""
    lines = [f"{'problem':22}{'found':>16}{'false':>12}{'evaluations':>18}"]
    names = [
        n
        for n in dict.fromkeys(v["problem"] for v in after["suite"])
        if any(v["problem"] == n for v in before["suite"])
    ]
    for name in [*names, None]:
        pairs = [
            [v for v in r["suite"] if v["problem"] == name or (name is None and v["problem"] in names)]
            for r in (before, after)
        ]
        if not all(pairs):
            continue
        found, wrong = ([sum(v[k] for v in own) for own in pairs] for k in ("found", "false_convergence"))
        spent = [sum(v["evaluations"] for v in own) / len(own) for own in pairs]
        lines.append(
            f"{name or f'all {len(names)}':22}{f'{found[0]}/{len(pairs[0])} -> {found[1]}/{len(pairs[1])}':>16}"
            f"{f'{wrong[0]} -> {wrong[1]}':>12}{f'{spent[0]:.0f} -> {spent[1]:.0f}':>18}"
        )
    old = {(s["name"], s["begin"], s["seed"]): s["digits"] for s in before["nist"]}
    for s in after["nist"]:
        key = s["name"], s["begin"], s["seed"]
        if key in old and (old[key] >= WANTED) != (s["digits"] >= WANTED):
            lines.append(f"{s['name']:10} {s['begin']:8} seed {s['seed']}: {old[key]:.1f} -> {s['digits']:.1f} digits")
    return lines
