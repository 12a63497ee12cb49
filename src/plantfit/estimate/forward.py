"""Parameters from simulated outputs: records in windows that each begin in a state of their own."""

import dataclasses
import itertools
from collections.abc import Mapping

import numpy as np

from plantfit.errors import ModelError, RecordingError
from plantfit.models.model import Declared, Model, Named
from plantfit.recording.clean.parts import cut
from plantfit.recording.record import Recording


def windows(recording: Recording, length: float) -> dict[str, Recording]:
    """The recording in whole windows of `length` seconds, "w0", "w1", ...; the rest is left out.

    Raises RecordingError when it is shorter than one.
    """
    start, stop = float(recording.t[0]), float(recording.t[-1])
    count = int((stop - start) / length + 1e-9) if length > 0 else 0
    if count < 1:
        raise RecordingError(f"A window of {length:g} s in a recording of {stop - start:g} s; give a shorter one above 0.")
    half = 0.5 * float(np.median(np.diff(recording.t)))  # the last sample of a window is not the first of the next
    edges = start + length * np.arange(count + 1) - half
    return {f"w{k}": cut(recording, float(a), float(b)) for k, (a, b) in enumerate(itertools.pairwise(edges))}


def free_start(model: Model, spread: Mapping[str, float]) -> Model:
    """The model with parameters NAME_start, for the states named in `spread`, that are added to its initial state.

    Each lies within +-spread, in the unit of the state. Raises ModelError for names that are no states.
    """
    unknown = [n for n in spread if n not in model.states]
    if unknown:
        raise ModelError(f"Model {model.name!r} has no state {unknown[0]!r}; it has {list(model.states)}.")
    if model.initial_state is None:
        raise ModelError(f"Model {model.name!r} has no initial state to begin near; give it an initial_state.")
    begin = model.initial_state

    def initial_state(p: Named, u0: Named, y0: Named) -> Named:
        return {n: v + p[f"{n}_start"] if n in spread else v for n, v in begin(p, u0, y0).items()}

    added = (Declared(f"{n}_start", model.states[n], (-s, s), sentence=f"added to {n} at the first sample") for n, s in spread.items())
    return dataclasses.replace(model, parameters=(*model.parameters, *added), initial_state=initial_state)
