"""A model near an equilibrium as matrices: x' = A (x - x0) + B (u - u0), y = y0 + C (x - x0) + D (u - u0)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import cont2discrete

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.model import Model
from plantfit.simulate.steps.vector import VectorModel, vectorise

import jax
import jax.numpy as jnp


@dataclass(frozen=True, eq=False)
class LinearPlant:
    """Matrices of a plant about (x0, u0), in the order of the names; `units` of every state, input and output.

    A (n, n), B (n, m), C (p, n), D (p, m); x0 (n,), u0 (m,), y0 (p,). Continuous for `period` None, else
    x[k+1] - x0 = A (x[k] - x0) + B (u[k] - u0) with inputs held over `period` seconds.
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    x0: np.ndarray
    u0: np.ndarray
    y0: np.ndarray
    units: Mapping[str, str | None]
    period: float | None = None


def linearised(
    model: Model,
    parameters: Mapping[str, Any],
    x0: Mapping[str, float] | None = None,
    u0: Mapping[str, float] | None = None,
    tolerance: float = 1e-6,
) -> LinearPlant:
    """The model near its equilibrium at states `x0` and inputs `u0` (by name, others 0), by exact derivatives.

    Raises SimulationError where a state moves faster than `tolerance` (its unit per second): find an
    equilibrium near it with `equilibrium`.
    """
    vector = _smooth(model)
    p, x, u = (
        _numbers(vector, parameters),
        by_name("x0", vector.states, x0 or {}),
        by_name("u0", tuple(model.inputs), u0 or {}),
    )
    rates, y, (a, b), (c, d) = jax.tree.map(np.asarray, _local(vector, p)(x, u))
    worst = int(np.argmax(np.abs(rates)))
    if not np.all(np.abs(rates) <= tolerance):
        raise SimulationError(
            f"Plant {model.name!r} does not rest at x0, u0: the rate of {vector.states[worst]!r} "
            f"is {rates[worst]:g} {model.states[vector.states[worst]] or ''}/s, beyond "
            f"{tolerance:g}; give an equilibrium, such as equilibrium() finds."
        )
    return LinearPlant(
        a,
        b,
        c,
        d,
        vector.states,
        tuple(model.inputs),
        vector.outputs,
        np.asarray(x),
        np.asarray(u),
        y,
        {**model.states, **model.inputs, **model.outputs},
    )


def equilibrium(
    model: Model,
    parameters: Mapping[str, Any],
    x0: Mapping[str, float],
    u0: Mapping[str, float] | None = None,
    fixed: Sequence[str] = (),
) -> tuple[dict[str, float], dict[str, float]]:
    """The equilibrium nearest to `x0`, `u0`, both by name, with the states and inputs `fixed` as they are.

    Least squares on all rates (scipy's trust region) by exact derivatives. Raises SimulationError where
    some rate stays above 1e-8: free another state or input, or begin nearer.
    """
    vector = _smooth(model)
    names = (*vector.states, *model.inputs)
    for name in fixed:
        if name not in names:
            raise SimulationError(
                f"Plant {model.name!r} has no state or input {name!r} to keep fixed; it has {list(names)}."
            )
    local = _local(vector, _numbers(vector, parameters))
    start = np.concatenate([by_name("x0", vector.states, x0), by_name("u0", tuple(model.inputs), u0 or {})])
    free, n = np.array([name not in fixed for name in names]), len(vector.states)

    def both(z):
        full = start.copy()
        full[free] = z
        return full[:n], full[n:]

    def jacobian(z):
        return np.concatenate(local(*both(z))[2], axis=1)[:, free]

    if np.any(free):
        found = least_squares(
            lambda z: np.asarray(local(*both(z))[0]),
            start[free],
            jac=jacobian,
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        start[free] = found.x
    left = np.asarray(local(start[:n], start[n:])[0])
    worst = int(np.argmax(np.abs(left)))
    if not np.all(np.abs(left) <= 1e-8):
        raise SimulationError(
            f"Plant {model.name!r} has no equilibrium near x0 with {list(fixed)} fixed: the rate of "
            f"{vector.states[worst]!r} stays at "
            f"{left[worst]:g}; free another state or input, or begin nearer."
        )
    return dict(zip(vector.states, map(float, start[:n]), strict=True)), dict(
        zip(model.inputs, map(float, start[n:]), strict=True)
    )


def discretised(plant: LinearPlant, period: float) -> LinearPlant:
    """The plant sampled every `period` seconds with its inputs held (scipy's cont2discrete, "zoh")."""
    if plant.period is not None:
        raise SimulationError(
            f"The plant is discrete already, with a period of {plant.period:g} s; give the continuous one."
        )
    if not (np.isfinite(period) and period > 0):
        raise SimulationError(f"period = {period}; give the sampling period in seconds, above 0.")
    sampled: Any = cont2discrete((plant.A, plant.B, plant.C, plant.D), period, "zoh")
    return replace(plant, A=sampled[0], B=sampled[1], period=float(period))


def by_name(what: str, names: Sequence[str], given: Any, default: float = 0.0) -> np.ndarray:
    """One number for each name: from a number for all, or a mapping in which others are `default`."""
    if not isinstance(given, Mapping):
        return np.broadcast_to(np.asarray(given, dtype=float), (len(names),)).copy()
    unknown = [k for k in given if k not in names]
    if unknown:
        raise SimulationError(f"{what} names {unknown[0]!r}; it may name {list(names)}.")
    return np.array([float(given.get(name, default)) for name in names])


def _smooth(model: Model) -> VectorModel:
    if not model.states or model.delays or not model.smooth:
        raise SimulationError(
            f"Plant {model.name!r} is static, or has dead time, events, dry friction, backlash or late states; "
            "linearise a model of states and smooth equations."
        )
    return vectorise(model)


def _numbers(vector: VectorModel, parameters: Mapping[str, Any]) -> tuple[Any, ...]:
    missing = [name for name in vector.parameters if name not in parameters]
    if missing:
        raise SimulationError(
            f"Plant {vector.model.name!r}: no value for parameter {missing[0]!r}; it has {list(vector.parameters)}."
        )
    return tuple(jnp.asarray(parameters[name], dtype=float) for name in vector.parameters)


def _local(vector: VectorModel, p):
    """`(x, u) -> rates, outputs, their slopes (A, B) and (C, D)`, one compiled function."""

    def rates(x, u):
        return jnp.stack(vector.rate(tuple(x), (*u, 0.0), p))

    def outputs(x, u):
        return jnp.stack(vector.output(tuple(x), (*u, 0.0), p))

    return jax.jit(
        lambda x, u: (rates(x, u), outputs(x, u), jax.jacfwd(rates, (0, 1))(x, u), jax.jacfwd(outputs, (0, 1))(x, u))
    )
