"""Free simulation over short windows, each begun anew at the measured state."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import RecordingError
from plantfit.models.model import Model
from plantfit.problem.measure.experiment import Experiment, in_units
from plantfit.problem.predictor import predictor_of
from plantfit.recording.clean.sampling import period_of
from plantfit.recording.record import Recording, Signal
from plantfit.runtime import jit

# isort: split
import jax
import jax.numpy as jnp


@dataclass(frozen=True)
class Windows:
    """`t` (w, n) in seconds; `simulated` and `measured` (w, n) of every output in its unit."""

    t: np.ndarray
    simulated: Mapping[str, np.ndarray]
    measured: Mapping[str, np.ndarray]

    def rmse(self) -> dict[str, float]:
        """Of every output over all windows; missing samples left out."""
        return {o: float(np.sqrt(np.nanmean((self.simulated[o] - y) ** 2))) for o, y in self.measured.items()}


def simulate_windows(
    model: Model,
    recordings: Mapping[str, Recording],
    values: Mapping[str, float] | Mapping[str, Mapping[str, float]],
    length: float,
    *,
    stepper: str = "exponential",
    substeps: int = 1,
    hold: Mapping[str, str] | None = None,
) -> dict[str, Windows]:
    """Simulate a model from the recorded inputs over windows of `length` seconds that follow each other, by recording.

    Each starts from the outputs measured at its first sample, as the model's initial state takes them up: a model whose
    states are all outputs restarts from the measured state. `values` are the parameters by name, for all recordings or
    by recording. All windows have the same number of samples, so that the last may stop short of the end. Raises
    RecordingError for windows longer than a record or under 2 samples.
    """
    predictor = predictor_of(model, stepper, substeps, dict(hold or {}))
    given = {name: in_units(r, predictor.needs) for name, r in recordings.items()}
    n = round(length / period_of(next(iter(given.values())))) if np.isfinite(length) and length > 0 else 0
    rows = {name: _rows(r, n, length) for name, r in given.items()}
    drives = [predictor.drive(Experiment(_piece(given[name], row))) for name, many in rows.items() for row in many]
    stacked = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *drives)
    apart = all(name in recordings and isinstance(v, Mapping) for name, v in values.items())
    own: Any = {n: values[n] if apart else values for n in given}
    named = {
        p.name: jnp.asarray([float(own[n][p.name]) for n, many in rows.items() for _ in many]) for p in model.parameters
    }
    made = {o: np.asarray(v) for o, v in jit(jax.vmap(predictor.outputs))(named, stacked).items()}
    result, start = {}, 0
    for name, many in rows.items():
        part, r = slice(start, start + len(many)), given[name]
        result[name] = Windows(r.t[many], {o: v[part] for o, v in made.items()}, {o: r[o][many] for o in model.outputs})
        start += len(many)
    return result


def _rows(recording: Recording, n: int, length: float) -> np.ndarray:
    """The samples of every window (w, n + 1); neighbours share one."""
    count = (len(recording) - 1) // n if n > 1 else 0
    if count < 1:
        raise RecordingError(
            f"simulate_windows: windows of {length:g} s do not fit into recording {recording.name!r} of "
            f"{recording.t[-1] - recording.t[0]:g} s at {period_of(recording):g} s; give a length between the two."
        )
    return n * np.arange(count)[:, None] + np.arange(n + 1)


def _piece(recording: Recording, row: np.ndarray) -> Recording:
    signals = {n: Signal(s.values[row], s.unit) for n, s in recording.signals.items()}
    return Recording(recording.t[row], signals, recording.name)
