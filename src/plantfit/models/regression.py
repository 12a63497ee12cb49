"""Models that are linear in their parameters: a regression of one measured signal on known columns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.models.model import Declared


@dataclass(frozen=True)
class LinearModel:
    """target = regressor(signals) @ parameters + error.

    `regressor` maps named signals, each (n,), to the columns (n, k) in the order of `parameters`.
    `target` names the measured signal in `outputs`, in `unit`; `signals` are the names that the
    regressor reads, with their units. Not sampled in time order: rows may be taken in any order.
    """

    name: str
    outputs: Mapping[str, str | None]
    parameters: tuple[Declared, ...]
    regressor: Callable[[Mapping[str, Any]], np.ndarray]
    target: str
    unit: str | None = None
    signals: Mapping[str, str | None] = field(default_factory=dict)
    sentence: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if self.target not in self.outputs:
            raise ModelError(f"Model {self.name!r}: target {self.target!r} is not one of its outputs {list(self.outputs)}.")
        names = [p.name for p in self.parameters]
        if not names or len(set(names)) < len(names):
            raise ModelError(f"Model {self.name!r} needs parameters with different names, not {names}.")
        arrays = [p.name for p in self.parameters if p.shape]
        if arrays:
            raise ModelError(f"Model {self.name!r}: parameter {arrays[0]!r} is an array; give a regression one number for each column.")

    def columns(self, signals: Mapping[str, Any]) -> np.ndarray:
        """The regressor (n, k) of signals, each (n,). Raises ModelError for a missing signal or a wrong shape."""
        missing = [s for s in self.signals if s not in signals]
        if missing:
            raise ModelError(f"Model {self.name!r} needs the signal {missing[0]!r}; given are {list(signals)}.")
        columns = np.asarray(self.regressor(signals), dtype=float)
        if columns.ndim != 2 or columns.shape[1] != len(self.parameters):
            raise ModelError(f"Model {self.name!r}: the regressor has shape {columns.shape}; it needs {len(self.parameters)} columns.")
        return columns

    def predict(self, signals: Mapping[str, Any], values: Mapping[str, float]) -> np.ndarray:
        """The target (n,) at named parameter values, in `unit`."""
        missing = [p.name for p in self.parameters if p.name not in values]
        if missing:
            raise ModelError(f"Model {self.name!r}: no value for parameter {missing[0]!r}.")
        return self.columns(signals) @ np.array([values[p.name] for p in self.parameters])
