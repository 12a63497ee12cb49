"""Reports of findings: one self-contained HTML file, or plain text for a terminal."""

from typing import TYPE_CHECKING

from plantfit.lazy import names_of

if TYPE_CHECKING:
    from plantfit.report.comparison import render_comparison, write_comparison
    from plantfit.report.html import render_html, write_report
    from plantfit.report.text import budgets_text, summary_text, uncertainty_text

__all__ = [
    "budgets_text",
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
        "text": "budgets_text summary_text uncertainty_text",
    },
)
