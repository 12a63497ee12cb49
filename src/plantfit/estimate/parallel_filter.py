"""The same low-pass on both sides of a regression, then fewer samples."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import butter, sosfiltfilt

from plantfit.errors import RecordingError

SAMPLES = 2.5  # per period of the band's upper end that are kept: little above it is left by the filter


@dataclass(frozen=True)
class ParallelFilter:
    """Zero-phase Butterworth at `band` (Hz), then decimation to about 2.5 samples per period of it.

    Applied to the columns and the target alike it leaves the parameters as they are (Gautier, Optimal motion planning for
    robot's inertial parameters identification, CDC 1992). The first and last 1/band seconds are dropped.
    Raises RecordingError for a band that does not fit the sampling.
    """

    period: float
    band: float
    order: int = 4

    def __post_init__(self) -> None:
        if not 0 < self.band < 0.4 / self.period:
            raise RecordingError(f"band = {self.band} Hz at a period of {self.period:g} s; give one below {0.4 / self.period:g} Hz.")

    @property
    def decimation(self) -> int:
        """Samples from one that is kept to the next."""
        return max(1, int(1.0 / (SAMPLES * self.band * self.period)))

    def __call__(self, values: Any) -> np.ndarray:
        """Values (n, ...) filtered along their first axis and thinned."""
        values = np.asarray(values, dtype=float)
        edge = int(np.ceil(1.0 / (self.band * self.period)))
        if len(values) <= 3 * edge:
            raise RecordingError(f"{len(values)} samples are too few for a band of {self.band:g} Hz; give more than {3 * edge}.")
        sections = butter(self.order, 2.0 * self.band * self.period, output="sos")
        return sosfiltfilt(sections, values, axis=0)[edge : -edge : self.decimation]
