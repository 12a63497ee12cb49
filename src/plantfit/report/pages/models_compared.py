"""A comparison of models as a page and as rows of a table."""

from typing import Any

from plantfit.findings.results.models_compared import ComparisonOfModels, Errors, OutputErrors
from plantfit.report.figures.comparison.models import overlay_figure
from plantfit.report.numbers import UNKNOWN, significant, unit_label

POINTS_IN_FILE, MOST_POINTS, FEWEST_POINTS = 120_000, 4000, 300  # samples drawn: in all, per signal
NOTE = (
    "RMSE by simulation from the recorded inputs, not one step ahead. Unseen: samples that no model was fitted to. "
    "Left out: samples as "
    "predicted by fits without the fifth of the recording that they lie in. AICc and BIC: above the least of the "
    "models, residuals counted "
    "by what their correlation leaves of them."
)


def models_rows(found: ComparisonOfModels, ascii_only: bool = False) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of texts of the table of models."""
    outputs = list(found.models[0].outputs.items())
    word = found.judged_by
    many = len(outputs) > 1
    head = ["model", "parameters", "determined"]
    for name, o in outputs:
        unit = unit_label(o.unit) if not ascii_only else (o.unit or "")
        tail = (f" {name}" if many else "") + (f" [{unit}]" if unit not in ("", "1") else "")
        head += [f"RMSE fitted{tail}", f"RMSE {word}{tail}"]
    if many:
        head.append(f"RMSE {word}, scaled")
    head += ["AICc", "BIC"]
    rows = []
    for m in found.models:
        known = UNKNOWN if m.determined is None else f"{m.determined.count} of {m.determined.of}"
        cells = [m.name, str(m.free), known.replace(UNKNOWN, "-") if ascii_only else known]
        for o in m.outputs.values():
            cells += [_text(o.fit, ascii_only), _text(_judged(o, word), ascii_only)]
        if many:
            cells.append(_text(_judged(m.rmse, word), ascii_only))
        rows.append(
            [*cells, *(f"{v:.1f}" if v is not None and abs(v) < 1e6 else _text(v, ascii_only) for v in (m.aicc, m.bic))]
        )
    return head, rows


def pair_rows(found: ComparisonOfModels) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of texts of the table of differences."""
    unit = unit_label(found.unit)
    head = [
        "better",
        "than",
        f"RMSE less by{f' [{unit}]' if unit else ''}",
        "± (95 %)",
        "p",
        "degrees of freedom",
        "told apart",
    ]
    rows = [
        [
            p.better, p.worse, significant(p.difference, 3), significant(p.half_width, 2), f"{p.p:.2g}", str(p.degrees),
            "yes" if p.told else "no",
        ]
        for p in found.pairs
    ]  # fmt: skip
    return head, rows


def models_page(found: ComparisonOfModels) -> dict[str, Any]:
    """The record of a page (`report.case_page`)."""
    names = [m.name for m in found.models]
    head, rows = models_rows(found)
    pairs_head, pairs = pair_rows(found)
    tables = [{"caption": "Models", "columns": head, "rows": rows, "note": NOTE}]
    if pairs:
        note = (
            "Paired losses; ± by Student's t, whose degrees of freedom fall with the correlation of what differs. The "
            "level is shared by all pairs of models. Differences under 0.5 % of the RMSE are not told apart: "
            "simulations are no more exact."
        )
        tables.append({"caption": "Differences", "columns": pairs_head, "rows": pairs, "note": note})
    points = min(MOST_POINTS, max(FEWEST_POINTS, POINTS_IN_FILE // max(1, len(found.series) * (2 * len(names) + 1))))
    figures = [
        {
            "figure": overlay_figure(s, names, points),
            "label": f"{s.output} of recording {s.recording}: measured, all models, and the residuals of each on one "
            f"scale.",
        }
        for s in found.series
    ]
    many = len(names) > 1
    return {
        "title": " and ".join([", ".join(names[:-1]), names[-1]]) if many else names[0],
        "subtitle": "Which of these models do the data support?",
        "sections": [
            {"title": "Verdict", "verdict": [v.plain() for v in found.verdict], "tables": tables},
            {"title": "Measured and simulated", "figures": figures},
        ],
    }


def _judged(errors: Errors | OutputErrors, word: str) -> float | None:
    return errors.unseen if word == "unseen" else errors.left_out


def _text(value: float | None, ascii_only: bool) -> str:
    return significant(value, 4, ascii_only=ascii_only).replace(UNKNOWN, "-" if ascii_only else UNKNOWN)
