"""A filter made ready for records and for samples as they come."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError, SpaceError
from plantfit.estimate.filters.beliefs import FilterRun
from plantfit.estimate.filters.filter_step import Spread, filter_step
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.filters.online import Online
from plantfit.estimate.filters.state_space import Record, StateSpace
from plantfit.native import native_scan
from plantfit.problem.measure.experiment import Experiment, in_units
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording

import jax
import jax.numpy as jnp


class Filter:
    """A filter made ready: compiled once, run over whole records or step by step (`online`)."""

    def __init__(
        self,
        problem: Problem,
        plant: StateSpace,
        noise: Noise,
        spread: Spread,
        at: Any = None,
        prior: Any = None,
        drift: Any = None,
    ):
        _refuse_free(noise)
        names = [plant.space.names[i] for i in plant.joint]
        for what, given in (("prior", prior), ("drift", drift)):
            wrong = [n for n in given or {} if n not in names]
            if wrong:
                raise SpaceError(f"{what} names {wrong[0]!r}, which is not estimated; estimated are {names}.")
        self.problem, self.plant, self.spread, self.noise = problem, plant, spread, noise
        self.drift = np.array([(drift or {}).get(n, 0.0) for n in names])
        self.begin(at, prior)
        self.filtered = jax.jit(self._filtered)

    def begin(self, at: Mapping[str, float] | None, prior: Mapping[str, float] | None) -> None:
        """Begin at other values, as wide as `prior` says; nothing is compiled anew."""
        plant = self.plant
        self.values = base_values(self.problem, at)
        self.own = plant.place(self.values[list(plant.joint)])
        names = [plant.space.names[i] for i in plant.joint]
        box = dict(zip(names, plant.prior_spread(), strict=True))
        levels = [*self.noise.initial_levels(plant.model), *((prior or {}).get(n, box[n]) for n in names)]
        self.root = np.diag(np.asarray(levels, dtype=float))

    def _filtered(self, values: Any, own: Any, root: Any, record: Record) -> Any:
        plant, c = self.plant, self.plant.constants(values, self.drift)
        rows, rank = plant.rows(values, record)
        first = jnp.concatenate([plant.first(values, record.drive), own])

        def body(belief, row):
            belief, told = filter_step(plant, self.spread, True, c, belief, row)
            return belief, (belief, told)

        (mean, root), told = native_scan(body, (first, root), rows, keep=True, fallback=True)[1]
        return mean, root, told, rank

    def run(self, recording: Recording | None = None, *, fitted: bool = False) -> FilterRun:
        """Over the recording it was made for, or another one with the same signals; with `fitted` over the
        measurements of the part that is fitted, up to the last of them."""
        experiment = self.problem.experiments[str(self.plant.recording)]
        if recording is not None:
            experiment = Experiment(in_units(recording, self.problem.needs), before=experiment.before)
        record = self.plant.record(self.problem, experiment, fitted=fitted and recording is None)
        mean, root, told, rank = jax.tree.map(
            np.asarray, self.filtered(*map(jnp.asarray, (self.values, self.own, self.root)), record)
        )
        if not np.all(np.isfinite(mean)):
            k = int(np.argmin(np.all(np.isfinite(mean), axis=1)))
            raise SimulationError(
                f"The filter diverged at row {k} of recording {experiment.recording.name!r}; "
                "start nearer, narrow the box or give more process noise."
            )
        return FilterRun(
            self.plant,
            self.values,
            experiment.recording.t[: len(rank)],
            mean[rank],
            root[rank],
            np.asarray(record.y),
            told,
            rank,
            mean,
            root,
        )

    def online(self) -> Online:
        """The same filter, given one sample at a time; before the first, inputs had the value that they have there."""
        return Online(self.plant, self.spread, self.values, self.own, self.root, self.drift)


def base_values(problem: Problem, at: Mapping[str, float] | None) -> np.ndarray:
    """Values (d,) of the problem's coordinates: `at`, else the start, else the middle of the box (of the logarithm
    on a log scale)."""
    space = problem.space
    middle = np.asarray(space.physical(np.full(space.dimension, 0.5) if space.start is None else space.start))
    wrong = [n for n in at or {} if n not in space.names]
    if wrong:
        raise SpaceError(f"at names {wrong[0]!r}, which is not a free parameter; free are {list(space.names)}.")
    for c in space.coordinates:
        value = (at or {}).get(c.name)
        if value is not None and not c.lower <= value <= c.upper:
            raise SpaceError(
                f"at gives {c.name} = {value:g}, outside its bounds [{c.lower:g}, {c.upper:g}]; widen them or move it."
            )
    return np.array(
        [
            float(v if (given := (at or {}).get(c.name)) is None else given)
            for c, v in zip(space.coordinates, middle, strict=True)
        ]
    )


def _refuse_free(noise: Noise) -> None:
    for kind in ("process", "measurement"):
        for name, level in getattr(noise, kind).items():
            if isinstance(level, tuple):
                raise SpaceError(
                    f"The {kind} level of {name!r} is a range {level}; "
                    "give a number, for example from maximum_likelihood."
                )
