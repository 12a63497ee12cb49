"""The figure of one recording as a plotly object, for programs and notebooks."""

import re
from collections.abc import Mapping
from importlib import resources
from typing import TYPE_CHECKING, Any

from plantfit.findings import read_findings
from plantfit.report.figures import fit_figure

if TYPE_CHECKING:
    import plotly.graph_objects as go

POINTS = 4000  # samples drawn of each signal


def fit_plot(findings: Mapping[str, Any], recording: str) -> "go.Figure":
    """Measured and simulated outputs, residuals and inputs of one recording, in the light colours of the report.

    Raises PlantfitError for a record that does not fit the schema.
    """
    import plotly.graph_objects as go

    (chosen,) = (r for r in read_findings(findings).recordings if r.name == recording)
    figure = coloured(fit_figure(chosen, POINTS))
    page = coloured({"paper_bgcolor": "var(--card)"})  # text is dark, whatever the notebook is
    return go.Figure({"data": figure["data"], "layout": figure["layout"] | page})


def coloured(figure: Any) -> Any:
    """A figure with the colours of templates/style.css in place of their names, as templates/draw.js has them on a
    light page."""
    colours = light_colours()

    def resolved(value: Any) -> Any:
        if isinstance(value, str):
            found = re.fullmatch(r"var\((--[a-z0-9-]+)\)", value)
            return colours[found[1]] if found else value
        if isinstance(value, Mapping):
            return {k: resolved(v) for k, v in value.items()}
        if isinstance(value, list) and not (value and isinstance(value[0], float)):
            return [resolved(v) for v in value]
        return value

    return resolved(figure)


def light_colours() -> dict[str, str]:
    """Name -> colour, of the first block of templates/style.css."""
    text = resources.files("plantfit.report").joinpath("templates", "style.css").read_text(encoding="utf-8")
    return dict(re.findall(r"(--[a-z0-9-]+):\s*([^;]+);", text[: text.index("}")]))
