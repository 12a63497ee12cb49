"""Reports of findings: one self-contained HTML file, or plain text for a terminal.

The report of a fit is `html.py` with templates/report.html. An answer in a notebook is `notebook.py` with
templates/answer.html, which has tables and no figures. `answer.plot()` is `plot.py`, the figure of one recording as an
object of plotly.
"""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.report.comparison import render_comparison, write_comparison
    from plantfit.report.html import render_html, write_report
    from plantfit.report.notebook import answer_html
    from plantfit.report.plot import fit_plot
    from plantfit.report.text import budgets_text, summary_text, uncertainty_text

__all__ = [
    "answer_html",
    "budgets_text",
    "fit_plot",
    "render_comparison",
    "render_html",
    "summary_text",
    "uncertainty_text",
    "write_comparison",
    "write_report",
]

names_of(
    __name__,
    {
        "comparison": "render_comparison write_comparison",
        "html": "render_html write_report",
        "notebook": "answer_html",
        "plot": "fit_plot",
        "text": "budgets_text summary_text uncertainty_text",
    },
)
