"""A comparison of recordings as a page and as rows of a table."""

from typing import Any

from plantfit.findings.heterogeneity import Estimated
from plantfit.findings.results.records_compared import ComparisonOfRecords
from plantfit.report.figures.comparison.forest import forest_figure
from plantfit.report.numbers import UNKNOWN, interval, plus_minus, significant, unit_label

MOST_DRAWN = 60  # parameters
NOTE = (
    "Every recording fitted alone, from the joint answer and by a search within the same bounds. "
    "Value and standard error; p of Cochran's Q over the recordings (Welch), corrected for all "
    "tests (Holm). A star marks what the data of a recording alone do not determine: not compared."
)


def records_rows(found: ComparisonOfRecords, ascii_only: bool = False) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of texts: a row for each parameter, a column for each recording."""
    names = [r.name for r in found.recordings]
    label = (lambda unit: unit or "") if ascii_only else unit_label
    rows = []
    for p in found.parameters:
        tail = f" [{label(p.unit)}]" if label(p.unit) not in ("", "1") else ""
        cells = [_cell(a, ascii_only) + ("" if a.tested else "*") for a in p.alone]
        rows.append([p.name + tail, *cells, _cell(p.joint, ascii_only), _chance(p.p_adjusted, ascii_only)])
    unit = label(found.unit)
    tail = f" [{unit}]" if unit not in ("", "1") else ""
    rows.append([f"RMSE, own values{tail}", *(_number(r.rmse_alone, 4, ascii_only) for r in found.recordings), "", ""])
    rows.append(
        [f"RMSE, joint values{tail}", *(_number(r.rmse_joint, 4, ascii_only) for r in found.recordings), "", ""]
    )
    return ["", *names, "all", "p"], rows


def records_page(found: ComparisonOfRecords) -> dict[str, Any]:
    """The record of a page (`report.case_page`)."""
    head, rows = records_rows(found)
    tables = [{"caption": "Parameters", "columns": ["parameter", *head[1:]], "rows": rows, "note": NOTE}]
    moved = _moved_rows(found)
    if moved:
        columns = ["recording", "parameter", "there", "in the others", "moved by", "p", "beyond chance"]
        tables.append(
            {
                "caption": "What moved",
                "columns": columns,
                "rows": moved,
                "note": "Against the weighted mean of the others.",
            }
        )
    tests = [
        [
            p.name, significant(p.q, 3), significant(p.degrees, 3), _chance(p.p, False), _chance(p.p_adjusted, False),
            f"{100 * (p.i_squared or 0.0):.0f} %", f"{significant(p.between, 2)} {unit_label(p.unit)}".strip(),
        ]
        for p in found.parameters
        if p.p is not None
    ]  # fmt: skip
    if found.together is not None:
        t = found.together
        chances = _chance(t.p, False), _chance(t.p_adjusted, False)
        tests.append(["all together", significant(t.q, 3), significant(t.degrees, 3), *chances, "", ""])
    if tests:
        note = (
            "I²: share of the scatter that is more than the standard errors explain; then the standard deviation "
            "between recordings."
        )
        tables.append(
            {
                "caption": "Tests", "columns": ["parameter", "Q", "degrees of freedom", "p", "p, corrected", "I²",
                                                "between recordings"],
                "rows": tests, "note": note,
            }
        )  # fmt: skip
    apart = {a.recording for a in found.apart} | set(found.either)
    figures = [
        {
            "figure": forest_figure(p, apart),
            "label": f"{p.name} of every recording alone and of all: value and 95 % interval; the band is the joint "
            f"interval.",
        }
        for p in found.parameters[:MOST_DRAWN]
    ]
    return {
        "title": found.name,
        "subtitle": "Do the recordings agree?",
        "sections": [
            {"title": "Verdict", "verdict": [v.plain() for v in found.verdict], "tables": tables},
            {"title": "Each parameter", "figures": figures},
        ],
    }


def _moved_rows(found: ComparisonOfRecords) -> list[list[str]]:
    rows = []
    for a in found.apart:
        for m in a.moved:
            unit = unit_label(m.unit)
            share = "" if m.share is None else f" ({100 * m.share:+.3g} %)"
            there, others = plus_minus(m.value, m.standard_error), plus_minus(m.others, m.others_error)
            by = f"{significant(m.by, 3)} {unit}".strip() + share
            p, told = _chance(m.p_adjusted, False), "yes" if m.told else "no"
            rows.append([a.recording, m.name, f"{there} {unit}".strip(), f"{others} {unit}".strip(), by, p, told])
    return rows


def _cell(row: Estimated, ascii_only: bool) -> str:
    if row.standard_error is None:
        low, high = row.low, row.high
        text = (
            significant(row.value, 4)
            if low is None or high is None
            else f"{significant(row.value, 3)} ({interval(low, high)})"
        )
    else:
        text = plus_minus(row.value, row.standard_error, ascii_only)
    return (
        text.replace("±", "+-").replace("\u2212", "-").replace(UNKNOWN, "-").replace("\u2013", "-")
        if ascii_only
        else text
    )


def _chance(p: float | None, ascii_only: bool) -> str:
    """A p-value; below 1e-9 its size means nothing."""
    return "<1e-9" if p is not None and p < 1e-9 else _number(p, 2, ascii_only)


def _number(value: float | None, digits: int, ascii_only: bool) -> str:
    return significant(value, digits, ascii_only=ascii_only).replace(UNKNOWN, "-" if ascii_only else UNKNOWN)
