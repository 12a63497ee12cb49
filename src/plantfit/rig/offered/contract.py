"""What a rig offers by name: its numbers with units and limits, what is asked of it, and the record with its truth."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording
from plantfit.recording.write import to_csv

if TYPE_CHECKING:
    from plantfit.rig.offered.tuned import Tuned

Kind = Literal["constant", "noise", "setting"]


class Number(NamedTuple):
    """A number that a user may set, in `unit`; `value` is what it is otherwise, None where `sentence` says how it is
    found.

    It lies from `least` to `most`, above `least` where that is `open`; `whole` numbers have no fraction.
    """

    name: str
    unit: str
    value: float | None
    sentence: str
    kind: Kind = "constant"
    least: float = 0.0
    open: bool = True
    most: float = math.inf
    whole: bool = False

    def refused(self, value: float) -> str:
        """What is wrong with a value, as the end of a sentence; empty where nothing is."""
        what = "a whole number" if self.whole else "a number"
        low = f"above {self.least:g}" if self.open else f"of at least {self.least:g}"
        high = f" and at most {self.most:g}" if math.isfinite(self.most) else ""
        fits = value > self.least if self.open else value >= self.least
        if math.isfinite(value) and fits and value <= self.most and (not self.whole or value == round(value)):
            return ""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.name} = {value:g}{unit} cannot be ({self.sentence}); give {what} {low}{high}{unit}"


class Asked(NamedTuple):
    """What a user asks of a rig: numbers by name in their units, a seed, and where they say so seconds, an
    excitation, channels to drop."""

    numbers: Mapping[str, float]
    given: frozenset[str]  # names of the numbers that the user set
    seed: int
    duration: float | None
    period: float | None
    excitation: str | Recording | None
    without: tuple[str, ...]
    controller: "Tuned | None" = None


@dataclass(frozen=True)
class OfferedRig:
    """A rig by name. `optional` are channels that a record may come without; `excitation` says what it may be driven
    by, empty where its motion is fixed; `loop` what a tuned controller reads and gives, empty where the rig has no
    such loop. `record` makes what was asked for; `duration` and `period` (s) are those where nothing was asked."""

    name: str
    sentence: str
    numbers: tuple[Number, ...]
    record: Callable[[Asked], "RigRecord"]
    duration: float
    period: float
    excitation: str = ""
    optional: tuple[str, ...] = ()
    loop: str = ""


@dataclass(frozen=True)
class RigRecord:
    """`recording`: what the sensors said. `exact`: signals without their faults. `truth`: JSON types, what no bench
    could know.

    `study(file, name)` is the text of a study file called `name` for a record in `file`.
    """

    recording: Recording
    exact: Recording
    truth: Mapping[str, Any]
    study: Callable[[str, str], str] = field(repr=False)

    def save(self, path: str | Path, study: bool = False, exact: bool = False, force: bool = False) -> dict[str, Path]:
        """Write the record (CSV) and beside it its truth, RECORD.truth.json; with `study` RECORD.toml, with `exact`
        RECORD.exact.csv.

        Gives the paths by "record", "truth", "study" and "exact". Raises RecordingError where one is there already and
        `force` is not set, and where the folder cannot be written to.
        """
        places = _places(Path(path), study, exact)
        there = next((p for p in places.values() if p.exists()), None)
        if there is not None and not force:
            raise RecordingError(
                f"{str(there)!r} exists already; give another name with --out, or --force to overwrite it."
            )
        to_csv(self.recording, places["record"])
        _write(places["truth"], json.dumps({**self.truth, "record": places["record"].name}, indent=2) + "\n")
        if study:
            _write(places["study"], self.study(places["record"].name, places["study"].stem))
        if exact:
            to_csv(self.exact, places["exact"])
        return places


def _places(record: Path, study: bool, exact: bool) -> dict[str, Path]:
    stem = record.name.removesuffix(".gz").removesuffix(".csv")
    if stem in ("", record.name):
        raise RecordingError(
            f"{str(record)!r} is no name of a CSV file; give one that ends in .csv or .csv.gz, as in --out record.csv."
        )
    if not record.parent.is_dir():
        raise RecordingError(
            f"There is no folder {str(record.parent)!r} to write "
            f"{record.name!r} into; make it, or choose another place."
        )
    places = {"record": record, "truth": record.with_name(f"{stem}.truth.json")}
    if study:
        places["study"] = record.with_name(f"{stem}.toml")
    if exact:
        places["exact"] = record.with_name(f"{stem}.exact.csv")
    return places


def _write(place: Path, text: str) -> None:
    try:
        place.write_text(text, "utf-8")
    except OSError as error:
        raise RecordingError(
            f"File {str(place)!r} cannot be written ({error.strerror}); choose another place."
        ) from None


def truth_of(
    rig: "OfferedRig", asked: Asked, drawn: Mapping[str, Any], determined: Mapping[str, Any], driven: str
) -> dict[str, Any]:
    """The truth of a record: numbers by kind with their units, what the seed drew, what a record can determine, what
    drove the rig."""

    def kind(wanted: Kind) -> dict[str, Any]:
        own = [n for n in rig.numbers if n.kind == wanted and n.name in asked.numbers]
        return {n.name: {"value": float(asked.numbers[n.name]), "unit": n.unit, "sentence": n.sentence} for n in own}

    return {
        "rig": rig.name, "seed": asked.seed, "constants": kind("constant"), "noise": kind("noise"),
        "settings": kind("setting"),
        "duration_s": rig.duration if asked.duration is None else asked.duration,
        "period_s": rig.period if asked.period is None else asked.period,
        "excitation": driven, "left_out": list(asked.without), "drawn": dict(drawn), "determined": dict(determined),
    }  # fmt: skip
