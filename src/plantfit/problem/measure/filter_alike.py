"""Parallel filtering: the same low-pass on the columns of a regression and on what they explain."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from plantfit.errors import RecordingError
from plantfit.models.library.regression import LinearModel
from plantfit.models.remade import remade
from plantfit.problem.measure.experiment import in_units
from plantfit.recording.clean.butterworth import smooth
from plantfit.recording.clean.sampling import uniform_period
from plantfit.recording.record import Recording, Signal


def filter_alike(
    model: LinearModel,
    recordings: Mapping[str, Recording],
    cutoff: float,
    order: int = 3,
    every: int = 1,
    drop: float = 0.1,
) -> tuple[LinearModel, dict[str, Recording]]:
    """The model and its recordings with every column and every output filtered alike.

    output = columns @ coefficients stays true under any linear filter of both sides, nonlinear as the columns may be in
    the motion; filtering the motion alone does not keep it. Zero-phase Butterworth of `order` at `cutoff` Hz; then
    `drop` seconds at both ends go, where the filter runs in, and every `every`-th sample stays. The signals of the new
    recordings are the outputs and, named "output: coefficient", the columns. Needs even steps. Raises RecordingError
    otherwise, and where nothing is left.

    Source: Gautier, Dynamic identification of robots with power model, ICRA 1997; Janot, Vandanjon, Gautier, IEEE
    Transactions on Control Systems Technology 22 (2014), section II.
    """
    if not isinstance(every, (int, np.integer)) or isinstance(every, bool) or every < 1:
        raise RecordingError(f"filter_alike: every is {every!r}; give a whole number of at least 1.")
    if not drop >= 0:
        raise RecordingError(f"filter_alike: drop is {drop!r}; give seconds of at least 0.")
    made = {
        name: _filtered(model, recording, cutoff, order, int(every), drop) for name, recording in recordings.items()
    }
    return _of_columns(model), made


def of_columns(model: LinearModel) -> bool:
    """Whether the signals of a regression are its columns, as `filter_alike` makes them."""
    return list(model.signals) == _names(model)


def _filtered(
    model: LinearModel, recording: Recording, cutoff: float, order: int, every: int, drop: float
) -> Recording:
    step = f"filter_alike({recording.name!r})"
    recording = in_units(recording, {**model.signals, **model.outputs})
    period = uniform_period(recording, step)
    edge = round(drop / period)
    kept = slice(edge, len(recording) - edge, every)
    if len(recording.t[kept]) < 2:
        raise RecordingError(
            f"{step}: nothing is left of {len(recording)} samples after {drop:g} s at both ends; give a smaller drop."
        )
    signals = {}
    for output, columns in model.blocks({n: recording[n] for n in model.signals}).items():
        signals[output] = Signal(
            smooth(recording[output], period, cutoff, order, False, step)[kept], model.outputs[output]
        )
        for name, column in zip(model.coefficients, columns.T, strict=True):
            signals[f"{output}: {name}"] = Signal(smooth(column, period, cutoff, order, False, step)[kept])
    thinned = f", every {every}th kept" if every > 1 else ""
    sentence = (
        f"Columns of {model.name!r} and its outputs filtered alike (zero-phase Butterworth, order {order}, "
        f"{cutoff:.4g} Hz); "
        f"{edge} samples dropped at both ends{thinned}: {len(recording.t[kept])} of {len(recording)}."
    )
    return Recording(recording.t[kept], signals, recording.name, (*recording.log, sentence))


@remade
def _of_columns(model: LinearModel) -> LinearModel:
    """The same regression where the columns themselves are the signals."""

    def regressor(signals: Mapping[str, Any]) -> dict[str, np.ndarray]:
        return {
            o: np.stack([np.asarray(signals[f"{o}: {n}"], dtype=float) for n in model.coefficients], axis=-1)
            for o in model.outputs
        }

    return LinearModel(
        name=model.name,
        outputs=model.outputs,
        parameters=model.parameters,
        regressor=regressor,
        signals=dict.fromkeys(_names(model)),
        coefficients={} if model.base is None else model.coefficients,
        base=model.base,
        sentence=model.sentence,
        source=model.source,
    )


def _names(model: LinearModel) -> list[str]:
    return [f"{o}: {n}" for o in model.outputs for n in model.coefficients]
