"""Figures of what the steam chamber's tables mean: visits, and what is known of every entry."""

from collections.abc import Mapping, Sequence

import numpy as np

from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.rig.steam_chamber import NODES, TABLES

LOOKS = {
    "determined": "#2a7a9b",
    "weak": "#9cc7d8",
    "flat": "#e3b04b",
    "at bound": "#c05a3a",
    "not visited": "#d9d9d9",
}


def visits_figure(
    samples: np.ndarray, statuses: Mapping[str, Sequence[Sequence[str]]], openings: Sequence[float]
) -> Figure:
    """Samples around every node (openings, nodes), and beside it the status of every entry of each table, of the
    same shape."""
    panels = ["samples near the node", *TABLES]
    layout = style.layout(400, margin={"l": 62, "r": 14, "t": 62, "b": 50}, showlegend=True)
    data, width = [], 1.0 / len(panels)
    seen = np.where(samples > 0, np.log10(np.maximum(samples, 1)), np.nan)
    hover = [[f"{int(n)} samples" if n else "not visited" for n in row] for row in samples.T]
    for k, name in enumerate(panels):
        end = str(k + 1) if k else ""
        grid = {"type": "heatmap", "x": list(openings), "y": style.numbers(NODES, 4), "xaxis": f"x{end}",
                "yaxis": f"y{end}",
                "showscale": False, "xgap": 1, "ygap": 1,
                "hovertemplate": "%{text} at %{x} %, %{y} bar<extra></extra>"}  # fmt: skip
        if k == 0:
            shades = [[0.0, "#dcebf2"], [1.0, "#10305c"]]
            data.append(grid | {"z": [style.numbers(row, 4) for row in seen.T], "text": hover, "colorscale": shades})
        else:
            number = {status: i for i, status in enumerate(LOOKS)}
            codes = np.array([[number[s] for s in row] for row in statuses[name]], dtype=float)
            steps = [[(i + e) / len(LOOKS), colour] for i, colour in enumerate(LOOKS.values()) for e in (0, 1)]
            text = [[f"{name} {s}" for s in row] for row in zip(*statuses[name], strict=True)]
            z = [style.numbers(row) for row in codes.T]
            data.append(grid | {"z": z, "text": text, "colorscale": steps, "zmin": -0.5, "zmax": len(LOOKS) - 0.5})
        layout[f"xaxis{end}"] = style.axis(
            "opening [%]", domain=[k * width + 0.012, (k + 1) * width - 0.012], anchor=f"y{end}"
        )
        layout[f"yaxis{end}"] = style.axis("pressure [bar]" if k == 0 else "", anchor=f"x{end}", showticklabels=k == 0)
    data += [
        {"type": "scatter", "mode": "markers", "name": status, "x": [None], "y": [None],
         "marker": {"color": colour, "symbol": "square", "size": 11}}
        for status, colour in LOOKS.items()
    ]  # fmt: skip
    layout["annotations"] = [style.heading(name, k * width + 0.012, 1.0) for k, name in enumerate(panels)]
    layout["legend"] = layout["legend"] | {"y": 1.08}
    return {"data": data, "layout": layout}
