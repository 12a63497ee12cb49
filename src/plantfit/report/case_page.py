"""The page of a case: sections of sentences, tables and figures that a demo has made."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from plantfit.report import html
from plantfit.report.drawings import Drawings
from plantfit.report.sections.sentences import LEVELS
from plantfit.report.sections.tables import Table

_NUMBER_STARTS = set("0123456789+-\u2212\u00b1<>~")


def write_case_page(record: Mapping[str, Any], path: str | Path, reports: Sequence[str] = ()) -> Path:
    """Write the page of a demo's record to `path` and return it; `reports` are file names beside it to link to.

    The record has "title", "subtitle" and "sections", each section

        {"title": str, "command": str, "sentences": [str],
         "verdict": [{"level": "good"|"info"|"warning"|"bad", "sentence": str}],
         "tables": [{"caption": str, "columns": [str], "rows": [[str]], "note": str (optional)}],
         "figures": [{"figure": plotly dictionary, "label": what it shows}]}

    where all but the title may be left out; `command` is what a user types to repeat the section.

    The file appears whole or not at all; StoreError when it cannot be written.
    """
    return html.write_page(path, render_case_page(record, reports))


def render_case_page(record: Mapping[str, Any], reports: Sequence[str] = ()) -> str:
    """The page as text."""
    drawings = Drawings()
    context = {
        "title": record["title"],
        "subtitle": record.get("subtitle", ""),
        "sections": [_section(s, drawings) for s in record["sections"]],
        "reports": list(reports),
    }
    return html.render_page("case.html", context | {"figures": drawings.json})


def _section(section: Mapping[str, Any], drawings: Drawings) -> dict[str, Any]:
    return {
        "title": section["title"],
        "command": section.get("command", ""),
        "sentences": list(section.get("sentences", ())),
        "verdict": [_said(v["level"], v["sentence"]) for v in section.get("verdict", ())],
        "tables": [{"grid": _table(t), "note": t.get("note", "")} for t in section.get("tables", ())],
        "figures": [drawings.add(f["figure"], f["label"]) for f in section.get("figures", ())],
    }


def _said(level: str, sentence: str) -> dict[str, str]:
    word, mark = LEVELS[level]
    return {"level": level, "word": word, "mark": mark, "sentence": sentence}


def _table(table: Mapping[str, Any]) -> Table:
    """A table whose columns of numbers stand to the right."""
    columns = tuple(str(c) for c in table["columns"])
    rows = tuple(tuple(str(cell) for cell in row) for row in table["rows"])
    numeric = frozenset(k for k in range(1, len(columns)) if _numbers([row[k] for row in rows]))
    return Table(table["caption"], columns, rows, numeric)


def _numbers(cells: Sequence[str]) -> bool:
    said = [cell for cell in cells if cell.strip()]
    return bool(said) and all(cell.strip()[0] in _NUMBER_STARTS for cell in said)
