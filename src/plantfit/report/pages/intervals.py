"""Intervals of several kinds as a page and as rows of a table."""

from typing import Any

from plantfit.findings.results.intervals_compared import ComparisonOfIntervals, KindOfInterval
from plantfit.report.figures.comparison.intervals import intervals_figure, profile_figure
from plantfit.report.numbers import UNKNOWN, interval, significant, unit_label

MOST_DRAWN = 40  # parameters
NOTE = (
    "verdict: the report's own, at 95 %. covariance: the linearised problem, allowing for correlated "
    "residuals. profile: all others refitted. bootstrap: refits of records with resampled blocks of "
    "residuals. posterior: draws by NUTS. < and > mark ends at a bound of the search."
)


def interval_rows(found: ComparisonOfIntervals, ascii_only: bool = True) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of texts: a row for each parameter, a column for each kind."""
    kinds = list(dict.fromkeys(k.kind for p in found.parameters for k in p.kinds))
    rows = []
    for p in found.parameters:
        unit = (p.unit or "") if ascii_only else unit_label(p.unit)
        own = {k.kind: k for k in p.kinds}
        cells = [_cell(own.get(kind), ascii_only) for kind in kinds]
        rows.append(
            [f"{p.name} [{unit}]" if unit not in ("", "1") else p.name, significant(p.value, 4, ascii_only), *cells]
        )
    return ["parameter", "value", *kinds], rows


def intervals_page(found: ComparisonOfIntervals) -> dict[str, Any]:
    """The record of a page (`report.case_page`)."""
    head, rows = interval_rows(found, ascii_only=False)
    drawn = found.parameters[:MOST_DRAWN]
    profiles = [p for p in drawn if any(len(k.points) > 2 or k.sample for k in p.kinds)]
    sections: list[dict[str, Any]] = [
        {
            "title": "Intervals side by side",
            "verdict": [v.plain() for v in found.verdict],
            "tables": [{"caption": f"{100 * found.level:g} %", "columns": head, "rows": rows, "note": NOTE}],
            "figures": [{"figure": intervals_figure(p), "label": f"Intervals of {p.name}"} for p in drawn],
        }
    ]
    if profiles:
        sections.append(
            {
                "title": "Profiles and draws",
                "sentences": [
                    "The profile is how much the sum of squares grows, all other parameters refitted, as a share of "
                    "the threshold of the "
                    "level. Bars are refits of the bootstrap and draws of the posterior, the highest bar of each as "
                    "high as the threshold."
                ],
                "figures": [{"figure": profile_figure(p), "label": f"Profile and draws of {p.name}"} for p in profiles],
            }
        )
    count = len(found.parameters)
    level = f"{100 * found.level:g} % intervals of {count} parameter{'s' if count != 1 else ''}"
    return {"title": f"Intervals: {found.name}", "subtitle": level, "sections": sections}


def _cell(k: KindOfInterval | None, ascii_only: bool) -> str:
    if k is None or k.low is None:
        return "-" if ascii_only else UNKNOWN
    text = interval(k.low, k.high, ascii_only)
    low, sign, high = text.partition(" to ")
    return f"{'<' if k.open_low else ''}{low}{sign}{'>' if k.open_high else ''}{high}"
