"""A study with a table [regression], solved and told: what `plantfit run` does with one."""

from pathlib import Path
from typing import Any

from plantfit.cli.terminal.out import out, verdict


def solved(study: Any, place: Path, quiet: bool) -> dict[str, Any]:
    """Solve, write the page to `place`, say the table and the verdict unless `quiet`; gives back what `--json`
    prints."""
    from plantfit.regression import regress
    from plantfit.report.case_page import write_case_page
    from plantfit.report.sections.regression import page_of, sentences_of

    answer = regress(study)
    record: dict[str, Any] = {
        "name": study.name,
        "method": study.table.regression.method,
        "command": f"plantfit run {study.path.name}",
        "outputs": {o: unit for o, unit in study.problem.model.outputs.items()},
        **answer.record,
        "apart": [n for n in study.problem.space.names if n not in answer.values],
        "data": [*study.regression.sentences, *([study.biased] if study.biased else [])],
    }
    record["verdict"] = [
        *sentences_of(record),
        *({"level": d["level"], "sentence": d["sentence"]} for d in record["data"]),
    ]
    path = write_case_page(page_of(record, answer.recordings), place)
    if not quiet:
        _said(record)
        out.print(f"\nReport: {path}", markup=False)
    return {**record, "report": str(path)}


def _said(record: dict[str, Any]) -> None:
    from plantfit.report.sections.regression import COLUMNS, rows_of
    from plantfit.report.text import columns

    out.print(
        f"{record['name']}: {record['rows']} rows after the filter; solved at once, nothing is stored.\n", markup=False
    )
    out.print(f"{columns(COLUMNS, rows_of(record), range(2, len(COLUMNS)))}\n", markup=False)
    verdict(record)
