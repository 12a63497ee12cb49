"""`python -m benchmarks.search_suite.page`: the tables of docs/search-suite.md from the kept results, as Markdown."""

import json
from pathlib import Path
from typing import Any

from benchmarks.search_suite import truths
from benchmarks.search_suite.suite import CASES

FOLDER = Path(__file__).parent
Runs = list[dict[str, Any]]


def kept(name: str) -> Runs:
    """The runs of one of the kept files."""
    return json.loads((FOLDER / name).read_text("utf-8"))["suite"]


def sums_row(title: str, runs: Runs) -> str:
    """Counts over all runs."""
    found, total = sum(r["found"] for r in runs), len(runs)
    converged = sum(r["status"] == "converged" for r in runs)
    wrong = " | ".join(
        str(sum(bool(r[key]) for r in runs)) for key in ("false_convergence", "unfinished", "miscounted")
    )
    stray = f"{sum(r['stray'] for r in runs)} of {sum(r['rerun'] for r in runs)}"
    return f"| {title} | {total} | {found} ({100 * found / total:.1f} %) | {converged} | {wrong} | {stray} |"


def cell(runs: Runs) -> str:
    """Runs that found the optimum, and mean evaluations; empty without runs."""
    if not runs:
        return " | "
    return f"{sum(r['found'] for r in runs)}/{len(runs)} | {sum(r['evaluations'] for r in runs) / len(runs):.0f}"


def tables() -> list[str]:
    """Both tables, line by line."""
    before, now, without = kept("baseline.json"), kept("results.json"), kept("results_without_projection.json")
    known = truths.load()
    linear = {r["problem"] for r in without}
    lines = [
        "| | runs | found | converged | false | unfinished | miscounted | stray of re-run ends |",
        "|---|---|---|---|---|---|---|---|",
        sums_row("before", before),
        sums_row("now, all problems", now),
        sums_row("now, those with a linear part", [r for r in now if r["problem"] in linear]),
        sums_row("the same, not solved for", without),
        "",
        "| problem | d | linear | one search | before | evals | now | evals | not solved for | evals |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(r["problem"] for r in now):
        own = [[r for r in runs if r["problem"] == name] for runs in (before, now, without)]
        facts = (
            f"{CASES[name].problem().space.dimension} | {own[1][0]['solved_for']} | "
            f"{100 * known[name].trust_region.share:.1f} %"
        )
        lines.append(f"| {name} | {facts} | {' | '.join(map(cell, own))} |")
    return lines


if __name__ == "__main__":
    print("\n".join(tables()))
