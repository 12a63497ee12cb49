"""Parameters of a machine from its inverse dynamics: from angles and torques to an unbiased estimate."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import RecordingError, SimulationError
from plantfit.estimate.comparison import Comparison, compare_estimates
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.instrumental import instrumental_variables
from plantfit.models.library.regression import LinearModel
from plantfit.problem.measure.experiment import in_units
from plantfit.problem.measure.filter_alike import filter_alike
from plantfit.recording.clean.filters import lowpass
from plantfit.recording.clean.sampling import uniform_period, with_signal
from plantfit.recording.record import Recording, Signal
from plantfit.recording.signals.derivative import differentiate

FEWEST = 16  # samples that the parallel filter needs, forwards and backwards
SAMPLES = 2.5  # kept per period of the band's upper end: the filter leaves little above it


@dataclass(frozen=True)
class InverseFit:
    """`estimate` by instrumental variables, plain `least_squares` on the same rows (all alike), and whether they
    differ (`bias`)."""

    estimate: Estimate
    least_squares: Estimate
    bias: Comparison


@dataclass(frozen=True)
class InverseDynamics:
    """How recorded angles become the rows of a regression `model` whose outputs are torques.

    `joints` name each measured angle with the signals of its rate and acceleration. Angles and `held` inputs pass a
    low-pass at `smoothing` Hz (None: none) before they are differentiated; columns and torques then the parallel filter
    of `band` Hz, the band of the motion. `held` names signals that are constant from each sample to the next: at a
    sample such a signal has the mean of both sides. `torques(signals)` gives the torque of every output, an array or a
    number.
    """

    model: LinearModel
    joints: Mapping[str, tuple[str, str]]
    torques: Callable[[Recording], Mapping[str, Any]]
    held: tuple[str, ...] = ()
    smoothing: float | None = 20.0
    band: float = 5.0

    def motion(self, recording: Recording) -> Recording:
        """The recording with smoothed angles and inputs, rates and accelerations."""
        for name in self.held:
            if name in recording.signals:
                values = recording[name]
                centred = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1])])
                recording = with_signal(
                    recording, name, centred, recording.signals[name].unit, f"{name!r} is held between samples."
                )
                recording = self._smooth(recording, name)
        for angle, (rate, acceleration) in self.joints.items():
            known = {n: s for n, s in recording.signals.items() if n not in (rate, acceleration)}
            recording = self._smooth(Recording(recording.t, known, recording.name, recording.log), angle)
            recording = differentiate(recording, angle, rate, "central")
            recording = differentiate(recording, rate, acceleration, "central")
        return recording

    def _smooth(self, recording: Recording, name: str) -> Recording:
        return recording if self.smoothing is None else lowpass(recording, name, self.smoothing, order=4)

    def columns(self, recording: Recording) -> tuple[LinearModel, Recording]:
        """The regression whose signals are its columns, and these signals, filtered in parallel and thinned."""
        period = uniform_period(recording, "inverse dynamics")
        if not 0 < self.band < 0.4 / period:
            raise RecordingError(
                f"band = {self.band:g} Hz at a period of {period:g} s; give one between 0 and {0.4 / period:g} Hz."
            )
        every = max(1, int(1.0 / (SAMPLES * self.band * period)))
        least = max(FEWEST, 2 * round(1.0 / self.band / period) + every + 1)
        if len(recording) < least:
            raise RecordingError(
                f"Recording {recording.name!r} has {len(recording)} samples, which are too few: the filter of band = "
                f"{self.band:g} Hz needs "
                f"{least} at this sampling rate; use a longer "
                f"recording{', or a higher band' if least > FEWEST else ''}."
            )
        signals = self.motion(recording)
        given = self.torques(signals)
        missing = [o for o in self.model.outputs if o not in given]
        if missing:
            raise RecordingError(f"torques gives {list(given)}; it needs {missing[0]!r} too, 0 where no torque acts.")
        for output, unit in self.model.outputs.items():
            torque = np.broadcast_to(given[output], signals.t.shape)
            signals = with_signal(signals, output, torque, unit, f"{output!r} is computed from the other signals.")
        model, made = filter_alike(
            self.model, {recording.name: signals}, self.band, order=4, every=every, drop=1.0 / self.band
        )
        return model, made[recording.name]

    def rows(self, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
        """Columns (N, m, k) and torques (N, m) of all m outputs, filtered in parallel and thinned."""
        thin = self.columns(recording)[1]
        columns = [np.stack([thin[f"{o}: {n}"] for n in self.model.coefficients], axis=-1) for o in self.model.outputs]
        return np.stack(columns, axis=1), np.stack([thin[o] for o in self.model.outputs], axis=-1)

    def fit(
        self,
        recording: Recording,
        simulate: Callable[[Mapping[str, float]], Recording] | None = None,
        reference: Mapping[str, str] | None = None,
        iterations: int = 10,
    ) -> InverseFit:
        """The coefficients of the model by instrumental variables.

        The first instruments come from the `reference` motion, angle -> signal of the recording that its controller was
        to follow, or where it is left out from the recording itself, which is plain least squares. `simulate(values)`
        gives the angles of the closed loop without noise, from which the next ones are made. Give one of the two at
        least. Raises RecordingError for what is missing, SimulationError where the loop cannot be simulated at an
        estimate.
        """
        if simulate is None and reference is None:
            raise RecordingError(
                "There is nothing to make instruments of; give simulate (the "
                "closed loop without noise) or reference (the motion to follow)."
            )
        (x, y), names = self.rows(recording), tuple(self.model.coefficients)
        plain = instrumental_variables(x, y, x, names, whiten=False)
        first = x if reference is None else self.rows(self.followed(recording, reference))[0]
        again = None if simulate is None else lambda values: self.rows(_simulated(simulate, values))[0]
        estimate = instrumental_variables(
            x, y, first if again is None else again, names, start=first, iterations=iterations
        )
        return InverseFit(
            estimate, plain, compare_estimates(plain, estimate, ("plain least squares", "instrumental variables"))
        )

    def followed(self, recording: Recording, reference: Mapping[str, str]) -> Recording:
        """The recording with the angles that its controller was to follow, angle -> signal, in place of those measured.

        References are converted to the units of the angles. Raises RecordingError where one is missing, UnitError for
        another kind of unit.
        """
        missing = [angle for angle in self.joints if angle not in reference]
        if missing:
            raise RecordingError(
                f"reference names no signal for {missing[0]!r}; give one for each of {list(self.joints)}."
            )
        units = {n: recording.signals[a].unit for a, n in reference.items()}
        meant = in_units(recording, units)
        signals = {a: Signal(meant[n], units[n]) for a, n in reference.items()}
        return Recording(recording.t, {**recording.signals, **signals}, recording.name)


def _simulated(simulate: Callable[[Mapping[str, float]], Recording], values: Mapping[str, float]) -> Recording:
    try:
        return simulate(values)
    except SimulationError as error:
        told = ", ".join(f"{n} = {v:.4g}" for n, v in values.items())
        raise SimulationError(
            f"Instruments cannot be simulated at {told}: {error} Begin with the reference motion."
        ) from None
