"""Recordings, a model and a space as one pure function: from a point of the unit cube to residuals."""

import copy
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import RecordingError, SpaceError
from plantfit.models.model import Model
from plantfit.models.regression import LinearModel
from plantfit.problem.experiment import Experiment, in_units
from plantfit.problem.experiment import split as split_recording
from plantfit.problem.parameters import space_of
from plantfit.problem.predictor import predictor_of
from plantfit.recording.record import Recording
from plantfit.simulate.simulator import Simulator

import jax
import jax.numpy as jnp

MEMORY = 1 << 30  # bytes that one batch of candidates may take


class Problem:
    """What is to be explained, by what, and with which freedom.

    `recordings`: a Recording, an Experiment, or a mapping of names to either. `split` fits the
    first share of a single recording and keeps the rest unseen; `validate` names recordings that
    are only predicted. `parameters` change what the model declares. `scales` divide the residual
    of each output (in its unit); by default 1 for one output, its standard deviation for several.
    The cost is the mean of the squared scaled residuals, so that its root is the RMSE.

    `hold` tells for each input how it goes on between samples, "previous" (default) or "linear".
    `stepper` and `substeps` as in `Simulator`; substeps None lets `fit` choose them.
    """

    def __init__(
        self,
        model: Model | LinearModel,
        recordings: Any,
        parameters: Mapping[str, Any] | None = None,
        *,
        split: float | None = None,
        skip: float = 0.0,
        validate: Sequence[str] = (),
        scales: Mapping[str, float] | None = None,
        hold: Mapping[str, str] | None = None,
        before: Mapping[str, float] | None = None,
        stepper: str = "rosenbrock",
        substeps: int | None = None,
        name: str = "fit",
    ):
        self.model, self.name = model, name
        self.substeps_chosen = substeps is not None
        self.predictor = predictor_of(model, stepper, substeps or 1, hold)
        self.experiments = _experiments(recordings, split, skip, validate, before or {}, self.predictor.needs)
        self.space = space_of(model.parameters, parameters, tuple(self.experiments))
        self._refuse_unfitted()
        self._compiled: dict[Any, dict[str, Any]] = {}  # shared by all variants of this problem
        self._prepare()
        self.scales = self._scales(scales)

    def _refuse_unfitted(self) -> None:
        """A recording that is only predicted cannot give values to parameters of its own."""
        own = [n for n, p in self.space.parameters.items() if p.per_recording and p.value is None and p.tied is None]
        unseen = [n for n, e in self.experiments.items() if not np.any(e.mask("fit"))]
        if own and unseen:
            raise SpaceError(
                f"Parameter {own[0]!r} is per_recording, but recording {unseen[0]!r} is not fitted at all, "
                "so nothing gives its value there; "
                "fit a short first part of that recording (fit = [start, stop], validate = [stop, end]) or share the parameter."
            )

    def _prepare(self) -> None:
        self.outputs = tuple(self.model.outputs)
        self._full = {n: self.predictor.drive(e) for n, e in self.experiments.items()}
        self._index, self._measured, self._fit_drive = {}, {}, {}
        for name, experiment in self.experiments.items():
            mask = experiment.mask("fit")
            if not np.any(mask):
                continue
            self._fit_drive[name] = self.predictor.drive(experiment, stop=int(np.flatnonzero(mask)[-1]) + 1)
            for output in self.outputs:
                y = experiment.recording[output]
                index = np.flatnonzero(mask & np.isfinite(y))
                self._index[name, output], self._measured[name, output] = index, y[index]
        if sum(map(len, self._measured.values())) == 0:
            raise RecordingError("No measured sample is left to fit; check the fit interval and the missing values of the outputs.")
        for output in self.outputs:
            if not any(len(y) for (_, o), y in self._measured.items() if o == output):
                raise RecordingError(
                    f"Output {output!r} has no measured sample inside the fitted part; remove it from the model or widen the part."
                )

    def _scales(self, given: Mapping[str, float] | None) -> dict[str, float]:
        result = {}
        for output in self.outputs:
            y = np.concatenate([v for (_, o), v in self._measured.items() if o == output])
            result[output] = 1.0 if len(self.outputs) == 1 else max(float(np.std(y)), 1e-12)
        for output, scale in (given or {}).items():
            if output not in result:
                raise SpaceError(f"scales names {output!r}, which is not one of the outputs {list(self.outputs)}.")
            if not (np.isfinite(scale) and scale > 0):
                raise SpaceError(f"The scale of output {output!r} is {scale}; give a positive number in its unit.")
            result[output] = float(scale)
        return result

    # -- variants ---------------------------------------------------------------------------------

    def with_scales(self, scales: Mapping[str, float]) -> "Problem":
        """The same problem with other scales of the outputs; compiled functions are kept."""
        other = copy.copy(self)
        other.__dict__.pop("data", None)
        other.scales = {**self.scales, **scales}
        return other

    def with_simulator(self, simulator: Simulator) -> "Problem":
        """The same problem simulated with other steps."""
        other = copy.copy(self)
        other.__dict__.pop("data", None)
        other.predictor = self.predictor.with_simulator(simulator)
        return other

    # -- pure functions ---------------------------------------------------------------------------

    @cached_property
    def data(self) -> dict[str, Any]:
        """All numbers that the residuals need, passed to compiled functions rather than built in."""
        keys = list(self._fit_drive)
        return {
            "drive": {n: self._fit_drive[n] for n in keys},
            "index": {n: {o: self._index[n, o] for o in self.outputs} for n in keys},
            "measured": {n: {o: self._measured[n, o] for o in self.outputs} for n in keys},
            "scale": {o: np.asarray(self.scales[o]) for o in self.outputs},
        }

    def residuals(self, z: Any, data: Any = None) -> jax.Array:
        """Scaled residuals (m,), simulated minus measured, at a cube point (d,); recording by recording, output by output."""
        data = self.data if data is None else data
        values = self.space.physical(z)
        parts = []
        for name, drive in data["drive"].items():
            y = self.predictor.outputs(self.space.tree(values, name), drive)
            for output in self.outputs:
                picked = jnp.take(y[output], data["index"][name][output])
                parts.append((picked - data["measured"][name][output]) / data["scale"][output])
        return jnp.concatenate(parts)

    def cost(self, z: Any, data: Any = None) -> jax.Array:
        """Mean of the squared scaled residuals at a cube point (d,)."""
        return jnp.mean(self.residuals(z, data) ** 2)

    # -- compiled ---------------------------------------------------------------------------------

    @property
    def compiled(self) -> dict[str, Any]:
        """Compiled functions of (z, data), by name; one set for each choice of steps."""
        simulator = self.predictor.simulator
        key = None if simulator is None else (simulator.stepper, simulator.substeps)
        if key not in self._compiled:
            self._compiled[key] = self._compile()
        return self._compiled[key]

    def _compile(self) -> dict[str, Any]:
        def residuals_and_jacobian(z, data):
            def once(z):
                r = self.residuals(z, data)
                return r, r

            jacobian, r = jax.jacfwd(once, has_aux=True)(z)
            return r, jacobian

        def costs(zs, data):
            row_bytes = 8 * 8 * sum(x.size for x in jax.tree.leaves(data["drive"])) * max(1, self.predictor.rows)
            return jax.lax.map(lambda z: self.cost(z, data), zs, batch_size=max(1, min(zs.shape[0], MEMORY // row_bytes)))

        return {
            "residuals": jax.jit(self.residuals),
            "costs": jax.jit(costs),
            "value_and_gradient": jax.jit(jax.value_and_grad(self.cost)),
            "residuals_and_jacobian": jax.jit(residuals_and_jacobian),
            "outputs": jax.jit(lambda p, drive: self.predictor.outputs(p, drive)),
        }

    def costs(self, zs: Any) -> jax.Array:
        """Costs (n,) of cube points (n, d); +inf where a candidate cannot be simulated."""
        f = self.compiled["costs"](jnp.asarray(zs), self.data)
        return jnp.where(jnp.isfinite(f), f, jnp.inf)

    def residuals_and_jacobian(self, z: Any) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (m,) and their exact derivatives by the cube coordinates (m, d)."""
        r, jacobian = self.compiled["residuals_and_jacobian"](jnp.asarray(z), self.data)
        return np.asarray(r), np.asarray(jacobian)

    def value_and_gradient(self, z: Any) -> tuple[float, np.ndarray]:
        """Cost and its exact gradient (d,) at a cube point."""
        f, g = self.compiled["value_and_gradient"](jnp.asarray(z), self.data)
        return float(f), np.asarray(g)

    @cached_property
    def gradient_charge(self) -> float:
        return 3.0

    @property
    def jacobian_charge(self) -> float:
        """Evaluations that one Jacobian is charged; measured in benchmarks/engine.py (1 + d/2, rounded up)."""
        return float(1 + (self.space.dimension + 1) // 2)

    # -- at an answer -----------------------------------------------------------------------------

    def predict(self, values: Any, name: str | None = None) -> dict[str, np.ndarray]:
        """Every output over a whole recording, fitted or not, at parameter values (d,) in their units."""
        name = name or next(iter(self.experiments))
        if name not in self.experiments:
            raise RecordingError(f"There is no recording {name!r}; there are {list(self.experiments)}.")
        p = self.space.tree(jnp.asarray(values), name)
        return {k: np.asarray(v) for k, v in self.compiled["outputs"](p, self._full[name]).items()}


def _experiments(recordings, split, skip, validate, before, needs) -> dict[str, Experiment]:
    if isinstance(recordings, Recording | Experiment):
        inner = recordings.recording if isinstance(recordings, Experiment) else recordings
        recordings = {inner.name: recordings}
    if not recordings:
        raise RecordingError("A problem needs at least one recording.")
    if split is not None and len(recordings) > 1:
        raise RecordingError("split works on one recording; with several, name the unseen ones under validate.")
    unknown = [v for v in validate if v not in recordings]
    if unknown:
        raise RecordingError(f"validate names {unknown[0]!r}, which is not one of the recordings {list(recordings)}.")
    result = {}
    for name, given in recordings.items():
        if isinstance(given, Recording):
            every = (-np.inf, np.inf)
            given = (
                split_recording(given, split, skip)
                if split is not None
                else Experiment(given, fit=None if name in validate else every, validate=every if name in validate else None, skip=skip)
            )
        history = {**{k: v for k, v in before.items()}, **given.before}
        result[name] = Experiment(in_units(given.recording, needs), given.fit, given.validate, given.skip, history)
    return result
