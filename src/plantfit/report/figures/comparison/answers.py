"""Where answers lie between the bounds: the best runs, and groups of runs of the same cost."""

from collections.abc import Sequence
from typing import Any

from plantfit.findings.results.methods_compared import BestRuns, PlacedRun, SameCostAnswers
from plantfit.report.figures import style
from plantfit.report.figures.comparison.costs import colours
from plantfit.report.figures.style import Figure
from plantfit.report.numbers import percent, significant


def parallel_figure(parallel: BestRuns, methods: Sequence[str]) -> Figure:
    """The best runs as lines over the parameters, each at its place between the bounds; the lowest cost is drawn
    strong."""
    names, palette = parallel.names, colours(methods)
    runs = sorted(parallel.runs, key=lambda r: -r.cost)
    best = runs[-1]
    data = []
    for m in methods:
        own = [r for r in runs if r.method == m]
        if own:
            data.append(_bundle(own, names, palette[m][0], m))
    data.append(
        {
            "type": "scatter",
            "mode": "lines+markers",
            "name": "lowest cost",
            "x": list(range(len(names))),
            "y": [round(v, 4) for v in best.place],
            "line": {"color": style.INK, "width": 2.5},
            "marker": {"size": 7, "color": style.INK},
            "hoverinfo": "skip",
        }
    )
    return {"data": data, "layout": _layout(names)}


def _bundle(runs: Sequence[PlacedRun], names: Sequence[str], colour: str, method: str) -> dict[str, Any]:
    """All runs of a method as one line with gaps, which draws far faster than one line each."""
    x: list[int | None] = []
    y: list[float | None] = []
    text: list[str] = []
    for r in runs:
        x += [*range(len(names)), None]
        y += [*(round(v, 4) for v in r.place), None]
        told = f"{method} run {r.run}, cost {significant(r.cost, 6)}"
        text += [*(style.plain(f"{n} {significant(v)} · {told}") for n, v in zip(names, r.value, strict=True)), ""]
    opacity = max(0.12, min(0.6, 12 / len(runs)))
    return {
        "type": "scatter",
        "mode": "lines+markers",
        "name": style.plain(method),
        "x": x,
        "y": y,
        "text": text,
        "hovertemplate": "%{text}<extra></extra>",
        "opacity": opacity,
        "line": {"color": colour, "width": 1.3},
        "marker": {"size": 4},
    }


def optima_figure(optima: SameCostAnswers) -> Figure:
    """The best answer of each group of runs that share the lowest cost; the wider the line, the more runs."""
    names, groups = optima.names, optima.groups
    largest = max(g.share for g in groups)
    data = []
    for k, g in enumerate(groups):
        name = f"{g.runs} runs ({percent(g.share)})"
        told = f"{name}, cost {significant(g.cost, 6)}"
        text = [style.plain(f"{n} {significant(v)} · {told}") for n, v in zip(names, g.value, strict=True)]
        data.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "name": style.plain(name),
                "x": list(range(len(names))),
                "y": [round(v, 4) for v in g.place],
                "text": text,
                "hovertemplate": "%{text}<extra></extra>",
                "line": {"color": style.SERIES[k % 6], "width": 1.2 + 3 * g.share / largest},
                "marker": {"size": 7},
            }
        )
    return {"data": data, "layout": _layout(names)}


def _layout(names: Sequence[str]) -> dict[str, Any]:
    layout = style.layout(340, showlegend=True, hovermode="closest")
    shown = [style.plain(n if len(n) <= 18 else n[:17] + "…") for n in names]
    layout["xaxis"] = style.axis(tickvals=list(range(len(names))), ticktext=shown, range=[-0.25, len(names) - 0.75])
    ticks = {"tickvals": [0, 0.5, 1], "ticktext": ["lower", "middle", "upper"]}
    layout["yaxis"] = style.axis("place between the bounds", range=[-0.04, 1.04], **ticks)
    return layout
