"""What the page of the heat exchanger shows."""

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from plantfit.cases.shared.fitting import rms
from plantfit.cases.shared.followed import followed_figure
from plantfit.fitting import Answer
from plantfit.recording.clean.levels import levels
from plantfit.recording.record import Recording
from plantfit.report.figures import style
from plantfit.report.figures.style import Figure
from plantfit.trust.intervals.profile import profile
from plantfit.trust.validate.dead_time import dead_time
from plantfit.trust.validate.level_responses import LevelResponse, level_responses


def unseen_section(
    table: Answer,
    linear: Answer,
    scores: Mapping[str, tuple[np.ndarray, np.ndarray]],
    steps: Mapping[str, tuple[np.ndarray, ...]],
    left_out: float,
) -> dict[str, Any]:
    """How far both models carry."""
    free, n = table.problem.space.dimension, len(table.problem.experiments["january"].recording)
    rows = [
        [name, *(f"{v:z.2f}" for e in pair for v in (rms(e), np.mean(e), np.std(e)))] for name, pair in scores.items()
    ]
    changes = [[name, *(f"{rms(e):.3g}" for e in three)] for name, three in steps.items()]
    worse = [name for name, (a, b) in scores.items() if rms(a) > rms(b)]
    better = [name for name, (a, b) in scores.items() if "fitted" not in name and rms(a) < rms(b)]
    sentences = [
        f"The table of January has {free} free numbers for {n} samples. With nodes at every "
        f"second level only, the levels that the fit does not see are off by {left_out:.2g} "
        "degC: what settles between two levels is not on a line, as if the valve stuck.",
        f"The table loses to the linear model on: {'; '.join(worse)}. At the same valve the plant of June settles "
        "many degC away from January's (last section), so that a finer map of January carries no further."
        if worse
        else "The table wins on every recording.",
        f"On data not fitted, the table wins on: {'; '.join(better) or 'nothing'}. "
        "The mean errors there are a drift that nobody measured.",
    ]
    return {
        "title": "One table model, and where it holds",
        "sentences": sentences,
        "tables": [
            {
                "caption": "Error of free simulation [degC]",
                "columns": ["models of, on", "table: RMSE", "mean", "std", "linear: RMSE", "mean", "std"],
                "rows": rows,
            },
            {
                "caption": "After each step, error less its mean over 30 s before, both models of January [degC]",
                "columns": ["recording", "table", "linear", "nothing changes"],
                "rows": changes,
            },
        ],
        "figures": [
            {
                "figure": followed_figure({"table": table, "linear": linear}, n, "y"),
                "label": f"{n}: measured, and both models of January simulated in one go.",
            }
            for n in table.problem.experiments
        ],
    }


def levels_section(recording: Recording, own: Answer) -> dict[str, Any]:
    """Which steps tell a gain and a dead time: the response beside the drift, and a model for each step with its
    intervals."""
    judged, rows, kept = level_responses(recording, "u", "y"), [], []
    for found, name in zip(judged, own.problem.experiments, strict=True):
        gain, late = profile(own.problem, own, f"K[{name}]"), dead_time(own.problem, own, f"L[{name}]")
        said = _said(found, late.determined)
        kept += [found.level] if found.told else []
        rows.append(
            [f"{found.before:.2f} to {found.level:.2f}", f"{found.response:.2f}", f"{found.drift:.2f}",
             f"{gain.value:.3g}",
             f"{gain.low:.3g} to {gain.high:.3g}", f"{late.value:.3g}",
             f"{late.interval[0]:.3g} to {late.interval[1]:.3g}", said]
        )  # fmt: skip
    untold = [found.sentence for found in judged if not found.told]
    return {
        "title": "What each step tells",
        "sentences": [
            f"{len(kept)} of {len(judged)} steps moved the temperature "
            "by more than twice the range over which it wanders at rest.",
            *untold,
        ],
        "tables": [
            {
                "caption": "A first order with dead time for each step of January",
                "columns": [
                    "valve",
                    "response [degC]",
                    "drift [degC]",
                    "gain [degC]",
                    "95 %",
                    "dead time [s]",
                    "95 %",
                    "what it tells",
                ],
                "rows": rows,
                "note": "Gain per unit of the valve. Intervals assume that the model is right; where the drift is as "
                "large as the response "
                "it is not, and the interval, however narrow, is the drift's.",
            }
        ],
    }


def _said(found: LevelResponse, late: bool) -> str:
    if not found.told:
        return "neither gain nor dead time"
    return "gain and dead time" if late else "gain; dead time not from zero"


def map_section(recordings: Mapping[str, Recording], table: Answer) -> dict[str, Any]:
    """Settled temperature against the valve, after steps up and down."""
    points = {n: settled(r) for n, r in recordings.items()}
    both = {u: hysteresis(points["june_stairs"], u) for u in (1.3, 1.55)}
    said = "; ".join(
        f"at {u:g} by {gap:z.1f} degC, while repeats from the same side spread over {spread:.1f} degC"
        for u, (gap, spread) in both.items()
    )
    return {
        "title": "Settled temperature over the valve",
        "sentences": [
            "Each point is the mean over the last half of a level.",
            "In the staircases of June, what settles after a step "
            f"down differs from what settles after a step up {said}.",
        ],
        "figures": [
            {
                "figure": _map(points, table),
                "label": "Settled temperature; triangles point the way of the step, the line is the table.",
            }
        ],
    }


def settled(recording: Recording) -> list[tuple[float, float, int]]:
    """(valve, settled temperature, +1 after a step up or -1 after one down) of every level but the first."""
    made = []
    pieces = levels(recording, "u")
    for old, new in pairwise(pieces):
        u, y = float(new["u"][0]), new["y"]
        made.append((u, float(np.mean(y[len(y) // 2 :])), 1 if u > float(old["u"][0]) else -1))
    return made


def hysteresis(found: list[tuple[float, float, int]], u: float) -> tuple[float, float]:
    """Settled temperature at valve `u`: after steps down less after steps up, in the mean; and the larger range of
    repeats."""
    up, down = ([y for at, y, way in found if way == w and abs(at - u) < 1e-6] for w in (1, -1))
    return float(np.mean(down) - np.mean(up)), float(max(np.ptp(up), np.ptp(down)))


def _map(points: Mapping[str, list[tuple[float, float, int]]], table: Answer) -> Figure:
    data: list[dict[str, Any]] = []
    for k, (name, found) in enumerate(points.items()):
        for way, symbol, word in ((1, "triangle-up", "up"), (-1, "triangle-down-open", "down")):
            own = [p for p in found if p[2] == way]
            if own:
                data.append(
                    {
                        "type": "scatter", "mode": "markers", "name": f"{name}, {word}",
                        "x": style.numbers(np.array([p[0] for p in own])),
                        "y": style.numbers(np.array([p[1] for p in own])),
                        "marker": {"color": style.SERIES[k], "symbol": symbol, "size": 9},
                        "hovertemplate": "valve %{x:.3g}: %{y:.1f} degC<extra></extra>",
                    }
                )  # fmt: skip
    entry = next(t for t in table.findings["tables"] if t["name"] == "share")
    hot, cold = float(np.mean(table.problem.experiments["january"].recording["hot"])), table.values["cold"]
    at = cold + np.array(entry["values"]) * (hot - cold)
    data.append(
        {
            "type": "scatter", "mode": "lines", "name": "table of January",
            "x": style.numbers(np.array(entry["nodes"][0])),
            "y": style.numbers(at), "line": {"color": style.SIMULATED, "width": 1.5}, "hoverinfo": "skip",
        }
    )  # fmt: skip
    layout = style.layout(420, showlegend=True, hovermode="closest")
    layout["xaxis"], layout["yaxis"] = style.axis("valve"), style.axis("settled temperature [degC]")
    return {"data": data, "layout": layout}
