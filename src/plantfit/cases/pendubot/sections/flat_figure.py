"""RMSE of the torque along the flat curves through an answer, and across them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.evaluate.compress import Compressed, mean_square
from plantfit.report.figures import style
from plantfit.trust import Combinations, FlatCurve
from plantfit.trust.identify.combinations import Base, stacked
from plantfit.trust.verdict.words import some

import jax
import jax.numpy as jnp

POINTS = 121


def across(found: Combinations, curve: FlatCurve) -> tuple[np.ndarray, np.ndarray]:
    """Way (n,) in widths of the box and points (n, d) on the straight line through the answer, along which what is
    determined changes most among the parameters that move on the curve."""
    width, answer = found.upper - found.lower, curve.points[curve.at]
    moving = [found.names.index(n) for n in curve.moving]
    rows = found.jacobian(answer)[:, moving] * width[moving]
    steep = np.linalg.svd(rows / np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), 1e-300))[2][0]
    direction = np.zeros(len(width))
    direction[moving] = steep / np.linalg.norm(steep)
    reach = max(abs(curve.arc[0]), abs(curve.arc[-1]))
    way = np.linspace(-reach, reach, POINTS)
    points = answer + way[:, None] * direction * width
    inside = np.all((points >= found.lower) & (points <= found.upper), axis=1)
    return way[inside], points[inside]


def flat_figure(found: Combinations, curves: Sequence[FlatCurve], data: Compressed, base: Base) -> dict[str, Any]:
    """One panel: RMSE over the way from the answer, a pair of lines for each flat curve."""
    cost = jax.jit(jax.vmap(lambda p: mean_square(data, stacked(base, found.names)(p))))
    traces, shown = [], []
    for k, curve in enumerate(curves):
        colour, moving = style.SERIES[k % len(style.SERIES)], some(curve.moving, most=8)
        for label, dash, (way, points) in (
            ("along", "solid", (curve.arc, curve.points)),
            ("across", "dot", across(found, curve)),
        ):
            rmse = np.sqrt(np.asarray(cost(jnp.asarray(points))))
            shown.append(rmse)
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "name": style.plain(f"{label}: {moving}"),
                    "x": style.numbers(way, 4),
                    "y": style.numbers(rmse),
                    "line": {"color": colour, "width": 2.3, "dash": dash},
                    "hovertemplate": f"{label}: RMSE %{{y:.5~g}} N m at %{{x:.3~g}}<extra></extra>",
                }
            )
    layout = style.layout(360, showlegend=True, hovermode="closest")
    layout["xaxis"] = style.axis("way from the answer [widths of the box]")
    layout["yaxis"] = style.log_axis("RMSE of the torque [N m]", np.concatenate(shown))
    return {"data": traces, "layout": layout}
