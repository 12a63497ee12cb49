"""What maximum likelihood or a Kalman filter found, where it is the answer of a problem."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

FULL_NAMES = {"ekf": "the extended Kalman filter", "ukf": "the unscented Kalman filter"}
"""Of estimators whose names in a study file are short."""


@dataclass(frozen=True, eq=False)
class Filtered:
    """Values (d,) and covariance (d, d) in the parameters' units at the cube point `z`, and 95 % intervals by name.

    `ahead` are outputs (n,) foretold one sample ahead by the filter at these values, by recording and output, NaN where
    nothing was; `told` is the rest, the fields of the record `findings.filtered.FilteredAnswer` as JSON has them.
    """

    z: np.ndarray
    values: np.ndarray
    covariance: np.ndarray
    interval: Mapping[str, tuple[float | None, float | None]]
    ahead: Mapping[str, Mapping[str, np.ndarray]]
    told: Mapping[str, Any]

    @property
    def moves(self) -> bool:
        """Whether it takes noise to move the plant."""
        return any(n["kind"] == "process" and n["value"] > 0.0 for n in self.told["noise"])
