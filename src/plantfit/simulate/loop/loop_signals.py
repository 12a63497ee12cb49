"""What one simulation of a closed loop is given: references, further inputs, noise and initial states, checked and
named."""

from collections.abc import Mapping
from typing import Any, TypedDict

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError

import jax.numpy as jnp


class Given(TypedDict, total=False):
    """What may be given beside the reference.

    `samples` = N where nothing else says it; `x0` initial states by name (others 0); `inputs` every further
    input of the plant, scalar or (N,), held over each sample; `noise` (N,), by name for several outputs, is
    added to the output before the sensor rounds it.
    """

    samples: int | None
    x0: Mapping[str, Any] | None
    inputs: Mapping[str, Any] | None
    noise: Any


Rows = dict[str, Any]  # "reference", "reference NAME", "input NAME", "noise NAME" -> scalar or (N,)


def rows_of(reference: Any, inputs: Mapping[str, Any], noise: Any, outputs: tuple[str, ...]) -> Rows:
    """All signals of a simulation under one name each; raises SimulationError for noise that does not fit the
    outputs."""
    named = (
        {f"reference {k}": v for k, v in reference.items()}
        if isinstance(reference, Mapping)
        else {"reference": reference}
    )
    named |= {f"input {k}": v for k, v in inputs.items()}
    if noise is not None:
        if not isinstance(noise, Mapping):
            if len(outputs) > 1:
                raise SimulationError(
                    f"The noise is one array for the outputs {list(outputs)}; give a mapping with an array for each."
                )
            noise = dict.fromkeys(outputs, noise)
        unknown = [k for k in noise if k not in outputs]
        if unknown:
            raise SimulationError(f"noise names {unknown[0]!r}; the loop measures {list(outputs)}.")
        named |= {f"noise {k}" if len(outputs) > 1 else "noise": v for k, v in noise.items()}
    return {k: jnp.asarray(v, dtype=float) for k, v in named.items()}


def reference_in(row: Rows) -> Any:
    """The reference of one sample in the form that was given: a scalar, or a dict by name."""
    if "reference" in row:
        return row["reference"]
    return {k.removeprefix("reference "): v for k, v in row.items() if k.startswith("reference ")}


def noise_in(row: Rows, output: str, single: bool) -> Any:
    """The noise on one output in one sample, or None."""
    return row.get("noise" if single else f"noise {output}")


def split(rows: Rows) -> tuple[Rows, Rows]:
    """Signals that stay, and those that change from sample to sample."""
    return {k: v for k, v in rows.items() if v.ndim == 0}, {k: v for k, v in rows.items() if v.ndim == 1}


def length(rows: Rows, samples: int | None) -> int:
    """The number of samples; raises SimulationError for shapes that do not fit."""
    lengths = {name: a.shape[0] for name, a in rows.items() if a.ndim == 1}
    wrong = [name for name, a in rows.items() if a.ndim > 1]
    if wrong:
        raise SimulationError(f"The {wrong[0]} has shape {rows[wrong[0]].shape}; give (N,), or batch with jax.vmap.")
    if samples is None and not lengths:
        raise SimulationError("The reference is one number; give samples = N, or a reference for every sample.")
    n = samples if samples is not None else next(iter(lengths.values()))
    if n < 1:
        raise SimulationError(f"samples = {n}; simulate at least one.")
    for name, count in lengths.items():
        if count != n:
            raise SimulationError(f"The {name} has {count} values for {n} samples; give one for each.")
    return n
