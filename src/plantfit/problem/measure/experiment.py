"""One recording as a problem sees it: which samples are fitted, which are kept unseen, in the model's units."""

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plantfit import units
from plantfit.errors import RecordingError, UnitError
from plantfit.recording.record import Recording, Signal

WHAT = {"counted": "steps", "rounded": "steps", "noisy": "noise"}  # errors of inputs
SIZE = dict.fromkeys(("counted", "rounded"), "the size of one step") | {"noisy": "its standard deviation"}


@dataclass(frozen=True)
class Experiment:
    """A recording with the parts of it that are used.

    `fit` and `validate` are intervals (start, stop) in seconds of its time axis, None: nothing.
    `skip` seconds at the start of each part are simulated but not scored (unknown history).
    `before` gives inputs ahead of the first sample, in the model's unit or as a text with a unit ("20 degC"); by
    default they had their first value. `initial_time` (s) is where the states begin, before the first sample and on its
    time axis; by default they begin there. `steady` means that every sample is a plant at rest (a static curve, a table
    of operating points): its outputs are compared with the model at rest under its inputs, and time and order mean
    nothing. `shared_errors` names for an output a signal of whole numbers that tells which error of its sensor a sample
    has: samples of equal number have the same, and those of neighbouring numbers may be correlated. A place on an
    encoder's disc that comes back with every turn; without it errors belong to times. Standard errors allow for it.
    `counted` names inputs that are speeds made of counts, with the size of one count (the input's unit times seconds),
    `rounded` inputs that were read in steps of such a size; 0 says that there are none, as of a command. `noisy` names
    measured inputs with the standard deviation of the noise of single readings (the input's unit), 0 says that there is
    none. Standard errors allow for all three (`trust/intervals/misreadings.py`). `start_corrections` are added to first
    measured values of outputs (their unit) where states begin at them: the fit's estimate of the noise in that one
    sample (`trust/finish/start_corrections.py`). What is measured stays.
    """

    recording: Recording
    fit: tuple[float, float] | None = (-np.inf, np.inf)
    validate: tuple[float, float] | None = None
    skip: float = 0.0
    before: Mapping[str, float | str] = field(default_factory=dict)
    steady: bool = False
    shared_errors: Mapping[str, str] = field(default_factory=dict)
    initial_time: float | None = None
    counted: Mapping[str, float] = field(default_factory=dict)
    rounded: Mapping[str, float] = field(default_factory=dict)
    start_corrections: Mapping[str, float] = field(default_factory=dict)
    noisy: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._check_steps()
        for output in self.shared_errors:
            self.error_numbers(output)
        if self.initial_time is None:
            return
        if self.steady:
            raise RecordingError(
                f"Recording {self.recording.name!r} is steady, so time has no meaning in it; leave initial_time out."
            )
        if not self.initial_time <= self.recording.t[0]:
            raise RecordingError(
                f"Recording {self.recording.name!r}: initial_time = {self.initial_time:g} "
                f"s is not before the first sample at {self.recording.t[0]:g} s; give an "
                "earlier time of the recording's own axis, or leave it out."
            )

    def _check_steps(self) -> None:
        name, signals = self.recording.name, self.recording.signals
        for key, given in (("counted", self.counted), ("rounded", self.rounded), ("noisy", self.noisy)):
            for u, step in given.items():
                if u not in signals:
                    raise RecordingError(
                        f"Recording {name!r}: {key} names {u!r}, but the signals are {list(signals)}; name one of them."
                    )
                if not (np.isfinite(step) and step >= 0):
                    raise RecordingError(
                        f"Recording {name!r}: {key} gives {u!r} {WHAT[key]} of {step:g}; give {SIZE[key]}, or 0 for "
                        "none."
                    )
                moves, unit = (
                    self._movement(u, key == "counted"),
                    "its unit times seconds" if key == "counted" else "its unit",
                )
                if step > moves > 0:
                    raise RecordingError(
                        f"Recording {name!r}: {key} gives {u!r} {WHAT[key]} of {step:g}, but it "
                        f"moves by {moves:.3g} in all; give {SIZE[key]}, in {unit}."
                    )
        both = self.counted.keys() & self.rounded.keys()
        if both:
            raise RecordingError(
                f"Recording {name!r}: counted and rounded both name {min(both)!r}; "
                "keep one (cleaning steps that read counts make it counted)."
            )

    def _movement(self, name: str, counted: bool) -> float:
        """The way that the integral of a signal goes where it is `counted`, else the signal's range."""
        values, t = self.recording[name], self.recording.t
        there = np.isfinite(values)
        if not counted:
            return float(np.ptp(values[there])) if there.any() else 0.0
        return float(np.sum(np.abs(np.where(there, values, 0.0)[:-1]) * np.diff(t)))

    def error_numbers(self, output: str) -> np.ndarray | None:
        """Number (n,) of the error that each sample of an output has, NaN where it is not known; None where times
        number them.

        Raises RecordingError for a signal that is not there or not whole.
        """
        name = self.shared_errors.get(output)
        if name is None:
            return None
        if name not in self.recording.signals:
            raise RecordingError(
                f"Recording {self.recording.name!r}: shared_errors names {name!r} for {output!r}, but the signals are "
                f"{list(self.recording.signals)}; name one of them."
            )
        values = self.recording[name]
        if not np.all(np.isnan(values) | (values == np.round(values))):
            raise RecordingError(
                f"Recording {self.recording.name!r}: shared_errors needs whole numbers, but {name!r} has others."
            )
        return values

    def on(self, recording: Recording) -> "Experiment":
        """The same samples of another recording of the same length, whose times may differ.

        Raises RecordingError for one of another length.
        """
        if len(recording) != len(self.recording):
            raise RecordingError(
                f"Recording {recording.name!r} has {len(recording)} "
                f"samples in place of {len(self.recording)}; give as many."
            )
        old, new = self.recording.t, recording.t
        moved = [
            None if part is None else (_moved(part[0], old, new), _moved(part[1], old, new))
            for part in (self.fit, self.validate)
        ]
        return dataclasses.replace(self, recording=recording, fit=moved[0], validate=moved[1])

    def mask(self, part: str) -> np.ndarray:
        """Samples (n,) bool of part "fit" or "validation"."""
        interval = self.fit if part == "fit" else self.validate
        t = self.recording.t
        if interval is None:
            return np.zeros(len(t), dtype=bool)
        start, stop = interval
        inside = (t >= start) & (t < stop)
        if self.skip and np.any(inside):
            inside &= t >= t[np.argmax(inside)] + self.skip
        return inside


def _moved(end: float, old: np.ndarray, new: np.ndarray) -> float:
    """Where an interval ends among other times, so that the same samples lie on either side."""
    after = int(np.searchsorted(old, end))
    if np.array_equal(old, new):
        return end
    if after in (0, len(old)):
        return -np.inf if after == 0 else np.inf
    return 0.5 * (new[after - 1] + new[after])


def split(recording: Recording, share: float, skip: float = 0.0) -> Experiment:
    """The first `share` of the samples for the fit, the rest unseen; simulated in one go, so that the state carries
    over.

    `skip` seconds at the start of each part are not scored. Raises RecordingError for a share that leaves a part empty.
    """
    if not 0.0 < share < 1.0:
        raise RecordingError(
            f"split = {share:g}; give the share of the recording that is fitted, between 0 and 1, for example 0.7."
        )
    count = round(share * len(recording))
    if not 0 < count < len(recording):
        raise RecordingError(
            f"Recording {recording.name!r} has {len(recording)} samples, too few to split at {share:g}."
        )
    edge = float(recording.t[count])
    return Experiment(recording, fit=(-np.inf, edge), validate=(edge, np.inf), skip=skip)


def before_in_units(
    recording: Recording, before: Mapping[str, float | str], wanted: Mapping[str, str | None]
) -> dict[str, float]:
    """Inputs ahead of the first sample as numbers in the model's units: numbers are in them, texts such as "20 degC"
    are converted.

    Raises UnitError for a number where the recording counts from another zero, so that it is not clear which it is in.
    """
    found = {}
    for name, value in before.items():
        unit, where = wanted.get(name), f"Recording {recording.name!r}: before gives {name!r} as {value!r}"
        if isinstance(value, str):
            try:
                number, own = units.quantity(value)
            except UnitError as error:
                raise UnitError(f"{where}: {error}") from None
            if unit is None:
                raise UnitError(f"{where}, but the model has no unit for it; give a number.")
            if not units.compatible(own, unit):
                raise UnitError(
                    f"{where}, which cannot be converted to the model's {unit!r}; give it in a unit of that kind."
                )
            found[name] = units.convert(number, own, unit)
            continue
        have = recording.signals[name].unit if name in recording.signals else None
        convertible = (
            unit is not None and have is not None and have != units.difference_of(unit) and units.compatible(have, unit)
        )
        if convertible and units.factor_offset(have, unit)[1] != 0.0:
            raise UnitError(
                f"{where}, and the recording is in {have!r} but the model in {unit!r}; say which by a unit, as in "
                f'before = {{ {name} = "{value:g} {have}" }}.'
            )
        found[name] = float(value)
    return found


def _line_to_write(name: str, have: str, unit: str) -> str:
    """What to do about a recorded unit of another kind than the model's."""
    degrees = {"C": "degC", "F": "degF"}.get(have)
    if degrees is not None and units.compatible(degrees, unit):
        line = f'units = {{ {name} = "{degrees}" }}'
        return f"it is that of an electrical quantity, so for a temperature write {degrees} in the header, or {line}"
    return "correct one of them"


def in_units(recording: Recording, wanted: Mapping[str, str | None]) -> Recording:
    """The named signals in the units that the model declares; signals without a unit are taken as they are."""
    signals, log = dict(recording.signals), list(recording.log)
    for name, unit in wanted.items():
        if name not in signals:
            raise RecordingError(
                f"Recording {recording.name!r} has no signal {name!r}, which the model needs; it has "
                f"{list(recording.signals)}. "
                "Name the column for it under signals."
            )
        have = signals[name].unit
        if unit is None or have is None or have == unit:
            continue
        if units.logarithmic(have):
            raise UnitError(
                f"Recording {recording.name!r}: signal {name!r} is in {have!r}, which is logarithmic, and the model's "
                f"is in {unit!r}; "
                f"convert the column to a linear unit, or declare {name!r} without a unit to compute with levels."
            )
        if (plain := units.gauge(have)) is not None:
            raise UnitError(
                f"Recording {recording.name!r}: signal {name!r} is in {have!r}, which counts from the pressure of the "
                f"surroundings, "
                f'and the model\'s is in {unit!r}; write units = {{ {name} = "{plain}" }}, and for absolute pressures '
                f"beside it "
                f'clean = [{{ step = "subtract", signal = "{name}", amount = -{units.surroundings(plain):.6g} }}].'
            )
        if have == units.difference_of(unit):
            signals[name] = Signal(signals[name].values, unit)
            log.append(f"{name}: differences in {have}, taken as they are for {unit}.")
            continue
        if not units.compatible(have, unit):
            turns = units.dimension(have) == units.dimension(unit)
            raise UnitError(
                f"Recording {recording.name!r}: signal {name!r} is in {have!r}, which cannot be converted to the "
                f"model's {unit!r}; {units.turns_said(have, unit) if turns else _line_to_write(name, have, unit)}."
            )
        factor, offset = units.factor_offset(have, unit)
        if factor != 1.0 or offset != 0.0:
            signals[name] = Signal(signals[name].values * factor + offset, unit)
            log.append(f"{name}: converted from {have} to {unit}.")
    return Recording(recording.t, signals, recording.name, tuple(log), recording.clocked)


def experiments_of(
    recordings: Any, fitted: float | None, skip: float, validate: Sequence[str], before: Mapping[str, float | str],
    initial_time: float | None, needs: Mapping[str, str | None], inputs: Collection[str] | None = None,
) -> dict[str, Experiment]:  # fmt: skip
    """The recordings of a problem by name, in the units that its model `needs`; `fitted` is the first share of a single
    one.

    `inputs` of the model are those that may be counted or rounded. Raises RecordingError for names and shares that
    contradict each other.
    """
    if isinstance(recordings, Recording | Experiment):
        inner = recordings.recording if isinstance(recordings, Experiment) else recordings
        recordings = {inner.name: recordings}
    if not recordings:
        raise RecordingError("A problem needs at least one recording.")
    if fitted is not None and len(recordings) > 1:
        raise RecordingError("split works on one recording; with several, name the unseen ones under validate.")
    unknown = [v for v in validate if v not in recordings]
    if unknown:
        raise RecordingError(f"validate names {unknown[0]!r}, which is not one of the recordings {list(recordings)}.")
    result = {}
    for name, given in recordings.items():
        if isinstance(given, Recording):
            every = (-np.inf, np.inf)
            given = (
                split(given, fitted, skip)
                if fitted is not None
                else Experiment(
                    given,
                    fit=None if name in validate else every,
                    validate=every if name in validate else None,
                    skip=skip,
                )
            )
        for key in WHAT:
            others = [] if inputs is None else [n for n in getattr(given, key) if n not in inputs]
            if others:
                raise RecordingError(
                    f"Recording {name!r}: {key} names {others[0]!r}, which is no "
                    f"input of the model; it is for inputs, here {list(inputs or ())}."
                )
        history = before_in_units(given.recording, {**before, **given.before}, needs)
        begin = initial_time if given.initial_time is None and not given.steady else given.initial_time
        inner, now = given.recording, in_units(given.recording, needs)
        steps = {k: {n: s * _scale(inner, now, n) for n, s in getattr(given, k).items()} for k in WHAT}
        result[name] = dataclasses.replace(given, recording=now, before=history, initial_time=begin, **steps)
    return result


def _scale(before: Recording, now: Recording, name: str) -> float:
    """What a difference of a signal was multiplied by when its unit was converted."""
    old, new = before.signals[name].unit, now.signals[name].unit
    return (
        1.0
        if old == new or old is None or new is None or old == units.difference_of(new)
        else units.factor_offset(old, new)[0]
    )
