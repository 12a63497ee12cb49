"""The table [regression] of a study file: columns of measured, differentiated signals, what they explain, and
instruments for them."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SpecError
from plantfit.estimate.inverse_dynamics import InverseDynamics
from plantfit.models import equations
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.models.parts.as_regression import as_regression
from plantfit.models.text.suggest import suggest
from plantfit.problem import Experiment
from plantfit.problem.measure.experiment import in_units
from plantfit.recording.record import Recording
from plantfit.spec.error_place import errors_at
from plantfit.spec.tables import RegressionTable, SpecTable
from plantfit.units import per_second

MOST_POWER = 0.999  # of the instruments below the frequency that is told


@dataclass(frozen=True)
class Prepared:
    """A regression as a problem takes it: the `model` of its columns, the `experiments` with these, and `instruments`
    by recording.

    `band` (Hz) is that of the parallel filter, `power_below` (Hz) holds 99.9 % of the power of the instruments.
    """

    model: LinearModel
    experiments: Mapping[str, Experiment]
    instruments: Mapping[str, Recording] | None
    band: float
    power_below: float | None

    @property
    def scales(self) -> dict[str, float]:
        """For a target that never moves, as the torque of a free joint, the spread of the others."""
        spread = {
            o: max(float(np.nanstd(e.recording[o])) for e in self.experiments.values()) for o in self.model.outputs
        }
        largest = max(spread.values())
        return {o: largest for o, s in spread.items() if largest > 0 and s <= 1e-9 * largest}

    @property
    def sentences(self) -> list[dict[str, str]]:
        """What is to be said of the band and the instruments, as looks at data are."""
        if self.power_below is None:
            return []
        told = (
            f"99.9 % of the power of the instruments lies below {self.power_below:.3g} Hz; the band ends at "
            f"{self.band:g} Hz"
        )
        if self.power_below > self.band:
            return [
                {
                    "level": "warning",
                    "sentence": f"{told} and cuts the motion.",
                    "write": f"band = {2 * self.power_below:.2g}",
                }
            ]
        return [{"level": "info", "sentence": f"{told}.", "write": ""}]


def prepared(
    table: SpecTable, model: Model | LinearModel, experiments: Mapping[str, Experiment], path: Path
) -> Prepared:
    """Columns, targets and instruments of every recording. Raises SpecError with the key that does not fit."""
    r = table.regression
    assert r is not None
    where = f"{path.name}, [regression]"
    if table.model.filter_alike is not None:
        raise SpecError(f"{where}: band already filters columns and targets alike; leave filter_alike out of [model].")
    with errors_at(where):
        linear = model if isinstance(model, LinearModel) else as_regression(model)
    if table.uncertainty:
        raise SpecError(f"{where}: a regression cannot use stated errors of instruments; leave [uncertainty] out.")
    _check(r, linear, experiments, where)
    inverse = InverseDynamics(
        linear, {a: (pair[0], pair[1]) for a, pair in r.derivatives.items()}, _targets(r, linear, experiments, where),
        tuple(r.held),
        r.smoothing, r.band,
    )  # fmt: skip
    columns: LinearModel | None = None
    made, moved = {}, {}
    for name, e in experiments.items():
        with errors_at(where):
            columns, thin = inverse.columns(e.recording)
            made[name] = replace(e, recording=thin)
            if r.method == "instrumental variables":
                moved[name] = inverse.columns(inverse.followed(e.recording, r.reference))[1]
    assert columns is not None
    power = _power_below(columns, moved) if moved else None
    return Prepared(columns, made, moved or None, r.band, power)


def _check(r: RegressionTable, model: LinearModel, experiments: Mapping[str, Experiment], where: str) -> None:
    made = {n for pair in r.derivatives.values() for n in pair}
    if r.method == "instrumental variables" and not r.reference:
        raise SpecError(
            f'{where}: instrumental variables need reference = {{ SIGNAL = "SIGNAL_ref" }}, the recorded motion that '
            f"the controller was to "
            "follow; where none was recorded, make instruments from a simulated loop in Python (docs/regression.md), "
            "or write "
            'method = "least squares".'
        )
    if r.method == "least squares" and r.reference:
        raise SpecError(
            f"{where}: reference is for instrumental variables, but method is least squares; leave one of the two out."
        )
    names = [*r.derivatives, *(n for pair in r.derivatives.values() for n in pair)]
    twice = next((n for n in names if names.count(n) > 1), None)
    if twice is not None:
        raise SpecError(
            f"{where}: derivatives names {twice!r} twice; give the signal and its two derivatives different names."
        )
    for name, e in experiments.items():
        known = list(e.recording.signals)
        for key, wanted in (
            ("derivatives", list(r.derivatives)),
            ("held", r.held),
            ("reference", list(r.reference.values())),
        ):
            for signal in wanted:
                if signal not in known:
                    raise SpecError(
                        f"{where}: {key} names {signal!r}, which recording {name!r} does not "
                        f"have.{suggest(signal, known)} It has "
                        f"{', '.join(known)}."
                    )
    for signal, reference in r.reference.items():
        if signal not in r.derivatives:
            raise SpecError(
                f"{where}: reference names {signal!r}, which is not in derivatives; there are "
                f"{', '.join(r.derivatives)}."
            )
        if reference in r.derivatives or reference in made:
            raise SpecError(
                f"{where}: reference = {{ {signal} = {reference!r} }} is a measured signal and has "
                "the errors of the columns; name the motion that the controller was to follow."
            )
        for name, e in experiments.items():
            if np.array_equal(e.recording[signal], e.recording[reference], equal_nan=True):
                raise SpecError(
                    f"{where}: in recording {name!r} {reference!r} has the same samples as {signal!r}, so it has the "
                    "same errors and cannot be an instrument; record the motion that the controller was to follow."
                )
    lacking = [a for a in r.derivatives if a not in r.reference]
    if r.reference and lacking:
        raise SpecError(
            f"{where}: reference has no entry for {lacking[0]!r}; give one for each of {', '.join(r.derivatives)}."
        )
    unknown = [o for o in r.targets if o not in model.outputs]
    if unknown:
        raise SpecError(
            f"{where}: targets names {unknown[0]!r}, which is not an output of {model.name!r}; its outputs are "
            f"{', '.join(model.outputs)}."
        )
    read = next(
        (n for n in model.signals if n not in made and any(n not in e.recording.signals for e in experiments.values())),
        None,
    )
    if read is not None:
        raise SpecError(
            f"{where}: the model reads {read!r}, which is neither recorded nor a derivative; add it to derivatives, as "
            f"in "
            f'derivatives = {{ angle = ["rate", "{read}"] }}.'
        )


def _targets(
    r: RegressionTable, model: LinearModel, experiments: Mapping[str, Experiment], where: str
) -> Callable[[Recording], Mapping[str, Any]]:
    """What the columns explain, of smoothed signals; outputs without a formula are recorded signals."""
    recorded = [o for o in model.outputs if o not in r.targets]
    for name, e in experiments.items():
        for o in recorded:
            if o not in e.recording.signals:
                raise SpecError(
                    f"{where}: {o!r} is an output, but recording {name!r} has no such signal; name its column under "
                    f"signals, "
                    f'or give a formula, as in targets = {{ {o} = "kt*i" }}.'
                )
    units = {o: model.outputs[o] for o in recorded}
    if not r.targets:
        return lambda s: _converted(s, units)
    first = next(iter(experiments.values())).recording
    known: dict[str, str | None] = {n: s.unit for n, s in first.signals.items()}
    for angle, (rate, acceleration) in ((a, (p[0], p[1])) for a, p in r.derivatives.items()):
        unit = known.get(angle)
        known[rate] = None if unit is None else per_second(unit)
        known[acceleration] = None if unit is None else per_second(per_second(unit))
    words = set(re.findall(r"[A-Za-z_]\w*", " ".join(str(v) for v in r.targets.values())))
    inputs = {n: u for n, u in known.items() if n in words and n not in r.targets}
    text = "\n".join(f"{o} = {formula}" for o, formula in r.targets.items())
    outputs = {o: model.outputs[o] for o in r.targets}
    with errors_at(f"{where} targets"):
        made = equations(text, inputs=inputs, outputs=outputs, constants=r.constants, name="targets")

    def of(s: Recording) -> Mapping[str, Any]:
        s = in_units(s, inputs)
        shape = s.t.shape
        found = made.output({}, {n: s[n] for n in inputs}, {})
        return {o: np.broadcast_to(np.asarray(found[o], dtype=float), shape) for o in outputs} | _converted(s, units)

    return of


def _converted(recording: Recording, units: Mapping[str, str | None]) -> dict[str, np.ndarray]:
    """Recorded targets in the units of the model's outputs."""
    recording = in_units(recording, units)
    return {o: recording[o] for o in units}


def _power_below(model: LinearModel, instruments: Mapping[str, Recording]) -> float:
    """The frequency (Hz) below which 99.9 % of the power of the instruments lies, the column with the fastest
    motion."""
    found = 0.0
    for recording in instruments.values():
        step = float(np.median(np.diff(recording.t)))
        for name in model.signals:
            values = recording[name] - np.mean(recording[name])
            power = np.abs(np.fft.rfft(values * np.hanning(len(values)))) ** 2
            if power.sum() <= 1e-12 * len(values) * max(float(np.sum(recording[name] ** 2)), 1e-300):
                continue
            place = int(np.searchsorted(np.cumsum(power) / power.sum(), MOST_POWER))
            found = max(found, float(np.fft.rfftfreq(len(values), step)[place]))
    return found
