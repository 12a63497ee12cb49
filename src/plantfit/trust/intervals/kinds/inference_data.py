"""Draws of parameters as ArviZ takes them: groups of draws, of what was measured and of what the draws foretell, as
netCDF 4."""

import io
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

import numpy as np

import plantfit
from plantfit.errors import MissingExtra
from plantfit.problem.new_recording import predict_over
from plantfit.problem.problem import Problem

FORETOLD = 200  # draws whose readings are written
Group = dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, str]]]  # name -> dimensions, values, attributes


@dataclass(frozen=True)
class Drawn:
    """`values` (chains, draws, d) in the parameters' units, `stats` by name (chains, draws), `how` they were drawn
    in a sentence."""

    values: np.ndarray
    stats: Mapping[str, np.ndarray] = field(default_factory=dict)
    how: str = ""


def need_h5netcdf() -> None:
    """Raise MissingExtra where h5netcdf is not installed."""
    if any(sys.modules.get(n, True) is None or find_spec(n) is None for n in ("h5netcdf", "h5py")):
        raise MissingExtra("Draws are written by the package h5netcdf; install it with: pip install 'plantfit[arviz]'")


def netcdf_of(problem: Problem, drawn: Drawn, noise: Mapping[str, float], seed: int) -> bytes:
    """Draws as a file for ArviZ (`az.from_netcdf`, every version) and xarray, with the groups of `inference_data`.

    Raises MissingExtra where h5netcdf is not installed.
    """
    own = {
        "inference_library": "plantfit",
        "inference_library_version": plantfit.__version__,
        "study": problem.name,
        "how": drawn.how,
    }
    return as_netcdf(inference_data(problem, drawn, noise, seed), own)


def inference_data(problem: Problem, drawn: Drawn, noise: Mapping[str, float], seed: int) -> dict[str, Group]:
    """Groups by the names of ArviZ's InferenceData: posterior, sample_stats, observed_data, posterior_predictive.

    Readings scatter normally about the plant's outputs by `noise`, in each output's unit. They are written of at most
    200 draws, evenly taken from each chain. A problem of several recordings has one variable for each output and
    recording.
    """
    chains, draws, _ = drawn.values.shape
    both: Group = {"chain": (("chain",), np.arange(chains), {}), "draw": (("draw",), np.arange(draws), {})}
    names, units = _distinct(problem.space.names), [c.unit for c in problem.space.coordinates]
    posterior: Group = {
        n: (("chain", "draw"), drawn.values[:, :, k], {"units": units[k] or "1"}) for k, n in enumerate(names)
    }
    stats: Group = {n: (("chain", "draw"), np.asarray(v), {}) for n, v in drawn.stats.items()}
    some = np.unique(np.linspace(0, draws - 1, max(1, min(draws, FORETOLD // chains))).astype(int))
    observed: Group = {}
    foretold: Group = {"chain": both["chain"], "draw": (("draw",), some, {})}
    several, rng = len(problem.experiments) > 1, np.random.default_rng(seed)
    labels = dict(zip(problem.experiments, _distinct(list(problem.experiments)), strict=True))
    for recording, experiment in problem.experiments.items():
        courses = [[predict_over(problem, v, recording) for v in chain[some]] for chain in drawn.values]
        time = f"t of {labels[recording]}" if several else "t"
        observed[time] = foretold[time] = ((time,), np.asarray(experiment.recording.t, dtype=float), {"units": "s"})
        for output, label in zip(problem.outputs, _distinct(list(problem.outputs)), strict=True):
            name = f"{label} of {labels[recording]}" if several else label
            unit = {"units": getattr(problem.model, "outputs", {}).get(output) or "1"}
            plant = np.array([[course[output] for course in chain] for chain in courses])
            reading = plant + noise.get(output, 0.0) * rng.standard_normal(plant.shape)
            if output in experiment.recording.signals:
                observed[name] = ((time,), np.asarray(experiment.recording[output], dtype=float), unit)
            foretold[name] = (("chain", "draw", time), reading, unit)
    return {
        "posterior": both | posterior,
        "sample_stats": both | stats,
        "observed_data": observed,
        "posterior_predictive": foretold,
    }


def as_netcdf(groups: Mapping[str, Group], attributes: Mapping[str, str]) -> bytes:
    """Groups as the bytes of a netCDF 4 file. Raises MissingExtra where h5netcdf is not installed."""
    need_h5netcdf()
    import h5netcdf

    buffer = io.BytesIO()
    with h5netcdf.File(buffer, "w") as file:
        file.attrs.update(_texts(attributes))
        for name, group in groups.items():
            held: Any = file.create_group(name)
            held.attrs.update(_texts(attributes))
            for dimensions, values, _ in group.values():
                for dimension, size in zip(dimensions, values.shape, strict=True):
                    if dimension not in held.dimensions:
                        held.dimensions[dimension] = size
            for variable, (dimensions, values, own) in group.items():
                held.create_variable(variable, dimensions, data=values, dtype=values.dtype).attrs.update(_texts(own))
    return buffer.getvalue()


def _texts(attributes: Mapping[str, str]) -> dict[str, str]:
    """Attributes that HDF5 takes: without characters of zero or halves of characters."""
    return {k: v.encode("utf-8", "replace").decode().replace("\0", " ") for k, v in attributes.items()}


def _distinct(names: Sequence[str]) -> list[str]:
    """Names that netCDF takes, without control characters and slashes, each its own."""
    found: list[str] = []
    for name in names:
        label = " ".join("".join(c if c.isprintable() and c != "/" else " " for c in name).split()) or "unnamed"
        while label in found or label in ("chain", "draw", "t"):
            label += "_"
        found.append(label)
    return found
