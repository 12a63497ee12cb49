"""Recordings, a model and a space as one pure function: from a point of the unit cube to residuals."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import RecordingError, SpaceError
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.models.parts.clock_shift import with_clock_shift
from plantfit.models.text.dimensions.said_later import check_said_later
from plantfit.native.kept_programs import Kept, described
from plantfit.problem.correlated.filtered_answer import FULL_NAMES, Filtered
from plantfit.problem.correlated.weighted_answer import Weighted
from plantfit.problem.evaluate.batched import BatchedRecords
from plantfit.problem.evaluate.evaluator import Evaluator
from plantfit.problem.evaluate.moving_and_steady import MovingAndSteady
from plantfit.problem.evaluate.record_by_record import RecordByRecord
from plantfit.problem.evaluate.smoothing import Smoothed, Smoothing
from plantfit.problem.evaluate.triangle import compressed, triangle
from plantfit.problem.measure.experiment import Experiment, experiments_of, in_units
from plantfit.problem.measure.fitted_parts import FittedParts
from plantfit.problem.measure.recorded_units import recorded_units
from plantfit.problem.measure.scale_source import GIVEN, ScaleSource
from plantfit.problem.parameters import space_of
from plantfit.problem.predictor import Predictor, predictor_of
from plantfit.problem.told import problem_text
from plantfit.recording.record import Recording
from plantfit.simulate.records.of_one_length import as_long_as_others
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.simulate.steps.vector import vectorise
from plantfit.space import Space

import jax
import jax.numpy as jnp

LEAST_SQUARES, GENERALISED = "least squares", "generalised least squares"
Estimator = Literal["least squares", "generalised least squares", "maximum likelihood", "ekf", "ukf"]
BY_FILTERS = ("maximum likelihood", "ekf", "ukf")
_OF_DATA = ("data", "arguments", "unsmoothed", "gradient_charge", "_description")  # made when first asked for
_OF_THIS = ("study_file", "weighted", "filtered", "not_weighted")  # of the problem as it is, and of no changed copy
_NOT_COMPILED = ("name", "differentiated", *_OF_THIS)
_PREPARED = ("parts",)  # made by `_prepare`


class StudyFile(NamedTuple):
    """The study file that a problem was read from: its wording, where it lies, and the errors of instruments and refits
    that it states.

    `solved`: by `plantfit.regress`, as its table [regression] says, and not by a search.
    """

    text: str
    path: Path
    errors: tuple[Any, ...] = ()
    draws: int | None = None
    solved: bool = False


class Problem:
    """What is to be explained, by what, and with which freedom.

    `recordings`: a Recording, an Experiment, or a mapping of names to either. `split` fits the
    first share of a single recording and keeps the rest unseen; `validate` names recordings that
    are only predicted. `parameters` change what the model declares. `scales` divide the residual
    of each output (in its unit); by default 1 for one output, its standard deviation for several, which `fit` replaces
    by what the residuals show. `scale_sources` tells for every output who chose its scale. The cost is the mean of the
    squared scaled residuals, so that its root is the RMSE: over all samples with `balance` "samples", else
    ("recordings") of the means of the recordings, so that long ones count as short ones.

    `initial_time` (s) lets the states of every recording begin before its first sample, under the inputs of `before`.
    `clock_shift` frees by how much later than recorded inputs act, name -> bounds (s), as parameters clock_shift_NAME.
    `hold` tells for each input how it goes on between samples, "previous" (default) or "linear".
    `stepper` and `substeps` as in `Simulator`; substeps None lets `fit` choose them.

    `standard_errors` "robust" allows for residuals that are correlated in time and of different sizes; "classical"
    takes them as independent and of one size, as textbooks on regression do. By default a model without time (no
    states, no delays) has classical ones, for its rows are not samples, unless rows have times (a column of time, or
    other than 0, 1, 2, ..) and correlated residuals; every other model has robust ones.

    `estimator` "generalised least squares" lets an answer be that of `weighted_least_squares`, which weighs samples by
    the correlation of their noise; "least squares" weighs them alike. By default errors that samples share
    (`shared_errors`) are weighed and nothing else. "maximum likelihood", "ekf" and "ukf" are for plants that wander,
    whose states noise moves (docs/kalman.md). `weighted` or `filtered` is such an answer of a final problem, None where
    there is none, and `not_weighted` says why, where it was asked for.

    `differentiated` are signals of a regression by least squares that a study file makes by differentiation, or that
    look like it: their errors stand in its columns. `study_file` is the file that a problem was read from, None for one
    that was written in Python and for every changed copy. A problem can be pickled if its model can. Raises
    RecordingError, UnitError, SpaceError, ModelError and SimulationError for what contradicts itself.
    """

    differentiated: tuple[str, ...] = ()
    study_file: StudyFile | None = None
    weighted: Weighted | None = None
    filtered: Filtered | None = None
    not_weighted: str = ""

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
        before: Mapping[str, float | str] | None = None,
        initial_time: float | None = None,
        clock_shift: Mapping[str, tuple[float, float]] | None = None,
        balance: Literal["samples", "recordings"] = "samples",
        stepper: str = "exponential",
        substeps: int | None = None,
        name: str = "fit",
        standard_errors: Literal["robust", "classical"] | None = None,
        estimator: Estimator | None = None,
    ):
        if clock_shift:
            if not isinstance(model, Model):
                raise SpaceError(
                    f"clock_shift is for models that are simulated, and {model.name!r} is a regression; leave it out."
                )
            model = with_clock_shift(model, clock_shift)
        if standard_errors not in (None, "robust", "classical"):
            raise SpaceError(f"standard_errors = {standard_errors!r}; give 'robust' or 'classical'.")
        if estimator not in (None, *(known := get_args(Estimator))):
            raise SpaceError(f"estimator = {estimator!r}; give {', '.join(map(repr, known[:-1]))} or {known[-1]!r}.")
        self.model, self.name, self.standard_errors, self.estimator = model, name, standard_errors, estimator
        self.substeps_chosen = substeps is not None
        self.predictor = predictor_of(model, stepper, substeps or 1, hold)
        self.holds_stated = frozenset(hold or {})
        self.begins = dict(before or {}), initial_time  # of every recording that does not say its own
        self.experiments = experiments_of(
            recordings, split, skip, validate, *self.begins, self.predictor.needs,
            model.inputs if isinstance(model, Model) else None
        )  # fmt: skip
        self.space = space_of(model.parameters, parameters, tuple(self.experiments))
        recorded = recorded_units(self.experiments, self.predictor.needs)
        # signals with their units; where the model has none, those of the recordings
        self.needs = {**self.predictor.needs, **recorded}
        if isinstance(model, Model):
            check_said_later(model, {n: p.unit for n, p in self.space.parameters.items()}, recorded)
        self._refuse_unfitted()
        self._refuse_unshared()
        # by recording, the times (s) beside samples at which steps end; see problem/accuracy/mesh.py
        self.mesh: Mapping[str, np.ndarray] = {}
        self._compiled: dict[Any, Any] = {}  # shared by all variants of this problem
        self._prepare()
        self.scales, self.scale_sources = self.parts.scales(scales)
        self.weights = self.parts.weights(balance)
        self.smoothing = Smoothing.of(
            self.space, {t.name: t for t in getattr(model, "tables", ())}, self.parts.spread(self.scales)
        )

    def _refuse_unfitted(self) -> None:
        """A recording that is only predicted cannot give values to parameters of its own."""
        own = [n for n, p in self.space.parameters.items() if p.per_recording and p.value is None and p.tied is None]
        unseen = [n for n, e in self.experiments.items() if not np.any(e.mask("fit"))]
        if own and unseen:
            raise SpaceError(
                f"Parameter {own[0]!r} is per_recording, but recording {unseen[0]!r} is not "
                "fitted at all, so nothing gives its value there; fit a short first part of that "
                "recording (fit = [start, stop], validate = [stop, end]) or share the parameter."
            )

    def _refuse_unshared(self) -> None:
        """Errors that samples of no output share would change nothing."""
        for name, e in self.experiments.items():
            if unknown := [o for o in e.shared_errors if o not in self.model.outputs]:
                raise RecordingError(
                    f"Recording {name!r}: shared_errors names {unknown[0]!r}, which is no output of the model; its "
                    f"outputs are {', '.join(self.model.outputs)}."
                )

    def _prepare(self) -> None:
        self.outputs = tuple(self.model.outputs)
        self.parts = FittedParts.of(self.predictor, self.experiments, self.outputs, self.longest_delays(), self.mesh)

    def longest_delays(self) -> dict[str, float]:
        """The largest value of every parameter that delays a state."""
        late = getattr(self.model, "state_delays", ())
        return {d.parameter: self.space.range(d.parameter)[1] for d in late}

    # -- variants ---------------------------------------------------------------------------------

    def _variant(self, **changes: Any) -> "Problem":
        """A copy with other attributes, made of nothing that depends on them; compiled functions are kept."""
        other = object.__new__(type(self))
        other.__dict__.update({k: v for k, v in self.__dict__.items() if k not in (*_OF_DATA, *_OF_THIS)} | changes)
        return other

    def __repr__(self) -> str:
        return problem_text(self)

    def __getstate__(self) -> dict[str, Any]:
        kept = {k: v for k, v in self.__dict__.items() if k not in (*_OF_DATA, *_PREPARED, "predictor", "_compiled")}
        simulator = self.predictor.simulator
        steps = None if simulator is None else (simulator.stepper, simulator.substeps, simulator.interpolated)
        return {**kept, "steps": steps}

    def __setstate__(self, state: dict[str, Any]) -> None:
        steps = state.pop("steps")
        self.__dict__.update(state, _compiled={})
        model = self.model
        self.predictor = Predictor(model, Simulator(vectorise(model), *steps) if isinstance(model, Model) else None)
        self._prepare()

    def with_scales(self, scales: Mapping[str, float], source: ScaleSource = GIVEN) -> "Problem":
        """The same problem with other scales of some outputs (in their units), chosen by `source`; compiled
        functions are kept."""
        sources = {**self.scale_sources, **dict.fromkeys(scales, source)}
        return self._variant(scales={**self.scales, **scales}, scale_sources=sources)

    def with_smoothing(self, strengths: Mapping[tuple[str, str], float]) -> "Problem":
        """The same problem with other strengths of its smoothing, by parameter and signal (see
        `Smoothing.strengths`)."""
        if self.smoothing is None or not set(strengths) <= set(self.smoothing.keys):
            known = [] if self.smoothing is None else list(self.smoothing.keys)
            raise SpaceError(
                f"with_smoothing names {list(strengths)}, but smoothed are {known}; give those parameters smooth first."
            )
        return self._variant(smoothing=self.smoothing.with_strengths(strengths))

    def freed(self, bounds: Mapping[str, tuple[float, float]]) -> "Problem":
        """The same problem with parameters between bounds that it holds at a value; scales, weights, steps and
        smoothing stay."""
        freed = {
            n: replace(self.space.parameters[n], value=None, bounds=b, scale="linear", start=None, limits=None)
            for n, b in bounds.items()
        }
        space = Space(
            {**self.space.parameters, **{n: replace(p, per_recording=False) for n, p in freed.items()}},
            self.space.recordings,
        )
        other = self._variant(space=space, _compiled={})
        other._prepare()
        if self.smoothing is not None:
            tables = {t.name: t for t in getattr(self.model, "tables", ())}
            fresh = Smoothing.of(space, tables, self.parts.spread(self.scales))
            other.smoothing = None if fresh is None else fresh.with_strengths(self.smoothing.strengths)
        return other

    @property
    def in_time(self) -> bool:
        """Whether rows are samples one after another: models with states or delays, and regressions on recorded
        signals."""
        model = self.model
        return not isinstance(model, Model) or bool(model.states or model.delays or model.state_delays)

    @property
    def robust(self) -> bool:
        """Whether standard errors allow for residuals that are correlated in time, as asked or by the model alone
        (`standard_errors`)."""
        return self.in_time if self.standard_errors is None else self.standard_errors == "robust"

    @property
    def generalised(self) -> bool:
        """Whether its answer is that of generalised least squares, where there is one (`estimator`)."""
        if self.estimator is None:
            return any(e.shared_errors and np.any(e.mask("fit")) for e in self.experiments.values())
        return self.estimator == GENERALISED

    @property
    def by_filters(self) -> bool:
        """Whether its answer is that of maximum likelihood or of a Kalman filter, where there is one (`estimator`)."""
        return self.estimator in BY_FILTERS

    @property
    def own_estimate(self) -> Weighted | Filtered | None:
        """The answer of a final problem by another estimator than least squares."""
        return self.filtered if self.weighted is None else self.weighted

    @property
    def answered_by(self) -> str:
        """The estimator whose answer it has, in words."""
        if self.filtered is not None:
            return FULL_NAMES.get(str(self.estimator), str(self.estimator))
        return LEAST_SQUARES if self.weighted is None else GENERALISED

    def with_answer(self, weighted: Weighted | None, why_not: str = "") -> "Problem":
        """The same problem with the answer of generalised least squares, or with a sentence why it has none but that
        of least squares."""
        return self._variant(weighted=weighted, not_weighted=why_not, study_file=self.study_file)

    def with_filtered(self, filtered: Filtered) -> "Problem":
        """The same problem with the answer of maximum likelihood or of a Kalman filter."""
        return self._variant(filtered=filtered, study_file=self.study_file)

    @cached_property
    def unsmoothed(self) -> "Problem":
        """The same problem as the data alone put it; itself without smoothing."""
        return self if self.smoothing is None else self._variant(smoothing=None)

    def with_simulator(self, simulator: Simulator) -> "Problem":
        """The same problem simulated with other steps."""
        other = self._variant(predictor=self.predictor.with_simulator(simulator))
        if simulator.vector.model.state_delays:
            other._prepare()  # how much history is kept depends on the steps
        return other

    def with_mesh(self, mesh: Mapping[str, np.ndarray]) -> "Problem":
        """The same problem with steps that also end at these times (s), by recording; in place of those it had."""
        other = self._variant(mesh=dict(mesh), _compiled={})
        other._prepare()
        return other

    def with_recordings(self, recordings: Mapping[str, Recording]) -> "Problem":
        """The same problem on other recordings of the same lengths, one for each name; parts, scales and weights stay.

        Compiled functions are kept where the new records have the samples of the old, so that a hundred fits compile
        once.
        """
        if set(recordings) != set(self.experiments):
            raise RecordingError(
                f"with_recordings got {sorted(recordings)}; give one for each of {list(self.experiments)}."
            )
        return self._with_numbers({n: e.on(in_units(recordings[n], self.needs)) for n, e in self.experiments.items()})

    def with_starts(self, corrections: Mapping[str, Mapping[str, float]]) -> "Problem":
        """The same problem with other `Experiment.start_corrections`, by recording and output; none of recordings
        that are left out."""
        return self._with_numbers(
            {n: replace(e, start_corrections=corrections.get(n, {})) for n, e in self.experiments.items()}
        )

    @property
    def start_corrections(self) -> dict[str, dict[str, float]]:
        """By recording and output what is added to first measured values, of recordings that have such."""
        return {n: dict(e.start_corrections) for n, e in self.experiments.items() if e.start_corrections}

    def _with_numbers(self, experiments: Mapping[str, Experiment]) -> "Problem":
        other = self._variant(experiments=dict(experiments), _compiled={})
        other._prepare()
        self.compiled  # noqa: B018  made now, so that whatever is compiled later serves both
        kept = dict(self._compiled)
        if "batched" in kept:
            other.evaluator_of_data  # noqa: B018  makes the batch of the new records
            fresh = other._compiled["batched"]
            kept = {**kept, "batched": fresh} if kept["batched"].serves(fresh) else {"batched": fresh}
        other._compiled = kept
        return other

    # -- pure functions ---------------------------------------------------------------------------

    @cached_property
    def data(self) -> dict[str, Any]:
        """What was recorded, of the fitted parts: drives, places and values of the scored samples, scales."""
        parts = self.parts
        found = {
            "drive": dict(parts.drives),
            "index": {n: {o: parts.index[n, o] for o in self.outputs} for n in parts.drives},
            "measured": {n: {o: parts.measured[n, o] for o in self.outputs} for n in parts.drives},
            "scale": {o: np.asarray(self.scales[o]) for o in self.outputs},
        }
        if self.weights is not None:
            found["weight"] = {n: np.asarray(w) for n, w in self.weights.items()}
        if isinstance(self.model, LinearModel):
            found["triangles"] = parts.triangles()
        return found

    @cached_property
    def arguments(self) -> Any:
        """What the compiled functions take beside z; a pytree."""
        return self.evaluator.arguments(self.data)

    @property
    def steps_a_sample(self) -> int | float:
        """Steps between two samples; with a mesh their mean over the fitted parts."""
        substeps = 0 if self.predictor.simulator is None else self.predictor.simulator.substeps
        moving = [d for d in self.parts.drives.values() if isinstance(d, Drive)]
        if not self.mesh or not moving:
            return substeps
        samples = sum(len(d.t) if d.samples is None else len(d.samples) for d in moving)
        return round(substeps * sum(len(d.t) for d in moving) / samples, 2)

    @property
    def whole_drives(self) -> dict[str, Drive]:
        """The numbers of whole recordings that move, fitted or not."""
        return {n: d for n, d in self.parts.whole.items() if isinstance(d, Drive)}

    @property
    def evaluator(self) -> Evaluator:
        """The pure functions that a search sees."""
        of_data = self.evaluator_of_data
        return of_data if self.smoothing is None else Smoothed(of_data, self.smoothing, sum(self.parts.counts.values()))

    @property
    def evaluator_of_data(self) -> Evaluator:
        """The pure functions without smoothing; records are cut into chunks only once."""
        one_by_one = RecordByRecord(self.predictor, self.space, self.outputs, tuple(self.parts.drives))
        moving = {n: d for n, d in self.parts.drives.items() if isinstance(d, Drive)}
        if not self.predictor.has_steps or not moving or getattr(self.model, "state_delays", ()):
            return one_by_one
        simulator = self.predictor.stepping()
        if "batched" not in self._compiled:
            self._compiled["batched"] = BatchedRecords.of(
                simulator, self.space, moving, self.parts.index, self.parts.measured
            )
        batched = self._compiled["batched"].with_simulator(simulator)
        if len(moving) == len(self.parts.drives):
            return batched
        return MovingAndSteady(batched, one_by_one, self.parts.counts)

    def residuals(self, z: Any) -> jax.Array:
        """Scaled residuals (m,), simulated minus measured, at a cube point (d,); recording by recording, output by
        output."""
        data = self.unsmoothed
        return data.compiled["residuals"](_given(z), data.arguments)

    def cost(self, z: Any) -> jax.Array:
        """Mean of the squared scaled residuals at a cube point (d,), and what smoothing adds (`smoothing`, eq. 1)."""
        return self.costs(jnp.asarray(z)[None, :])[0]

    # -- compiled ---------------------------------------------------------------------------------

    @property
    def compiled(self) -> dict[str, Any]:
        """Compiled functions of (z, arguments), by name; one set for each choice of steps."""
        simulator = self.predictor.simulator
        key = self.smoothing is None, None if simulator is None else (simulator.stepper, simulator.substeps)
        if key not in self._compiled:
            functions = self.evaluator
            names = ("residuals", "costs", "values_and_gradients", "residuals_and_jacobian", "blocks")
            given = {n: getattr(functions, n) for n in names}
            given["costs"] = partial(_or_infinite, functions.costs)
            given |= {"outputs": self.predictor.outputs, "trajectories": self.predictor.trajectories}
            described_by = self._compiled_in(functions)
            self._compiled[key] = {n: Kept(f, n, described_by) for n, f in given.items()}
        return self._compiled[key]

    def _compiled_in(self, functions: Evaluator) -> bytes | None:
        """A digest of all that the programs of these functions depend on; None where it cannot be told. Recorded
        numbers are arguments."""
        simulator = self.predictor.simulator
        steps = None if simulator is None else (simulator.stepper, simulator.substeps, simulator.interpolated)
        parameters = {n: replace(p, start=None, sentence="", typical=None) for n, p in self.space.parameters.items()}
        return described((self.model, steps, parameters, self.space.recordings, self.outputs, functions.compiled_in))

    @cached_property
    def _description(self) -> bytes | None:
        """A digest of the whole problem, recorded numbers too; None where it cannot be told."""
        return described({k: v for k, v in self.__getstate__().items() if k not in _NOT_COMPILED})

    def kept(self, function: Callable, name: str, thing: Any) -> Kept:
        """A pure function of arrays that calls `costs`, compiled; found again by the next process where `thing`
        describes its rest."""
        return Kept(function, name, None if self._description is None else described((self._description, thing)))

    def costs(self, zs: Any) -> jax.Array:
        """Costs (n,) of cube points (n, d); +inf where a candidate cannot be simulated."""
        return self.compiled["costs"](_given(zs), self.arguments)

    def values_and_gradients(self, zs: Any) -> tuple[jax.Array, jax.Array]:
        """Costs (n,) and their exact gradients (n, d) at cube points (n, d)."""
        return self.compiled["values_and_gradients"](_given(zs), self.arguments)

    def value_and_gradient(self, z: Any) -> tuple[float, np.ndarray]:
        """Cost and its exact gradient (d,) at a cube point."""
        f, g = self.values_and_gradients(np.asarray(z, dtype=float)[None, :])
        return float(np.asarray(f)[0]), np.asarray(g)[0]  # an entry of jax's array takes ten times as long

    def residuals_and_jacobian(self, z: Any) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (m,) and their exact derivatives by the cube coordinates (m, d); rows of smoothing, if any, at
        their end."""
        r, jacobian = self.compiled["residuals_and_jacobian"](_given(z), self.arguments)
        return np.asarray(r), np.asarray(jacobian)

    def compressed(self, z: Any) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (k,) and derivatives (k, d) in few rows: same mean square, gradient and Gauss-Newton matrix as
        the whole ones."""
        return compressed(self.blocks(z), self.space.dimension)

    def blocks(self, z: Any) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Residuals (m,), derivatives (m, q) and the q coordinates that they are by, of parts that have coordinates of
        their own.

        The cost is the mean of the squares of all of them; of a regression they are few, as in `compressed`.
        """
        blocks = self.compiled["blocks"](_given(z), self.arguments)
        return [
            (np.asarray(r), np.asarray(j), np.asarray(own))
            for (r, j), own in zip(blocks, self.evaluator.local, strict=True)
        ]

    def once(self, key: Any, make: Callable[[], Any]) -> Any:
        """What `make` gives, made once for this problem and its variants of other scales, steps and strengths of
        smoothing."""
        if key not in self._compiled:
            self._compiled[key] = make()
        return self._compiled[key]

    @property
    def separable(self) -> tuple[np.ndarray, ...] | None:
        """Coordinates of every recording when no two share any, so that each is a problem of its own; else None."""
        groups = [np.asarray(own) for own in self.evaluator.local]
        count = sum(map(len, groups))
        return (
            tuple(groups)
            if len(groups) > 1 and count == len(set(np.concatenate(groups))) == self.space.dimension
            else None
        )

    @property
    def block_places(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """For every block of compiled["blocks"] without smoothing its coordinates (q,), and its rows' places (k,)
        among `residuals`."""
        counts = self.parts.counts
        begin = dict(zip(counts, np.cumsum([0, *counts.values()])[:-1], strict=True))
        evaluator = self.evaluator_of_data
        places = [np.concatenate([begin[n] + np.arange(counts[n]) for n in names]) for names in evaluator.recordings]
        return [(np.asarray(own), place) for own, place in zip(evaluator.local, places, strict=True)]

    def separable_blocks(self, z: Any, wanted: np.ndarray | None = None) -> list[tuple[np.ndarray, np.ndarray]]:
        """Residuals (k,) and derivatives (k, q) of every recording in few rows; the cost is the sum of their squares.

        Of recordings that are not `wanted` (recordings,) there are no rows.
        """
        wanted = np.ones(len(self.evaluator.local), bool) if wanted is None else wanted
        blocks = self.compiled["blocks"](_given(z), self.evaluator.only(self.arguments, wanted))
        count = sum(r.shape[0] for r, _ in blocks)
        ends = [None if w else 0 for w in wanted]
        small = (
            triangle(np.asarray(j)[:end], np.asarray(r)[:end]) / np.sqrt(count)
            for (r, j), end in zip(blocks, ends, strict=True)
        )
        return [(a[:, -1], a[:, :-1]) for a in small]

    @cached_property
    def gradient_charge(self) -> float:
        """Evaluations that one gradient is charged."""
        return 3.0

    @property
    def jacobian_charge(self) -> float:
        """Evaluations that one Jacobian is charged: 1 + q/2, rounded up.

        q counts the coordinates of one recording: those of others do not enter its residuals. Alone it costs less (2.7
        evaluations for q = 12, 7 for 31 by benchmarks/engine.py and benchmarks/steam), one of a batch, whose
        evaluations share lanes, more.
        """
        return float(1 + (self.evaluator.local_dimension + 1) // 2)

    # -- at an answer -----------------------------------------------------------------------------

    def predict(self, values: Any, name: str | None = None) -> dict[str, np.ndarray]:
        """Every output (n,), in its unit, over a whole recording (by default the first), fitted or not, at values (d,)
        in their units.

        Raises RecordingError for a name that is none of the recordings.
        """
        name = name or next(iter(self.experiments))
        if name not in self.experiments:
            raise RecordingError(f"There is no recording {name!r}; there are {list(self.experiments)}.")
        return self.outputs_over(name, self.space.tree(np.asarray(values), name))

    def outputs_over(self, name: str, p: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Every output (n,) over the whole recording `name` at named parameter values, as `Space.tree` gives them."""
        drive = self.parts.whole[name]
        if not isinstance(drive, Drive):
            return {k: np.asarray(v) for k, v in self.compiled["outputs"](p, drive).items()}
        lengthened = as_long_as_others(drive, self.whole_drives.values())
        count = len(drive.t) if drive.samples is None else len(drive.samples)
        return {k: np.asarray(v)[:count] for k, v in self.compiled["outputs"](p, lengthened).items()}


def _or_infinite(costs: Callable[[Any, Any], Any], zs: Any, arguments: Any) -> Any:
    """Costs (n,), +inf where a candidate cannot be simulated."""
    f = costs(zs, arguments)
    return jnp.where(jnp.isfinite(f), f, jnp.inf)


def _given(z: Any) -> Any:
    """Cube points as compiled functions take them: arrays of floats as they are, which a call of its own would only
    wrap."""
    return z if isinstance(z, np.ndarray) and z.dtype == np.float64 else jnp.asarray(z)
