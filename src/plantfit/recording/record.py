"""A recording: named signals over one time axis, with units and the story of how they came about."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import RecordingError
from plantfit.recording.told import recording_text


@dataclass(frozen=True)
class Signal:
    """Values of one channel, shape (n,), float64; NaN marks a missing sample. `unit` None: unknown."""

    values: np.ndarray
    unit: str | None = None


@dataclass(frozen=True, repr=False)
class Recording:
    """Signals sampled together at times `t` (n,) in seconds, strictly increasing.

    `log` tells every step from the file to these values, one sentence each; `clocked` that times are those of a column,
    also where they look like numbers of rows. The arrays are copies and read-only; every cleaning step returns a new
    recording. Raises RecordingError for times that do not increase and signals of other lengths.
    """

    t: np.ndarray
    signals: Mapping[str, Signal]
    name: str = "recording"
    log: tuple[str, ...] = ()
    clocked: bool = False

    def __post_init__(self) -> None:
        t = np.array(self.t, dtype=float)
        if t.ndim != 1 or len(t) == 0:
            raise RecordingError(f"Recording {self.name!r} has no samples; check the file and the columns chosen.")
        if not np.all(np.isfinite(t)):
            row = int(np.argmin(np.isfinite(t)))
            raise RecordingError(
                f"Recording {self.name!r}: time is missing at sample {row}; remove that row or fill its time."
            )
        back = np.flatnonzero(np.diff(t) <= 0)
        if len(back):
            k = int(back[0])
            raise RecordingError(
                f"Recording {self.name!r}: time does not increase at sample {k + 1} ({t[k]:g} s, then {t[k + 1]:g} s); "
                "sort the rows or cut the recording there."
            )
        signals = {}
        for name, signal in self.signals.items():
            values = np.array(signal.values, dtype=float)
            if values.shape != t.shape:
                raise RecordingError(
                    f"Recording {self.name!r}: signal {name!r} has {values.size} values but time has {t.size}."
                )
            values.flags.writeable = False
            signals[name] = Signal(values, signal.unit)
        t.flags.writeable = False
        object.__setattr__(self, "t", t)
        object.__setattr__(self, "signals", signals)

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return recording_text(self)

    def __reduce__(self) -> tuple[Any, ...]:
        return Recording, (self.t, dict(self.signals), self.name, self.log, self.clocked)

    def __getitem__(self, name: str) -> np.ndarray:
        """Values of a signal."""
        if name not in self.signals:
            raise RecordingError(f"Recording {self.name!r} has no signal {name!r}; it has {list(self.signals)}.")
        return self.signals[name].values
