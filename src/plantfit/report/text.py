"""The verdict and the parameters as plain text for a terminal."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from plantfit.findings import Findings, Parameter, ReadingBudget, Score, read_findings
from plantfit.report.numbers import plus_minus, significant
from plantfit.report.sections.sentences import LEVELS, no_validation, parameter_status, subtitle
from plantfit.report.sections.tables import Table, fit_in_words, parameter_interval, statuses, weights_table
from plantfit.report.sections.uncertainty_tables import budgets_of, widened_table

WIDTH = 100


def summary_text(findings: Mapping[str, Any]) -> str:
    """Title, verdict, scores and parameters, at most about 100 characters wide; PlantfitError as for `write_report`."""
    record = read_findings(findings)
    blocks = [f"{_line(record.name)}\n{textwrap.fill(_line(subtitle(record)), WIDTH)}", _verdict(record)]
    blocks += [_scores(record.scores), no_validation(record) if record.recordings else ""]
    blocks.append(_grid(weights_table(record.weights)) if record.weights else "")
    blocks.append(_parameters([p for p in record.parameters if not p.index]))
    blocks.append(_tables(record))
    blocks.append(_uncertainty(record))
    return "\n\n".join(block for block in blocks if block)


def _verdict(record: Findings) -> str:
    lines = []
    for v in record.verdict:
        word = LEVELS[v.level][0]
        lines.append(
            textwrap.fill(_line(v.sentence), WIDTH, initial_indent=f"{word + ':':<9}", subsequent_indent=" " * 9)
        )
    return "\n".join(lines)


def _scores(scores: Sequence[Score]) -> str:
    rows = [
        (
            s.recording,
            s.output,
            s.part,
            significant(s.rmse, 3, True),
            s.unit or "",
            fit_in_words(s.fit_percent) or significant(s.fit_percent, 3, True),
            str(s.n),
        )
        for s in scores
    ]
    return columns(("recording", "output", "part", "RMSE", "unit", "fit %", "samples"), rows, right=(3, 5, 6))


def _parameters(parameters: Sequence[Parameter]) -> str:
    rows = [
        (
            p.name,
            plus_minus(p.value, p.standard_error, True),
            p.unit or "",
            parameter_interval(p, True),
            parameter_status(p).split(":")[0],
        )
        for p in parameters
    ]
    return columns(("parameter", "value", "unit", "95 % interval", "status"), rows)


def _tables(record: Findings) -> str:
    """One line for each table and recording."""
    own = {}
    for p in record.parameters:
        if p.index:
            own.setdefault((p.parameter, p.recording or ""), []).append(p)
    rows = []
    for (name, recording), entries in own.items():
        values = [p.value for p in entries if p.value is not None and p.status != "not visited"]
        span = f"{significant(min(values), 3, True)} to {significant(max(values), 3, True)}" if values else ""
        rows.append((name, recording, str(len(entries)), span, entries[0].unit or "", statuses(entries)))
    return columns(("table", "recording", "entries", "values", "unit", "status"), rows, right=(2,))


def uncertainty_text(findings: Mapping[str, Any]) -> str:
    """The parameters' uncertainties with stated errors; empty without."""
    return _uncertainty(read_findings(findings))


def budgets_text(budgets: Sequence[Mapping[str, Any] | ReadingBudget]) -> str:
    """Budgets as `plantfit.trust.stated_errors.reading_budgets` gives them."""
    return "\n\n".join(f"{_line(b.caption)}\n{_grid(b)}" for b in budgets_of(budgets, True))


def _uncertainty(record: Findings) -> str:
    if record.uncertainty is None:
        return ""
    widened = widened_table([p for p in record.parameters if not p.index], True)
    return f"{widened.caption}\n{_grid(widened)}" if widened.rows else ""


def _grid(table: Table) -> str:
    return columns(table.head, table.rows, sorted(table.numeric))


def _status(parameter: Parameter) -> str:
    """The status without its advice."""
    return parameter_status(parameter).split(":")[0]


def columns(head: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[int] = ()) -> str:
    """Rows of text under headings, padded; the columns in `right` align right. Empty without rows."""
    if not rows:
        return ""
    lines = [tuple(head), *(tuple(_line(cell) for cell in row) for row in rows)]
    widths = [max(len(line[k]) for line in lines) for k in range(len(head))]
    padded = [
        "  ".join(
            cell.rjust(w) if k in right else cell.ljust(w) for k, (cell, w) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in lines
    ]
    return "\n".join([padded[0], "-" * min(WIDTH + 20, sum(widths) + 2 * len(widths) - 2), *padded[1:]])


def _line(text: str) -> str:
    """Text on one line, without control characters that a terminal would obey."""
    return "".join(c if c.isprintable() else " " for c in text)
