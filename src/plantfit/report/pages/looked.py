"""A first look as a page (`report.case_page`)."""

from typing import Any

import numpy as np

from plantfit.findings.results.first_look import FirstLook
from plantfit.findings.results.models_compared import ModelSeries
from plantfit.report.figures.comparison.models import overlay_figure
from plantfit.report.figures.pages.look import bode_figure, step_figure
from plantfit.report.figures.residuals import stem_figure
from plantfit.report.numbers import significant, unit_label

POINTS = 4000


def look_page(found: FirstLook) -> dict[str, Any]:
    """The page of what `first_look.look` finds."""
    sections: list[dict[str, Any]] = [
        {"title": "What the recording says", "verdict": [v.plain() for v in found.verdict]}
    ]
    for o in found.outputs:
        unit = unit_label(o.unit)
        tail = f" [{unit}]" if unit else ""
        rows = [
            [
                str(r.order),
                significant(r.rmse, 4),
                significant(r.arx_rmse, 4),
                significant(r.bic, 4) if r.bic is None else f"{r.bic:.1f}",
            ]
            for r in o.orders
        ]
        table = {
            "caption": f"Linear models of {o.output}",
            "columns": ["order", f"RMSE{tail}", f"RMSE of ARX{tail}", "BIC above least"],
            "rows": rows, "note": "Fitted samples, simulated from the inputs alone; the least BIC is taken.",
        }  # fmt: skip
        drawn = ModelSeries(
            recording=found.recording, output=o.output, unit=o.unit, t=o.t, measured=o.measured, part=o.part,
            simulated={"linear model": o.simulated},
        )  # fmt: skip
        label = f"{o.output} of {found.recording}: measured, and the linear model simulated from the inputs alone."
        figures = [{"figure": overlay_figure(drawn, ["linear model"], POINTS), "label": label}]
        for p in o.pairs:
            what = f"{o.output} and {p.input}"
            if p.f:
                label = f"Frequency response, {what}: the truth lies in each band with 95 %. Dashed: the linear model."
                figures.append({"figure": bode_figure(p, o.output, o.unit), "label": label})
            label = f"Step response, {what}, of the linear model, if its order is right."
            figures.append({"figure": step_figure(p, o.output, o.unit), "label": label})
            lags, values = np.array(p.lags, dtype=float), np.array(p.correlation, dtype=float)
            stem = stem_figure(lags, values, p.bound, f"cross-correlation, {p.input} made white")
            label = f"Cross-correlation, {what}: 1 % of records without a reaction leave the band anywhere."
            figures.append({"figure": stem, "label": label})
        sections.append({"title": f"Output {o.output}", "tables": [table], "figures": figures})
    return {"title": f"First look: {found.recording}", "subtitle": "Without equations", "sections": sections}
