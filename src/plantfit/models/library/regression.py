"""Models that are linear in their coefficients: measured signals as a regression on known columns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.models.model import Declared, Named
from plantfit.models.remade import reduced


@dataclass(frozen=True)
class LinearModel:
    """output = regressor(signals)[output] @ coefficients + error, for every output.

    `regressor` maps named signals, each (n,), to columns (n, k) for each of `outputs` (names to units); with one output
    it may give the array alone. `signals` are the names that it reads, with their units. Not sampled in time order:
    rows may be taken in any order.

    The k coefficients are the `parameters`, in their order, unless `base` maps named parameters to named
    `coefficients` (names to units, in the order of the columns): a pure jax function, in general not linear.
    """

    name: str
    outputs: Mapping[str, str | None]
    parameters: tuple[Declared, ...]
    regressor: Callable[[Mapping[str, Any]], Any]
    signals: Mapping[str, str | None] = field(default_factory=dict)
    coefficients: Mapping[str, str | None] = field(default_factory=dict)
    base: Callable[[Named], Named] | None = None
    sentence: str = ""
    source: str = ""

    def __reduce__(self) -> tuple[Any, ...]:
        return reduced(self)

    def __post_init__(self) -> None:
        if not self.outputs:
            raise ModelError(
                f"Model {self.name!r} has no outputs; name the measured signal that it is to explain, with its unit."
            )
        names = [p.name for p in self.parameters]
        if not names or len(set(names)) < len(names):
            raise ModelError(f"Model {self.name!r} needs parameters with different names, not {names}.")
        if (self.base is None) != (not self.coefficients):
            raise ModelError(f"Model {self.name!r}: base and coefficients belong together; give both, or neither.")
        arrays = [p.name for p in self.parameters if p.shape]
        if arrays and self.base is None:
            raise ModelError(
                f"Model {self.name!r}: parameter {arrays[0]!r} is an "
                "array; give a regression one number for each column."
            )
        if self.base is None:
            object.__setattr__(self, "coefficients", {p.name: p.unit for p in self.parameters})

    def blocks(self, signals: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """The columns (n, k) of every output, from signals, each (n,). Raises ModelError for a missing signal or a
        wrong shape."""
        missing = [s for s in self.signals if s not in signals]
        if missing:
            raise ModelError(f"Model {self.name!r} needs the signal {missing[0]!r}; given are {list(signals)}.")
        made = self.regressor(signals)
        if not isinstance(made, Mapping):
            made = {next(iter(self.outputs)): made}
        if set(made) != set(self.outputs):
            raise ModelError(
                f"Model {self.name!r}: the regressor gives columns for {list(made)}; it needs them for "
                f"{list(self.outputs)}."
            )
        k, found = len(self.coefficients), {o: np.asarray(made[o], dtype=float) for o in self.outputs}
        for output, columns in found.items():
            if columns.ndim != 2 or columns.shape[1] != k:
                of = f" of {output!r}" if len(found) > 1 else ""
                raise ModelError(
                    f"Model {self.name!r}: the regressor{of} has shape {columns.shape}; it needs {k} columns."
                )
        return found

    def columns(self, signals: Mapping[str, Any], output: str | None = None) -> np.ndarray:
        """The columns (n, k) of one output, which need not be named where it is the only one."""
        return self.blocks(signals)[self._chosen(output)]

    def coefficient_values(self, values: Named) -> list[Any]:
        """The coefficients in the order of the columns at named parameter values; jax-traceable."""
        missing = [p.name for p in self.parameters if p.name not in values]
        if missing:
            raise ModelError(f"Model {self.name!r}: no value for parameter {missing[0]!r}.")
        named = values if self.base is None else self.base(values)
        return [named[n] for n in self.coefficients]

    def predict(self, signals: Mapping[str, Any], values: Mapping[str, float], output: str | None = None) -> np.ndarray:
        """One output (n,) in its unit at named parameter values."""
        return self.columns(signals, output) @ np.array(self.coefficient_values(values), dtype=float)

    def _chosen(self, output: str | None) -> str:
        if output is None and len(self.outputs) == 1:
            return next(iter(self.outputs))
        if output not in self.outputs:
            raise ModelError(
                f"Model {self.name!r}: output {output!r} is not one of "
                f"its outputs {list(self.outputs)}; name one of them."
            )
        return str(output)
