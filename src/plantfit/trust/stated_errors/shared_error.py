"""An error that all samples of a set-up share: of an instrument, of the clock, of a value that was assumed."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.record import Recording, Signal
from plantfit.trust.stated_errors.uncertainty_budget import Source

Kind = Literal["offset", "gain", "zero", "full scale", "clock", "constant"]


@dataclass(frozen=True)
class SharedError:
    """An error that is one number e for all samples: of all recordings, of some `recordings`, or a number of its own
    for each (`per_recording`, as where a zero is set before every run).

    `kind` tells what it does: "offset" adds e to the signal `of`; "gain" multiplies the signal by 1 + e; "full scale"
    adds e y/span; "zero" adds e (1 - y/span); "clock" makes times 1 + e as long; "constant" adds e to the parameter
    `of`, one number for all recordings that the problem holds at a value, or that is free in the problem but was held
    in the fit. Several signals `of` move together, as channels of one card with its reference do.
    """

    source: Source
    kind: Kind
    of: str | tuple[str, ...] = ""
    span: float = 1.0
    recordings: tuple[str, ...] | None = None
    per_recording: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """The signals, or the parameter, that it is an error of."""
        return (self.of,) if isinstance(self.of, str) else self.of

    @property
    def constant(self) -> str | None:
        """The parameter that it is an error of, if it is one of a parameter."""
        return self.names[0] if self.kind == "constant" else None

    def touches(self, recordings: Sequence[str]) -> tuple[str, ...]:
        """Those of the recordings that have it; raises RecordingError where one is named that is not there."""
        missing = [n for n in self.recordings or () if n not in recordings]
        if missing:
            raise RecordingError(
                f"The error {self.source.name!r} names recording {missing[0]!r}; there are {list(recordings)}."
            )
        return tuple(n for n in recordings if self.recordings is None or n in self.recordings)

    def sensitivity(self, reading: float) -> float:
        """By how much a reading moves for a unit of e."""
        share = reading / self.span
        return {"gain": reading, "full scale": share, "zero": 1.0 - share}.get(self.kind, 1.0)

    def corrected(self, recording: Recording, error: float) -> Recording:
        """The recording without an error of this size."""
        if self.kind == "constant":
            return recording
        if self.kind == "clock":
            first = recording.t[0]
            return Recording(
                first + (recording.t - first) / (1.0 + error), recording.signals, recording.name, recording.log
            )
        moved = {n: Signal(self._without(recording[n], error), recording.signals[n].unit) for n in self.names}
        return Recording(recording.t, {**recording.signals, **moved}, recording.name, recording.log)

    def _without(self, y: np.ndarray, error: float) -> np.ndarray:
        if self.kind == "offset":
            return y - error
        if self.kind == "gain":
            return y / (1.0 + error)
        if self.kind == "full scale":
            return y / (1.0 + error / self.span)
        return (y - error) / (1.0 - error / self.span)
