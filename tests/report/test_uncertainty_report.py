"""Stated errors in the report and in the text for a terminal."""

import pytest
from findings_example import example

from plantfit.findings import read_findings
from plantfit.report import budgets_text, render_html, summary_text, uncertainty_text
from plantfit.report.sections.uncertainty_tables import budget_table, widened_table

BUDGET = {
    "of": "w", "kind": "signal", "unit": "rad/s", "at": 40.0, "recordings": ["train"], "combined": 0.5, "expanded": 1.0,
    "degrees_of_freedom": 9.4, "coverage_factor": 2.26,
    "sources": [
        {"name": "tacho", "kind": "B", "shape": "rectangular", "limit": 0.0173, "unit": "1", "divisor": 1.732,
         "standard": 0.01,
         "sensitivity": 40.0, "contribution": 0.4, "expanded": 0.8, "share": 0.64, "degrees_of_freedom": None,
         "acts": "gain"},
        {"name": "zero", "kind": "A", "shape": "normal", "limit": 0.3, "unit": "rad/s", "divisor": 1.0, "standard": 0.3,
         "sensitivity": 1.0, "contribution": 0.3, "expanded": 0.6, "share": 0.36, "degrees_of_freedom": 4.0,
         "acts": "offset"},
    ],
}  # fmt: skip


def stated(sources: dict[str, float]) -> dict:
    """The example with errors of Kt (value 0.05, noise 0.001)."""
    findings = example(samples=60)
    noise = 0.001
    shared = sum(v**2 for v in sources.values()) ** 0.5
    combined = (noise**2 + shared**2) ** 0.5
    for p in findings["parameters"]:
        if p["name"] == "Kt":
            p["uncertainty"] = {
                "noise": noise, "shared": shared, "sources": sources, "combined": combined, "low": 0.044, "high": 0.06,
                "degrees_of_freedom": None,
            }  # fmt: skip
    findings["uncertainty"] = {"method": "linear", "draws": None, "seed": None, "budgets": [BUDGET]}
    return findings


def test_the_section_and_its_tables_are_there_only_when_errors_are_stated():
    page = render_html(stated({"tacho": 0.004, "zero": 1e-9}))
    assert 'id="uncertainty"' in page
    assert "One reading of w in train, at 40 rad/s, the most uncertain one recorded" in page
    assert "95 %, k = 2.26" in page
    assert "95 % interval with stated errors" in page
    plain = render_html(example(samples=60))
    assert 'id="uncertainty"' not in plain
    assert "stated errors" not in plain
    assert uncertainty_text(example(samples=60)) == ""


def test_rows_of_the_budget():
    record = read_findings(stated({"tacho": 0.004}))
    assert record.uncertainty is not None
    table = budget_table(record.uncertainty.budgets[0])
    cells = {row[0]: row for row in table.rows}
    assert cells["tacho"][4:9] == ("1.73 %", "1.732", "1 %", "0.4", "64 %")
    assert cells["zero"][4:] == ("", "1", "0.3 rad/s", "0.3", "36 %", "4")
    assert cells["combined"][7:] == ("0.5", "100 %", "9")
    assert cells["95 %, k = 2.26"][7] == "1.13"
    assert "contribution [rad/s]" in table.head


def test_the_parameter_is_marked_where_errors_outweigh_the_noise():
    table = widened_table(read_findings(stated({"tacho": 0.004, "zero": 1e-9})).parameters)
    assert table.head[4:] == ("times noise", "noise", "tacho", "zero")
    assert table.rows[0][1:] == ("0.0523 ± 0.0041", "N·m/A", "0.0440 to 0.0600", "4.1", "0.001", "0.004", "~0")
    assert table.marked == {0}
    assert not widened_table(read_findings(stated({"tacho": 0.0004})).parameters).marked


def test_many_sources_share_a_column():
    table = widened_table(read_findings(stated({f"s{k}": 0.001 * (k + 1) for k in range(9)})).parameters)
    assert table.head[6:] == ("s4", "s5", "s6", "s7", "s8", "4 others")
    rest = sum((0.001 * (k + 1)) ** 2 for k in range(4)) ** 0.5
    assert float(table.rows[0][-1]) == pytest.approx(rest, rel=0.02)


def test_texts_for_a_terminal():
    said = summary_text(stated({"tacho": 0.004}))
    assert "Standard uncertainties of the parameters by source" in said
    assert "0.0440 to 0.0600" in said
    text = budgets_text([BUDGET])
    assert text.startswith("One reading of w in train, at 40 rad/s")
    assert text.isascii()
