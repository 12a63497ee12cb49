"""What generalised least squares found: an answer, the noise of every output, and how far least squares is from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:  # its rooms of scipy are slow to import
    from plantfit.problem.correlated.noise import Noise

SURE = 0.01  # p-value below which a difference is called one


@dataclass(frozen=True)
class Difference:
    """The test that least squares gives the same but for correlated noise (Hausman, Econometrica 46 (1978) 1251, eq.
    2.9): chi-squared with so many degrees of freedom over these, and how likely a larger one is by chance. Most
    differs `name`, `before` by least squares and `after`."""

    statistic: float
    degrees: int
    p: float
    name: str
    before: float
    after: float

    @property
    def differs(self) -> bool:
        return self.p < SURE


@dataclass(frozen=True, eq=False)
class OutputNoise:
    """The `noise` of an output in `scale` (its `unit`) over so many `samples`; `left` is the correlation of neighbours
    that it does not explain."""

    output: str
    unit: str | None
    noise: "Noise"
    scale: float
    samples: int
    left: float

    def fields(self) -> dict[str, Any]:
        """Of the record `findings.residuals.CorrelatedNoise`."""
        noise, shared = self.noise, None
        if noise.spread is not None and noise.form is not None:
            in_proportion = noise.form.endswith("proportion")
            shared = float(np.sqrt(noise.shared_variance)) * (1.0 if in_proportion else self.scale)
        return {
            "output": self.output, "unit": self.unit, "deviation": noise.deviation * self.scale, "order": noise.order,
            "correlation": noise.correlation, "samples": self.samples, "independent": noise.degrees, "left": self.left,
            "shared": shared, "form": noise.form,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Weighted:
    """Values (d,) and covariance (d, d) in the parameters' units at the cube point `z`, 95 % intervals by name with
    ends of None where nothing fixes them, the noise of every output, and sentences about what was assumed.

    `difference` is None where the estimate hardly can differ from that of least squares.
    """

    z: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    interval: Mapping[str, tuple[float | None, float | None]]
    noises: tuple[OutputNoise, ...]
    difference: Difference | None
    remarks: tuple[str, ...]


__all__ = ["SURE", "Difference", "OutputNoise", "Weighted"]
