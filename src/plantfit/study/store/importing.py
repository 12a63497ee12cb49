"""An exported file back to a whole study, with the same bits; a file that is not whole is refused."""

import json
import re
from base64 import b64decode
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from plantfit.errors import Status, StoreError, in_words
from plantfit.recording.readers.panics import unheard
from plantfit.recording.readers.tried import crash
from plantfit.study.plan import MOST_RUNS
from plantfit.study.store.codec import from_blob, from_json, to_blob, unspelled
from plantfit.study.store.export import FORMAT, NUMBERS, PARAMETER, VECTORS, WHOLE_NUMBERS
from plantfit.study.store.records import RunRecord, StudyRecord, TaskRecord, WholeStudy

INTEGER = 2**31  # of table task and the number of a run
BIG_INTEGER = 2**63
AGAIN = "export the study again, or restore the file from a copy"


class _Refused(Exception):
    """What is wrong, and what to do."""


def read_study(path: Path) -> WholeStudy:
    """The study of a file that `Store.export_json` or `export_parquet` wrote.

    Raises StoreError, one sentence, for a file that cannot be read, is broken, is something else
    or is of a newer plantfit.
    """
    try:
        with path.open("rb") as file:
            start = file.read(16)
    except OSError as error:
        raise StoreError(
            f"{path} cannot be read ({error.strerror or error}); check the name and your rights."
        ) from error
    if start.startswith(b"SQLite format 3"):
        raise StoreError(
            f"{path} is a study database, not an exported study; bring its studies here with `plantfit merge {path}`."
        )
    try:
        with _place("the file"):
            return _from_parquet(path) if start.startswith(b"PAR1") else _from_json(path)
    except _Refused as refused:
        raise StoreError(f"{path} {refused}.") from refused.__cause__


def _from_json(path: Path) -> WholeStudy:
    try:
        text = path.read_text(encoding="utf-8-sig")
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _Refused(f"is not an exported study, or broken (it cannot be read as JSON: {error}); {AGAIN}") from error
    _refuse_surrogates(record, text)
    head = _header(record)
    return _joined(head, (_run_of_json(values, place) for values, place in _listed(record, "runs")))


def _refuse_surrogates(record: Any, text: str) -> None:
    """Halves of characters, which JSON can write and no database can hold."""
    if not re.search(r"\\ud[89a-f]", text, re.IGNORECASE):
        return
    try:
        json.dumps(record, ensure_ascii=False).encode()
    except UnicodeEncodeError as error:
        raise _Refused(
            f"has text that is not Unicode (half of a pair, {error.object[error.start]!r}); {AGAIN}"
        ) from None


def _from_parquet(path: Path) -> WholeStudy:
    why = crash("parquet", path)
    if why is not None:
        raise _Refused(f"is a broken Parquet file (reading it {why}); {AGAIN}")
    try:
        with unheard():
            text = pl.read_parquet_metadata(path).get("plantfit")
        if text is None:
            raise _Refused(
                'is a Parquet file of another program (it has no metadata "plantfit"); give a file that `plantfit '
                "export-study` wrote"
            )
        with unheard():
            frame = pl.read_parquet(path)
    except (pl.exceptions.PolarsError, pl.exceptions.PanicException, OSError) as error:
        reason = (str(error).splitlines() or ["unreadable"])[0]
        raise _Refused(f"is a broken Parquet file ({reason}); {AGAIN}") from error
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise _Refused(f"has broken metadata ({error}); {AGAIN}") from error
    _refuse_surrogates(record, text)
    head = _header(record)
    return _joined(head, _runs_of_frame(frame))


def _header(record: Any) -> WholeStudy:
    """The study without its runs."""
    if not isinstance(record, Mapping) or not str(record.get("format", "")).startswith("plantfit study "):
        raise _Refused(
            'is not an exported study (it does not say "plantfit study"); give a file that `plantfit export-study` '
            "wrote"
        )
    if record["format"] != FORMAT:
        told = f"has the format {record['format']!r}, but this plantfit reads {FORMAT!r}"
        raise _Refused(f"{told}; use the plantfit that wrote it, or update this one")
    tasks = tuple(_task(values, place) for values, place in _listed(record, "tasks"))
    with _place("study"):
        study = _study(record["study"])
    with _place("probe"):
        probe = b64decode(record["probe"], validate=True)
        from_blob(probe)
    return WholeStudy(study, probe, tasks, ())


def _study(values: Mapping[str, Any]) -> StudyRecord:
    plan = _tree(values["plan"])
    methods = plan["methods"]
    if not (
        isinstance(methods, list)
        and methods
        and all(isinstance(m, str) for m in methods)
        and len(set(methods)) == len(methods)
    ):
        raise ValueError(f"methods {methods!r}")
    for name in ("budget", "seed"):
        _whole_number(plan[name], INTEGER)
    _whole_number(plan["runs"], MOST_RUNS + 1)
    coordinates, notes = values["coordinates"], values["notes"]
    for texts in (
        [values["name"], values["created"], values["cpu"], plan["name"]],
        coordinates,
        notes,
        list(values["versions"].values()),
    ):
        if not isinstance(texts, list) or not all(isinstance(t, str) for t in texts):
            raise TypeError(f"{texts!r} in place of text")
    for optional in ("spec_text", "spec_path"):
        if not isinstance(values[optional], str | None):
            raise TypeError(f"{optional} {values[optional]!r}")
    done, total = _whole_number(values["runs_done"], BIG_INTEGER), _whole_number(values["runs_total"], BIG_INTEGER)
    return StudyRecord(
        id=0,  # has none before it is in a database
        name=values["name"],
        created=values["created"],
        state="done" if done == total else "interrupted",
        plan=plan,
        spec_text=values["spec_text"],
        spec_path=values["spec_path"],
        coordinates=tuple(coordinates),
        versions=dict(values["versions"]),
        cpu=values["cpu"],
        notes=tuple(notes),
        runs_done=done,
        runs_total=total,
    )


def _task(values: Mapping[str, Any], place: str) -> TaskRecord:
    with _place(place):
        first, count = _whole_number(values["first"], INTEGER), _whole_number(values["count"], INTEGER)
        method, done, checkpoint = values["method"], values["done"], values["checkpoint"]
        if not isinstance(method, str) or not isinstance(done, bool):
            raise TypeError(f"method {method!r}, done {done!r}")
        return TaskRecord(
            method, first, count, done, None if checkpoint is None else b64decode(checkpoint, validate=True)
        )


def _run_of_json(values: Mapping[str, Any], place: str) -> RunRecord:
    with _place(place):
        vectors = {name: np.array([unspelled(v) for v in values[name]], float) for name in VECTORS}
        parameters = {name: unspelled(value) for name, value in values["parameters"].items()}
        return _run(values, vectors, parameters)


def _lists(column: pl.Series) -> pl.Series:
    """A column of lists of numbers; older polars would make lists of anything."""
    if not isinstance(column.dtype, pl.List):
        raise TypeError(f"{column.name!r} is {column.dtype}, not lists of numbers")
    return column.cast(pl.List(pl.Float64))


def _runs_of_frame(frame: pl.DataFrame) -> Iterator[RunRecord]:
    with _place("the columns"):
        vectors = {name: _lists(frame.get_column(name)) for name in VECTORS}
        scalars = frame.drop(VECTORS)
    for k, values in enumerate(scalars.iter_rows(named=True)):
        with _place(f"row {k}"):
            own = {name: column[k].to_numpy() for name, column in vectors.items()}
            parameters = {
                c.removeprefix(PARAMETER): v for c, v in values.items() if c.startswith(PARAMETER) and v is not None
            }
            yield _run(values, own, parameters)


def _run(values: Mapping[str, Any], vectors: Mapping[str, np.ndarray], parameters: dict[str, float]) -> RunRecord:
    method = values["method"]
    if not isinstance(method, str):
        raise TypeError(f"method {method!r}")
    if len(vectors["history_evaluations"]) != len(vectors["history_cost"]):
        raise ValueError("histories of unequal length")
    fields: dict[str, Any] = {name: _whole_number(values[name], BIG_INTEGER) for name in WHOLE_NUMBERS}
    fields |= {name: unspelled(values[name]) for name in NUMBERS}
    fields |= {name: from_blob(to_blob(vector)) for name, vector in vectors.items()}
    return RunRecord(
        method=method, status=Status(values["status"]), parameters=parameters, extra=_tree(values["extra"]), **fields
    )


def _joined(head: WholeStudy, runs: Iterator[RunRecord]) -> WholeStudy:
    """The whole study; refused unless tasks and runs are what the plan says, each once."""
    whole = WholeStudy(head.study, head.probe, head.tasks, tuple(runs))
    plan, axes, done = whole.study.plan, len(whole.study.coordinates), sum(t.count for t in whole.tasks if t.done)
    if not _covers(whole.tasks, plan["methods"], plan["runs"]):
        raise _Refused(f"is broken (its tasks are not those of its plan); {AGAIN}")
    if not done == len(whole.runs) == whole.study.runs_done or whole.study.runs_total != plan["runs"] * len(
        plan["methods"]
    ):
        raise _Refused(f"is broken (it has {len(whole.runs)} runs, and {done} in its finished tasks); {AGAIN}")
    if {(t.method, k) for t in whole.tasks if t.done for k in range(t.first, t.first + t.count)} != {
        (r.method, r.run) for r in whole.runs
    }:
        raise _Refused(f"is broken (its runs are not those of its finished tasks); {AGAIN}")
    for run in whole.runs:
        if len(run.x) != axes:
            raise _Refused(
                f"is broken (run {run.run} of {run.method!r} has {len(run.x)} coordinates of {axes}); {AGAIN}"
            )
    return whole


def _covers(tasks: Sequence[TaskRecord], methods: Sequence[str], runs: int) -> bool:
    """Whether the tasks hold every run of every method once."""
    spans = {method: sorted((t.first, t.count) for t in tasks if t.method == method) for method in methods}
    for own in spans.values():
        reached = 0
        for first, count in own:
            if first != reached or count == 0:
                return False
            reached += count
        if reached != runs:
            return False
    return len(tasks) == sum(len(own) for own in spans.values())


def _listed(record: Mapping[str, Any], key: str) -> Iterator[tuple[Any, str]]:
    """The entries of a list with their places."""
    with _place(key):
        entries = record[key]
        if not isinstance(entries, list):
            raise TypeError(f"{type(entries).__name__} in place of a list")
    return ((entry, f"{key}[{k}]") for k, entry in enumerate(entries))


def _tree(value: Any) -> dict[str, Any]:
    tree = from_json(value) if isinstance(value, str) else value
    if not isinstance(tree, dict):
        raise TypeError(f"{value!r} in place of a table")
    return tree


def _whole_number(value: Any, below: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < below:
        raise ValueError(f"{value!r} in place of a whole number")
    return value


@contextmanager
def _place(place: str) -> Generator[None]:
    """What is wrong inside gets the name of the place."""
    try:
        yield
    except KeyError as error:
        raise _Refused(f"is broken ({place} lacks {error}); {AGAIN}") from error
    except (ValueError, TypeError, AttributeError, OverflowError, pl.exceptions.PolarsError) as error:
        raise _Refused(f"is broken ({place}: {in_words(error)}); {AGAIN}") from error
