"""What a control design gives, and what all designs share: weights, limits, references."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.linear.linear_plant import LinearPlant, by_name
from plantfit.errors import SimulationError
from plantfit.models.model import Model
from plantfit.simulate.loop.closed_loop import ClosedLoop, Controller, closed_loop
from plantfit.simulate.loop.sensors import Actuator, Sensor

import jax.numpy as jnp

Limits = Any  # (low, high) for all inputs, or by name


@dataclass(frozen=True, eq=False)
class Design:
    """A controller for `plant`'s outputs and inputs every `period` seconds, and the `parameters` that it was designed
    to; `limits` (m,) of the inputs where the parameters do not hold them.

    In its loop a reference is a mapping, {} to hold the plant's x0, u0: states to follow by name, and inputs to add to.
    """

    controller: Controller
    parameters: Any
    plant: LinearPlant
    period: float
    limits: tuple[np.ndarray, np.ndarray] | None = None

    def close(
        self,
        model: Model,
        *,
        sensor: Sensor | Mapping[str, Sensor] = Sensor(),  # noqa: B008  (frozen)
        actuator: Actuator | Mapping[str, Actuator] = Actuator(),  # noqa: B008  (frozen)
        stepper: str = "auto",
        substeps: int = 10,
    ) -> ClosedLoop:
        """The loop around `model` over the design's outputs and inputs; options as in `closed_loop`."""
        return closed_loop(
            model,
            self.controller,
            period=self.period,
            output=self.plant.outputs,
            input=self.plant.inputs,
            sensor=sensor,
            actuator=actuator,
            stepper=stepper,
            substeps=substeps,
        )


def weight(what: str, given: Any, names: tuple[str, ...], definite: bool) -> np.ndarray:
    """A symmetric weight (n, n): a matrix as it is, or a diagonal from a number for all or numbers by name (others
    0)."""
    full = np.asarray(given, dtype=float) if not isinstance(given, Mapping) else None
    matrix = full if full is not None and full.ndim == 2 else np.diag(by_name(what, names, given))
    if matrix.shape != (len(names),) * 2 or not np.allclose(matrix, matrix.T):
        raise SimulationError(
            f"{what} has shape {matrix.shape}; give a symmetric matrix over {list(names)}, or weights by name."
        )
    least = np.linalg.eigvalsh(matrix)[0]
    if not (least > 0 if definite else least >= -1e-12 * np.abs(matrix).max()):
        raise SimulationError(
            f"{what} has the eigenvalue {least:g}; give weights {'above' if definite else 'of at least'} 0."
        )
    return matrix


def limits_of(limits: Limits, names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper (m,); names not given, or limits None, are free."""
    pairs: dict[str, Any] = (
        {} if limits is None else dict(limits if isinstance(limits, Mapping) else dict.fromkeys(names, limits))
    )
    low = by_name("limits", names, {k: v[0] for k, v in pairs.items()}, -np.inf)
    high = by_name("limits", names, {k: v[1] for k, v in pairs.items()}, np.inf)
    for name, a, b in zip(names, low, high, strict=True):
        if not a < b:
            raise SimulationError(f"The limits of {name!r} are [{a:g}, {b:g}]; give lower below upper.")
    return low, high


def stacked(values: Any, names: tuple[str, ...]) -> Any:
    """Values by name, or the only one, as an array (n,)."""
    return (
        jnp.stack([values[name] for name in names])
        if isinstance(values, Mapping)
        else jnp.reshape(values, (len(names),))
    )


def followed(reference: Any, names: tuple[str, ...], rest: Any, others: tuple[str, ...] = ()) -> Any:
    """The reference (n,) of the named signals; those that it does not name are to stay at `rest`. It may name
    `others` too."""
    known = [*names, *others]
    if not isinstance(reference, Mapping):
        raise SimulationError(
            f"The reference is one number; give a mapping that may name {known}, {{}} to hold the equilibrium."
        )
    for name in reference:
        if name not in known:
            raise SimulationError(f"The reference names {name!r}; this controller follows {known}.")
    return jnp.stack([jnp.asarray(reference.get(name, rest[k])) for k, name in enumerate(names)])


def named(values: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """An array (m,) as a command by name."""
    return {name: values[k] for k, name in enumerate(names)}
