"""Plotly figures as plain dictionaries, one file per theme.

A page keeps a figure with `Drawings.add(figure, label)` (`report/drawings.py`), and its template places it by
`drawing`. Pages hold the cartesian bundle of plotly, which draws no other kinds of traces
(`tests/report/test_page_script.py`).
"""

from plantfit.report.figures.convergence import convergence_figure, waterfall_figure
from plantfit.report.figures.fit import fit_figure
from plantfit.report.figures.looks import look_figure
from plantfit.report.figures.missing import residual_change_figure, share_figure
from plantfit.report.figures.operating_points import table_figure
from plantfit.report.figures.parameters import interval_figure, weight_figure
from plantfit.report.figures.residuals import stem_figure
from plantfit.report.figures.strobe import Panel, strobe_figure
from plantfit.report.figures.style import Figure

__all__ = [
    "Figure",
    "Panel",
    "convergence_figure",
    "fit_figure",
    "interval_figure",
    "look_figure",
    "residual_change_figure",
    "share_figure",
    "stem_figure",
    "strobe_figure",
    "table_figure",
    "waterfall_figure",
    "weight_figure",
]
