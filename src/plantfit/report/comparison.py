"""The page of a comparison of methods."""

from pathlib import Path
from typing import Any

from plantfit.findings.results.methods_compared import ComparisonOfMethods, OverProblems
from plantfit.report import html
from plantfit.report.drawings import Drawings
from plantfit.report.figures.comparison import curves
from plantfit.report.sections import comparison_tables as tables
from plantfit.report.sections.comparison import said, section
from plantfit.report.sections.sentences import listed, many


def write_comparison(record: ComparisonOfMethods, path: str | Path) -> Path:
    """Write the page of a comparison (`plantfit.study.comparing.record.compared`) to `path` and return it.

    The file appears whole or not at all; StoreError when the folder is missing or cannot be written to.
    """
    return html.write_page(path, render_comparison(record))


def render_comparison(record: ComparisonOfMethods) -> str:
    """The page of a comparison record as text."""
    drawings = Drawings()
    runs = sum(m.runs for p in record.problems for m in p.methods)
    names = list(dict.fromkeys(m.name for p in record.problems for m in p.methods))
    context = {
        "title": record.name,
        "subtitle": f"{many(runs, 'run')} of {listed(names)} on {many(len(record.problems), 'problem')}.",
        "across": _across(record.across, drawings) if record.across else None,
        "problems": [section(p, drawings) for p in record.problems],
        "facts": [(name, str(value)) for name, value in record.reproduction.items()],
    }
    return html.render_page("comparison.html", context | {"figures": drawings.json})


def _across(across: OverProblems, drawings: Drawings) -> dict[str, Any]:
    profile = None
    if across.profile and across.profile.at:
        figure = curves.ecdf_figure(across.profile, "evaluations / (parameters + 1)")
        profile = drawings.add(
            figure, "Data profile: share of problems, targets and runs reached against evaluations per dimension."
        )
    return {
        "says": [said("info", s) for s in across.sentences],
        "ranks": tables.ranks_table(across),
        "profile": profile,
        "profile_note": "Data profile: share of all (problem, target, run) that were reached.",
    }
