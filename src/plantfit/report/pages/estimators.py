"""Estimates of several methods as a page and as rows of a table."""

from collections.abc import Mapping
from typing import Any

from plantfit.findings.results.estimated import EstimatedParameter, EstimateOfMethod, EstimatesByMethod, NoiseLevel
from plantfit.report.figures.pages.constants import constants_figure
from plantfit.report.numbers import UNKNOWN, interval, significant, unit_label

MOST_DRAWN = 24  # parameters in a figure
NOTE = (
    "Value and 95 % interval. Least squares: intervals that follow the valley of the cost. Maximum likelihood: "
    "symmetric on the scale of "
    "each parameter, errors may be correlated. Generalised least squares: the same, for the noise that the residuals "
    "show. Filters: what they believe after the last sample."
)


def estimators_rows(record: EstimatesByMethod, ascii_only: bool = False) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of texts: a row for each parameter, a column for each method."""
    known = any(p.truth is not None for p in record.parameters)
    rows = []
    for p in record.parameters:
        cells = [_cell(p.estimates.get(m), ascii_only) for m in record.methods]
        truth = [significant(p.truth, 5, ascii_only)] if known and p.truth is not None else [""] if known else []
        rows.append([_named(p, ascii_only), *cells, *truth])
    return ["parameter", *record.methods, *(["truth"] if known else [])], rows


def noise_rows(record: EstimatesByMethod, ascii_only: bool = False) -> tuple[list[str], list[list[str]]]:
    """The same of the noise levels."""
    rows = [
        [
            f"{r.kind} {_named(r, ascii_only)}",
            significant(r.value, 4, ascii_only),
            _range(r.low, r.high, ascii_only),
            r.how,
        ]
        for r in record.noise
    ]
    return ["noise", "standard deviation", "95 % interval", "how"], rows


def estimators_page(record: EstimatesByMethod, runs: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The record of a page (`report.case_page`); `runs` are filters by method and recording."""
    head, rows = estimators_rows(record)
    noise_head, levels = noise_rows(record)
    tables = [{"caption": "Parameters by method", "columns": head, "rows": rows, "note": NOTE}]
    if levels:
        tables.append(
            {
                "caption": "Noise",
                "columns": noise_head,
                "rows": levels,
                "note": "Process noise: by how much it moves a state in a second.",
            }
        )
    pairs = [[f"{p.first} and {p.second}", significant(p.statistic, 3), str(p.degrees), _p(p.p), _p(p.p_adjusted),
              "yes" if p.differs else "no"] for p in record.agreement]  # fmt: skip
    if pairs:
        tables.append(
            {
                "caption": "Do the methods differ?",
                "columns": ["methods", "chi-squared", "degrees of freedom", "p", "p, corrected", "beyond chance"],
                "rows": pairs,
                "note": "Both estimates come from the same samples, and the test counts them as independent: it is "
                "careful. Generalised least squares and least squares are compared by Hausman's test, which does not.",
            }
        )
    drawn = {m: _tracks(own) for m, own in runs.items()}
    figures = [
        {
            "figure": constants_figure(tracks[:MOST_DRAWN], _references(record), "least squares, 95 %", _truth(record)),
            "label": f"How each constant settles in the {m} over {recording}: value and two standard deviations.",
        }
        for m, own in drawn.items()
        for recording, tracks in own.items()
        if tracks
    ]
    sections: list[dict[str, Any]] = [
        {"title": "Verdict", "verdict": [v.plain() for v in record.verdict], "tables": tables}
    ]
    if figures:
        sections.append({"title": "How the constants settle", "figures": figures})
    if record.assumed:
        sections.append(
            {"title": "What was assumed", "sentences": [f"{s[:1].upper()}{s[1:]}." for s in record.assumed]}
        )
    return {"title": record.name, "subtitle": "Parameters by several methods", "sections": sections}


def _tracks(runs: Mapping[str, Any]) -> dict[str, list[Any]]:
    return {recording: [run.track(n) for n in run.parameters] for recording, run in runs.items()}


def _references(record: EstimatesByMethod) -> dict[str, tuple[float, float, float]]:
    found = {}
    for p in record.parameters:
        own = p.estimates.get("least squares")
        if own is not None and own.value is not None and own.low is not None and own.high is not None:
            found[p.name] = own.value, own.low, own.high
    return found


def _truth(record: EstimatesByMethod) -> dict[str, float]:
    return {p.name: p.truth for p in record.parameters if p.truth is not None}


def _named(row: EstimatedParameter | NoiseLevel, ascii_only: bool) -> str:
    unit = (row.unit or "") if ascii_only else unit_label(row.unit)
    return f"{row.name} [{unit}]" if unit not in ("", "1") else row.name


def _cell(estimate: EstimateOfMethod | None, ascii_only: bool) -> str:
    if estimate is None:
        return "held"
    value = significant(estimate.value, 4, ascii_only)
    inside = _range(estimate.low, estimate.high, ascii_only) or (
        "at a bound" if estimate.at_bound else "not determined"
    )
    return f"{value} ({inside})" if ascii_only else f"{value}\n{inside}"  # on a page the interval has a line of its own


def _range(low: float | None, high: float | None, ascii_only: bool) -> str:
    return "" if low is None or high is None else interval(low, high, ascii_only)


def _p(p: float | None) -> str:
    return UNKNOWN if p is None else f"{p:.2g}" if p > 0 else "below 1e-300"
