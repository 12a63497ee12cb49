"""A Kalman filter that is given one sample at a time."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import RecordingError
from plantfit.estimate.filters.filter_step import Spread, filter_step
from plantfit.estimate.filters.rows_on_line import RowsOnLine
from plantfit.estimate.filters.state_space import StateSpace

import jax
import jax.numpy as jnp


class Now(NamedTuple):
    """What is believed after a sample: values and standard deviations of states by name, parameters with (low, high)
    of 2 sd, NIS."""

    states: dict[str, float]
    sd: dict[str, float]
    parameters: dict[str, float]
    bands: dict[str, tuple[float, float]]
    nis: float


class Online:
    """Call `update` at every sample, in order of time; `mean` (n,) and `root` (n, n) are the belief after the last
    one."""

    def __init__(
        self,
        plant: StateSpace,
        spread: Spread,
        values: np.ndarray,
        own: np.ndarray,
        root: np.ndarray,
        drift: np.ndarray,
    ):
        self.plant, self.values, self.own = plant, jnp.asarray(values), own
        self.mean: Any = None
        self.root: Any = jnp.asarray(root)
        self._rows = RowsOnLine(plant, np.asarray(values))

        def step(mean, root, row):
            c = plant.constants(self.values, drift)
            exact = jax.tree.map(lambda a: a[0], plant.exact_at(self.values, row.h[None])) if plant.exact else None
            belief, told = filter_step(plant, spread, False, c, (mean, root), row._replace(exact=exact))
            return *belief, jnp.sum(told["white"] ** 2)

        self._step = jax.jit(step)
        self._first = jax.jit(plant.first)

    def update(self, t: float, u: Mapping[str, float], y: Mapping[str, float]) -> Now:
        """The belief at t (s) with the measurements y taken there; u acts from t to the next sample. Outputs left out
        or NaN are missing.

        Raises RecordingError for a time that does not grow or an input that is missing.
        """
        model = self.plant.model
        here, seen = (
            np.array(_values("input", u, model.inputs, needed=True)),
            np.array(_values("output", y, model.outputs)),
        )
        if self.mean is None:
            drive = self.plant.simulator.drive(
                np.array([t]),
                {n: here[i : i + 1] for i, n in enumerate(model.inputs)},
                measured={n: seen[i : i + 1] for i, n in enumerate(model.outputs)},
            )
            self.mean = jnp.concatenate([self._first(self.values, drive), self.own])
        last = self._rows.last
        if not np.isfinite(t) or (last is not None and t < last):
            raise RecordingError(f"A sample at {t:g} s came after one at {last:g} s; give samples in order of time.")
        nis = 0.0
        for row, _ in self._rows.feed(np.array([t]), here[None]).chunks(1, seen[None]):
            self.mean, self.root, own = self._step(self.mean, self.root, jax.tree.map(lambda a: a[0], row))
            nis += float(own)  # edges of late inputs are not measured
        return self._now(nis)

    def _now(self, nis: float) -> Now:
        n, names = self.plant.states, [self.plant.space.names[i] for i in self.plant.joint]
        mean, sd = np.asarray(self.mean), np.sqrt(np.sum(np.asarray(self.root) ** 2, axis=1))
        value, low, high = (np.asarray(self.plant.physical(mean[n:] + k * sd[n:])).tolist() for k in (0, -2, 2))
        states = tuple(self.plant.model.states)
        bands = dict(zip(names, zip(low, high, strict=True), strict=True))
        own = dict(zip(states, mean[:n].tolist(), strict=True)), dict(zip(states, sd[:n].tolist(), strict=True))
        return Now(*own, dict(zip(names, value, strict=True)), bands, nis)


def _values(kind: str, given: Mapping[str, float], names: Any, needed: bool = False) -> list[float]:
    wrong = [n for n in given if n not in names]
    if wrong:
        raise RecordingError(f"There is no {kind} {wrong[0]!r}; there are {list(names)}.")
    values = [float(given.get(n, np.nan)) for n in names]
    if needed and not np.all(np.isfinite(values)):
        missing = list(names)[int(np.argmin(np.isfinite(values)))]
        raise RecordingError(f"Input {missing!r} has no value; an input needs one at every sample.")
    return values
