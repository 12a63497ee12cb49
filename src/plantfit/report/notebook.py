"""Verdict and parameters as a piece of HTML for a notebook: no script, nothing loaded, its own style."""

from collections.abc import Mapping
from typing import Any

import jinja2
from markupsafe import Markup

from plantfit.findings import read_findings
from plantfit.report.html import template_text
from plantfit.report.plot import light_colours
from plantfit.report.sections import sentences, tables

MOST_ROWS = 60  # parameters and entries of tables
TONES = ("good", "warning", "bad", "info")


def answer_html(findings: Mapping[str, Any]) -> str:
    """Title, verdict, scores and parameters. Raises PlantfitError for a record that does not fit the schema."""
    record, colours = read_findings(findings), light_colours()
    shown = record.parameters[:MOST_ROWS]
    left = len(record.parameters) - len(shown)
    caption = f"Parameters: the first {len(shown)} of {len(record.parameters)}" if left else "Parameters"
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    return environment.from_string(template_text("answer.html")).render(
        title=record.name,
        subtitle=sentences.subtitle(record),
        verdict=[(v.level, sentences.LEVELS[v.level], v.sentence) for v in record.verdict],
        tables=[t for t in (tables.scores_table(record.scores), tables.parameters_table(shown, caption)) if t.rows],
        tones={level: (Markup(colours[f"--{level}"]), Markup(colours[f"--{level}-soft"])) for level in TONES},
        colours={name: Markup(colours[f"--{name}"]) for name in ("card", "ink", "muted", "rule")},
    )
