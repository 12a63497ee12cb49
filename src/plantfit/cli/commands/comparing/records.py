"""`plantfit compare-records`: whether the recordings of a study agree on its parameters."""

from pathlib import Path

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.commands.comparing.fitted import answers_of, from_file, from_store
from plantfit.cli.commands.comparing.stored import number_of
from plantfit.cli.terminal.out import out, print_json, said_line, verdict
from plantfit.cli.terminal.working import worker_count
from plantfit.errors import RecordingError


def compare_records(given: str, store: str, place: str | None, workers: str | None, json: bool) -> None:
    """Fit the study if the store has no answer of it, then each of its recordings alone."""
    from plantfit import spec as specs
    from plantfit.report.html import check_place
    from plantfit.study import Store

    worker_count(workers, None)
    file = given.endswith(".toml") or Path(given).is_file()
    study = specs.load(given) if file else None
    opened = Store.open(store, create=file)
    one = from_file(opened, given, study) if study is not None else from_store(opened, given, number_of(given, store))
    to = Path(place or file_name(f"{one.ready.study.name}-records", "html"))
    check_place(to)
    from plantfit.records_compared import compare_records as compared
    from plantfit.records_compared import one_recording

    if len(one.ready.problem.data["drive"]) < 2:
        raise RecordingError(one_recording(one.ready.problem))
    answers, numbers = answers_of(opened, [one], workers, json)
    with said_line(json) as say:
        found = compared(answers[given], progress=say)
    path = found.report(to)
    if json:
        return print_json({**found.record, "study": numbers[given], "written": {"report": str(path)}})
    verdict(dict(found.record))
    out.print("\n" + found.table(), markup=False)
    out.print(f"\nReport: {path}", markup=False)


__all__ = ["compare_records"]
