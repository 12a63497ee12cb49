"""`plantfit compare-records`: whether the recordings of a study agree on its parameters."""

from pathlib import Path

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.commands.understand.fitted import answers_of, one_given
from plantfit.cli.terminal.out import out, print_json, said_line, verdict
from plantfit.cli.terminal.working import worker_count
from plantfit.errors import RecordingError


def compare_records(given: str, store: str, place: str | None, workers: str | None, json: bool) -> None:
    """Fit the study if the store has no answer of it, then each of its recordings alone."""
    from plantfit.report.html import check_place

    worker_count(workers, None)
    opened, one = one_given(given, store)
    to = Path(place or file_name(f"{one.ready.study.name}-records", "html"))
    check_place(to)
    from plantfit.records_compared import compare_records as compared
    from plantfit.records_compared import one_recording

    if len(one.ready.prepared.problem.data["drive"]) < 2:
        raise RecordingError(one_recording(one.ready.prepared.problem))
    answers, numbers = answers_of(opened, [one], workers, json)
    with said_line(json) as say:
        found = compared(answers[given], progress=say)
    path = found.report(to)
    if json:
        return print_json(found.typed.printed(study=numbers[given], written={"report": str(path)}))
    verdict(found.record)
    out.print("\n" + found.table(), markup=False)
    out.print(f"\nReport: {path}", markup=False)


__all__ = ["compare_records"]
