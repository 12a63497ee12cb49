"""`plantfit track`: a finished study's filter over a recording that may be growing."""

import os
import sys
import time
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TextIO

from plantfit.cli.arguments.quantities import quantity
from plantfit.cli.commands.understand.fitted import answers_of, one_given
from plantfit.cli.terminal.interrupts import stoppable
from plantfit.cli.terminal.out import out, print_json, said_line, warn
from plantfit.errors import RecordingError, SpecError, StoreError

POLL = 0.2  # seconds between looks at a growing file
ROWWISE = ("subtract", "scale", "convert_units", "duty_to_voltage", "signed")


def track(
    given: str, recording: str, follow: bool, idle: str | None, place: str | None, every: str | None,
    false_alarm: float,
    like: str | None, store: str, workers: str | None, force: bool, json: bool,
) -> None:  # fmt: skip
    """Track a recording with a study's filter; the study is fitted first if the store has no answer of it."""
    wait, step = quantity("--idle", idle, "s"), quantity("--every", every, "s")
    grows = follow or recording == "-"
    if recording != "-" and not Path(recording).is_file():
        raise RecordingError(
            f"There is no recording {recording!r}; name a file of measurements, or - for standard input."
        )
    if idle is not None and not grows:
        raise RecordingError("--idle is for a recording that grows; give --follow too, or leave it out.")
    if place is not None and Path(place).exists() and not force:
        raise StoreError(f"{place} exists already; give another place with --out, or --force to overwrite it.")
    from plantfit.estimators import check_estimable
    from plantfit.findings.results.tracked import RaisedAlarm, Tracked
    from plantfit.tracking import track as tracker_of

    opened, one = one_given(given, store, lambda problem: check_estimable(problem, {}))
    read = _reader(one.ready.study, like, grows)
    answers, numbers = answers_of(opened, [one], workers, json)
    with said_line(json) as say:
        table = one.ready.study.table.estimate.model_dump(exclude_unset=True)
        tracker = tracker_of(answers[given], every=step, false_alarm=false_alarm, progress=say, table=table)
    with ExitStack() as stack:
        stop = stack.enter_context(stoppable("Stopping: working off what came. Ctrl-C again stops at once."))
        source = _source(recording, read, grows, wait, stop)
        rows = _Rows(stack.enter_context(_written(place, json)), tracker)
        for part in source:
            rows.told(tracker.feed(part))
        rows.told(tracker.finish())
    written = {} if place is None else {"rows": place}
    if json:
        alarms = [
            RaisedAlarm(**dict[str, Any](vars(a), alike=list(a.alike)), sentence=a.sentence) for a in tracker.alarms
        ]
        end = dict[str, float | None](tracker.rows[-1]) if tracker.rows else None
        made = Tracked(
            study=numbers[given], samples=tracker.samples, looks=tracker.changes.looks, false_alarm=false_alarm,
            alarms=alarms, end=end,
            sentence=tracker.sentence, written=written,
        )  # fmt: skip
        return print_json(made.printed())
    tell = warn if place is None else lambda text: out.print(text, markup=False)
    tell(tracker.sentence)
    if place is not None:
        out.print(f"Written: {place} ({len(tracker.rows)} rows)", markup=False)


@contextmanager
def _written(place: str | None, quiet: bool) -> Generator[TextIO | None]:
    """Where rows go: a file, standard output, or nowhere."""
    if place is None:
        yield None if quiet else sys.stdout
        return
    with open(place, "w", encoding="utf-8", newline="") as stream:
        yield stream


class _Rows:
    """Rows as they are made, as CSV to a file or to standard output, and alarms at once."""

    def __init__(self, to: TextIO | None, tracker: Any):
        self.tracker, self.to, self.count = tracker, to, 0
        if self.to is not None:
            self.to.write(",".join(n if u in (None, "1") else f"{n} [{u}]" for n, u in tracker.units.items()) + "\n")

    def told(self, alarms: Any) -> None:
        """Write what is new."""
        new = self.tracker.rows[self.count :]
        self.count += len(new)
        if self.to is not None and new:
            self.to.writelines(",".join(f"{row[n]:.9g}" for n in self.tracker.units) + "\n" for row in new)
            self.to.flush()
        for alarm in alarms:
            warn(alarm.sentence)


def _reader(study: Any, like: str | None, grows: bool) -> Callable[[Path], Any]:
    """How a file with the columns of a recording of the study is read."""
    from plantfit.spec.recordings import read_recording

    tables = study.table.recording
    if like is not None and like not in tables:
        raise SpecError(f"--like {like}: the study has no such recording; it has {', '.join(tables)}.")
    name = like or next(iter(tables))
    table = tables[name].model_copy(update={"unmeasured": []})
    steps = [s.get("step") for s in table.clean if s.get("step") not in ROWWISE]
    if grows and steps:
        raise SpecError(
            f"{study.path.name}: recording.{name}.clean has {steps[0]!r}, which looks "
            "at neighbouring rows, and rows still to come are not known; track the "
            "finished file without --follow, or leave the step out of the study."
        )

    table = _with_directions(table, study.path)

    def read(file: Path) -> Any:
        return read_recording("recording", table, study.path, {table.file: file})

    return read


def _with_directions(table: Any, path: Path) -> Any:
    """The table of a recording with both levels of its directions: rows to come may hold one of them alone."""
    import numpy as np

    from plantfit.spec.recordings import read_recording

    clean = [dict(step) for step in table.clean]
    for k, step in enumerate(clean):
        if step.get("step") == "signed" and not {"forward", "backward"} <= {*step}:
            way = read_recording("recording", table.model_copy(update={"clean": clean[:k]}), path)[step["direction"]]
            low, high = map(float, np.unique(way))
            ahead = step.get("forward", low if step.get("backward") == high else high)
            clean[k] = {**step, "forward": ahead, "backward": low if ahead == high else high}
    return table.model_copy(update={"clean": clean})


def _source(
    recording: str, read: Callable[[Path], Any], grows: bool, wait: float | None, stop: Callable[[], bool]
) -> Iterator[Any]:
    if not grows:
        yield read(Path(recording))
    elif recording == "-":
        yield from _grown(_Standard(), read, "standard input", wait, stop)
    else:
        with open(recording, "rb") as stream:
            yield from _grown(_File(stream), read, Path(recording).name, wait, stop)


class _File:
    """A file that another process writes; it ends when nothing comes for a while."""

    over = False

    def __init__(self, stream: BinaryIO):
        self.stream = stream

    def read(self) -> bytes:
        return self.stream.read()


class _Standard:
    """Standard input; it ends when it is closed."""

    def __init__(self) -> None:
        import select

        self.over, self.select = False, select.select

    def read(self) -> bytes:
        descriptor, pieces = sys.stdin.fileno(), []
        while not self.over and (sys.platform == "win32" or self.select([descriptor], [], [], 0.0)[0]):
            piece = os.read(descriptor, 1 << 16)
            self.over = not piece
            pieces.append(piece)
            if sys.platform == "win32":
                break
        return b"".join(pieces)


def _grown(
    source: Any, read: Callable[[Path], Any], name: str, wait: float | None, stop: Callable[[], bool]
) -> Iterator[Any]:
    from plantfit.recording.readers.formats.text.growing import GrowingTable

    table, came = GrowingTable(source, read, Path(name).stem or "recording"), time.monotonic()
    while not stop():
        part = table.poll()
        if part is not None:
            came = time.monotonic()
            yield part
        elif source.over or (wait is not None and time.monotonic() - came > wait):
            break
        else:
            time.sleep(POLL)
    part = table.poll(last=True)
    if part is not None:
        yield part
    if table.rows == 0:
        raise RecordingError(f"{name}: no row came; check what writes it, or wait longer with --idle.")
