"""A first look as a page (`report.case_page`)."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.report.figures.comparison.models import overlay_figure
from plantfit.report.figures.pages.look import bode_figure, step_figure
from plantfit.report.figures.residuals import stem_figure
from plantfit.report.numbers import significant, unit_label

POINTS = 4000


def look_page(record: Mapping[str, Any]) -> dict[str, Any]:
    """The page of a record of `first_look.look`."""
    sections: list[dict[str, Any]] = [{"title": "What the recording says", "verdict": record["verdict"]}]
    for o in record["outputs"]:
        unit = unit_label(o["unit"])
        tail = f" [{unit}]" if unit else ""
        rows = [[str(r["order"]), significant(r["rmse"], 4), significant(r["arx_rmse"], 4), f"{r['bic']:.1f}"] for r in o["orders"]]
        table = {
            "caption": f"Linear models of {o['output']}", "columns": ["order", f"RMSE{tail}", f"RMSE of ARX{tail}", "BIC above least"],
            "rows": rows, "note": "Fitted samples, simulated from the inputs alone; the least BIC is taken.",
        }  # fmt: skip
        drawn = {**o, "simulated": {"linear model": o["simulated"]}}
        label = f"{o['output']} of {record['recording']}: measured, and the linear model simulated from the inputs alone."
        figures = [{"figure": overlay_figure(drawn, ["linear model"], POINTS), "label": label}]
        for p in o["pairs"]:
            what = f"{o['output']} and {p['input']}"
            if p["f"]:
                label = f"Frequency response, {what}: the truth lies in each band with 95 %. Dashed: the linear model."
                figures.append({"figure": bode_figure(p, o["output"], o["unit"]), "label": label})
            label = f"Step response, {what}, of the linear model, if its order is right."
            figures.append({"figure": step_figure(p, o["output"], o["unit"]), "label": label})
            lags, values = np.array(p["lags"], dtype=float), np.array(p["correlation"], dtype=float)
            stem = stem_figure(lags, values, p["bound"], f"cross-correlation, {p['input']} made white")
            label = f"Cross-correlation, {what}: 1 % of records without a reaction leave the band anywhere."
            figures.append({"figure": stem, "label": label})
        sections.append({"title": f"Output {o['output']}", "tables": [table], "figures": figures})
    return {"title": f"First look: {record['recording']}", "subtitle": "Without equations", "sections": sections}
