"""The page of a case."""

import re

from chromium import drawn

from plantfit.report.case_page import render_case_page, write_case_page
from plantfit.report.figures.style import axis, layout

FIGURE = {
    "data": [{"x": [0, 1], "y": [1, 3]}],
    "layout": layout(200, xaxis=axis("time [s]"), yaxis=axis("angle [rad]")),
}
RECORD = {
    "title": "An arm <virtual rig>",
    "subtitle": "one & two",
    "sections": [
        {
            "title": "What it tells",
            "sentences": ["Gap below 1e-3 & falling."],
            "tables": [
                {
                    "caption": "Costs",
                    "columns": ["method", "gap"],
                    "rows": [["pso", "1.2e-4"], ["cga", ""]],
                    "note": "1000 runs",
                },
                {"caption": "Words", "columns": ["method", "what"], "rows": [["pso", "swarm"]]},
            ],
            "figures": [{"figure": FIGURE, "label": "Angle over time."}],
        },
        {"title": "Only a title"},
    ],
}


def test_everything_stands_on_the_page_and_is_escaped():
    text = render_case_page(RECORD, ["fit.html"])
    assert "An arm &lt;virtual rig&gt;" in text
    assert "Gap below 1e-3 &amp; falling." in text
    assert re.search(r'<th scope="col" class="number">gap</th>', text)
    assert re.search(r'<th scope="col">what</th>', text)
    assert '<a href="fit.html">fit.html</a>' in text
    assert text.count("<section id=") == 3
    assert "1000 runs" in text
    assert "<h3>Costs</h3>" in text


def test_chromium_draws_the_figure_of_a_case(tmp_path):
    document = drawn(write_case_page(RECORD, tmp_path / "case.html"), tmp_path / "profile")
    assert 'class="main-svg"' in document
    assert "Angle over time." in document
