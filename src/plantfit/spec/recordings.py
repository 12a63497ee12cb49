"""The recordings of a study file: read, cleaned step by step, divided into fitted and unseen."""

import difflib
import inspect
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from plantfit import recording as rec
from plantfit import units
from plantfit.errors import NoTimeError, SpecError, UnitError, in_words
from plantfit.problem import Experiment, split
from plantfit.recording.readers.columns import unit_in_name
from plantfit.recording.unmeasured import unmeasured
from plantfit.spec.error_place import errors_at
from plantfit.spec.limits import check_step
from plantfit.spec.tables import RecordingTable

CLEANING = (
    "drop_outliers", "drop_samples", "fill_gaps", "detrend", "subtract", "scale", "convert_units", "resample",
    "lowpass", "differentiate",
    "smooth_motion", "presliding", "decimate", "cut", "shift_time", "duty_to_voltage", "counts_to_angle",
    "counts_to_speed",
    "period_to_speed", "moving_rms", "odometry", "backdate", "keep_every", "signed", "unwrap",
)  # fmt: skip
_LEVEL = re.compile(r".*[^_\W]_(?P<unit>dB[mVuW]?)")  # names that end in a level


def named_file(file: str, path: Path) -> Path:
    """Where a file lies that the study file at `path` names."""
    return Path(file) if Path(file).is_absolute() else path.parent / file


def read_recording(name: str, r: RecordingTable, path: Path, files: Mapping[str, Path] | None = None) -> rec.Recording:
    """The recording of one table, cleaned as it says."""
    file = (files or {}).get(r.file) or named_file(r.file, path)
    given = {
        "time": r.time, "time_unit": r.time_unit, "period": r.period, "signals": r.signals, "units": r.units or None,
        "sheet": r.sheet, "sort": r.sort or None, "duplicates": r.duplicates,
        "missing": r.missing or None, "dates": r.dates,
    }  # fmt: skip
    with errors_at(f"{path.name}, [recording.{name}]"):
        options = {k: v for k, v in given.items() if v is not None}
        try:
            record = rec.read(file, name=name, **options)
        except NoTimeError:
            if not r.steady:
                raise
            record = rec.read(file, name=name, **options, period=1.0)  # rows at rest have numbers, and need no times
    for i, step in enumerate(r.clean):
        arguments = dict(step)
        kind = arguments.pop("step", None)
        if kind is None:
            raise SpecError(
                f'{path.name}: recording.{name}.clean[{i}] says no step; write step = "NAME". Known steps: '
                f"{', '.join(CLEANING)}."
            )
        if kind not in CLEANING:
            near = difflib.get_close_matches(str(kind), CLEANING, 1)
            raise SpecError(
                f"{path.name}: recording.{name}.clean[{i}] has step = {kind!r}; "
                f"{f'did you mean {near[0]!r}? ' if near else ''}Known steps: {', '.join(CLEANING)}."
            )
        try:
            function = getattr(rec, kind)
            names = (signature := inspect.signature(function)).parameters
            if (
                "signal" in arguments and "signal" not in names and "name" in names
            ):  # what study files call the name of a signal
                arguments["name"] = arguments.pop("signal")
            check_step(arguments, len(record), f"{path.name}: recording.{name}.clean[{i}] ({kind})")
            _check_names(signature, arguments)
            with errors_at(f"{path.name}: recording.{name}.clean[{i}]"):
                record = function(record, **arguments)
        except (TypeError, ValueError, LookupError, AttributeError, ArithmeticError, MemoryError) as error:
            told = in_words(error).removeprefix(f"{kind}() ")
            raise SpecError(
                f"{path.name}: recording.{name}.clean[{i}] ({kind}): {told}; see docs/recordings.md."
            ) from error
    with errors_at(f"{path.name}, [recording.{name}]"):
        return unmeasured(record, r.unmeasured) if r.unmeasured else record


def check_units_in_names(
    name: str, r: RecordingTable, record: rec.Recording, needs: Mapping[str, str | None], path: Path
) -> None:
    """Refuse a column without a unit whose name ends in another one than the model's, as f_Hz for a rate in rad/s:
    its numbers would be taken as they are, off by 2 pi, 1000 or 273."""
    for signal, need in needs.items():
        header = (r.signals or {}).get(signal, signal)
        cleaned = any(signal in (step.get("signal"), step.get("name")) for step in r.clean)
        known = signal not in record.signals or record.signals[signal].unit is not None
        if need is None or known or cleaned or not isinstance(header, str):
            continue
        level = _LEVEL.fullmatch(header.strip())
        have = level["unit"] if level else unit_in_name(header)
        if have is None or (not level and (_alike(have, need) or units.dimension(have) != units.dimension(need))):
            continue
        if level and units.logarithmic(need):
            continue
        said = f"{path.name}, [recording.{name}]: the column {header!r} ends in {have!r}, and {signal!r} is in {need!r}"
        meant = f'units = {{ {signal} = "{need}" }} if its numbers are in {need}'
        if level:
            raise UnitError(
                f"{said} in the model. Levels are not converted: convert the column to a linear unit, declare "
                f"{signal!r} without a unit to compute with levels, or write {meant}."
            )
        turns = not units.compatible(have, need) and have.endswith("Hz")
        line = f'units = {{ {signal} = "{"turn/s" if have == "Hz" else "kiloturn/s" if turns else have}" }}'
        raise UnitError(f"{said} in the model. Write {line}{' if a cycle is one turn' if turns else ''}, or {meant}.")


def _alike(have: str, need: str) -> bool:
    return units.equal(have, need) or units.is_difference(need)


def counted_signals(clean: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Speeds that cleaning steps make of counts, and the size of a count in them (rad): differenced ones, and
    derivatives of an angle."""
    angles: dict[str, float] = {}
    found: dict[str, float] = {}
    for step in clean:
        kind, source, name = step.get("step"), step.get("signal"), str(step.get("name"))
        if kind in ("counts_to_angle", "counts_to_speed"):
            of = angles if kind == "counts_to_angle" else found
            of[name] = 2 * np.pi * float(step.get("ratio", 1.0)) / float(step["counts"])
        elif kind == "differentiate" and source in angles and step.get("derivative", 1) == 1:
            found[name if "name" in step else f"{source}d"] = angles[source]
    return found


def _check_names(signature: inspect.Signature, arguments: Mapping[str, object]) -> None:
    """TypeError in the words of a study file where a step gets too many or too few of its arguments."""
    known = list(signature.parameters)[1:]  # the first is the recording
    if "signal" not in known:
        known = ["signal" if n == "name" else n for n in known]
    unknown = next((n for n in arguments if n not in signature.parameters), None)
    if unknown is not None:
        near = difflib.get_close_matches(unknown, known, 1)
        raise TypeError(
            f"there is no key {unknown!r}{f' (did you mean {near[0]!r}?)' if near else ''}; this step takes "
            f"{', '.join(known)}"
        )
    try:
        signature.bind(None, **arguments)
    except TypeError as error:
        lacking = re.search(r"'(\w+)'", str(error))
        if lacking is None:
            raise
        key = "signal" if lacking[1] == "name" and "signal" in known else lacking[1]
        raise TypeError(f"the key {key!r} is missing; add it") from None


def experiments_of(name: str, r: RecordingTable, path: Path, files: Mapping[str, Path]) -> dict[str, Experiment]:
    """The experiment of one table under its name, or with `pieces` one for each piece of its fitted part, NAME-1,
    NAME-2, ..."""
    whole = experiment_of(name, r, path, files)
    if r.pieces is None:
        return {name: whole}
    beside = {
        "validate": whole.validate,
        "steady": r.steady,
        "initial_time": r.initial_time is not None,
        "fit = false": not whole.fit,
    }
    for key, given in beside.items():
        if given:
            raise SpecError(
                f"{path.name}: recording.{name} has pieces, which are parts of what is "
                f"fitted, and also {key}; leave one of them out. An unseen part can "
                "stand in a table of its own, [recording.OTHER], with the same file."
            )
    assert whole.fit is not None
    with errors_at(f"{path.name}, [recording.{name}] pieces"):
        cut = rec.pieces(rec.cut(whole.recording, *whole.fit), r.pieces)
    return {own.name: replace(whole, recording=own, fit=(-np.inf, np.inf)) for own in cut}


def experiment_of(name: str, r: RecordingTable, path: Path, files: Mapping[str, Path]) -> Experiment:
    record = read_recording(name, r, path, files)
    steps = {"counted": r.counted, "rounded": r.rounded, "noisy": r.noisy}
    if r.split is not None:
        if r.fit is not None or r.validate_ is not None:
            raise SpecError(
                f"{path.name}: recording.{name} has split, and also fit "
                "or validate; keep split alone, or fit and validate."
            )
        with errors_at(path.name):
            cut = split(record, r.split, r.skip)
            return Experiment(
                record, cut.fit, cut.validate, r.skip, r.before, r.steady, r.shared_errors, r.initial_time, **steps
            )
    every = (-np.inf, np.inf)
    unseen = every if r.validate_ is True else r.validate_
    fit = None if r.fit is False or (r.fit is None and r.validate_ is True) else (r.fit or every)
    if fit is not None and unseen is not None and fit == every:
        raise SpecError(
            f"{path.name}: recording.{name} has validate but no fit; add fit = "
            "[start, stop] in seconds, with no time that is in validate too."
        )
    for what, interval in (("fit", fit), ("validate", unseen)):
        if interval is not None and interval[0] >= interval[1]:
            raise SpecError(
                f"{path.name}: recording.{name}.{what} = {list(interval)} is "
                "empty; give [start, stop] in seconds with start before stop."
            )
    if fit is not None and unseen is not None and max(fit[0], unseen[0]) < min(fit[1], unseen[1]):
        raise SpecError(
            f"{path.name}: recording.{name}: fit {list(fit)} and validate {list(unseen)} "
            "overlap; unseen data must not be fitted, so choose intervals that do not overlap."
        )
    with errors_at(path.name):
        return Experiment(record, fit, unseen, r.skip, r.before, r.steady, r.shared_errors, r.initial_time, **steps)
