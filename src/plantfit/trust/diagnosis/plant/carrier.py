"""The fitted plant as a function of its inputs: predictions and exact derivatives at every sample, compiled once.

Additions before the plant change the recorded input, additions behind it the prediction; those inside it (friction,
initial values) are parameters of the compiled model whose effect is nothing at zero. So all additions together cost one
compilation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.extensions import KINDS, parameter_name, with_extensions
from plantfit.models.extensions.changes import WITH
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.trust.diagnosis.candidates import Changing, Inside, candidates
from plantfit.trust.diagnosis.meter import Meter
from plantfit.trust.diagnosis.plant.input_places import InputPlaces
from plantfit.trust.diagnosis.plant.sizes import Size, sizes_of

import jax.numpy as jnp

WIDE = 50.0  # bounds of an effect inside the plant, in sizes that would be seen at once
CREEP = 0.02  # of the spread of a velocity: where dry friction is whole
SLOWEST, FASTEST = (
    0.005,
    0.3,
)  # of the spread of a velocity: where a speed may be over which friction falls; beyond it would be dry friction
JITTER = 1e-9  # of an input's spread: every sample is then a jump, and late copies of all inputs have one shape

Inputs = Mapping[str, Mapping[str, np.ndarray]]  # recording -> input -> values (n,)


@dataclass(frozen=True)
class Rows:
    """One row for each sample of each output of each recording: where it stands, what was measured (scaled) and how
    it is used. So many parameters were `fitted` to rows that may be few, 0 where that hardly counts."""

    recording: np.ndarray
    output: np.ndarray
    sample: np.ndarray
    measured: np.ndarray
    fit: np.ndarray
    unseen: np.ndarray
    weight: np.ndarray
    fitted: int = 0

    def part(self, recording: str, output: str) -> np.ndarray:
        """Places of the rows of an output of a recording, in time."""
        return np.flatnonzero((self.recording == recording) & (self.output == output))


@dataclass(frozen=True)
class Carrier:
    """`at` gives predictions (m,) in scaled units with derivatives (m, d) by parameters; the first `own` of them are
    the problem's, in the unit cube, the rest effects inside the plant, in their units. `inside` maps (kind, state)
    to the places of its coordinates, `speeds` to that of a speed that is fitted beside it, with the spread of the
    state; `values` are what else comes with effects. `core` is the same without what changes with a signal, of which
    there are many: most of the work is done there. Of `thin` samples, filtered before the fit, one tells of noise.
    Rows that are `unordered` tell nothing by their neighbours."""

    problem: Problem
    given: Problem
    rows: Rows
    z: np.ndarray
    own: int
    inside: Mapping[tuple[str, str], tuple[int, ...]]
    speeds: Mapping[tuple[str, str], tuple[int, float]]
    values: Mapping[str, float]
    inputs: Inputs
    meter: Meter = field(default_factory=Meter)
    sharp: int = 1
    core: "Carrier | None" = None
    thin: int = 1
    unordered: bool = False

    @classmethod
    def of(
        cls,
        problem: Problem,
        z: np.ndarray,
        kinds: Mapping[str, tuple[str, ...]],
        meter: Meter | None = None,
        sharp: int = 1,
    ) -> "Carrier":
        """A carrier at the cube point z (d,) with these effects inside the plant: kind -> states; `meter` counts what
        it does.

        Dry friction is whole from a speed on that is `sharp` times less than usual, and steps are as many times finer.
        """
        sizes, meter, inside = sizes_of(problem, z), meter or Meter(), candidates(Inside)
        changing = {k for k, states in kinds.items() if states and isinstance(inside[k], Changing)}
        core = cls._made(problem, z, {k: v for k, v in kinds.items() if k not in changing}, sizes, meter, sharp)
        return replace(cls._made(problem, z, kinds, sizes, meter, sharp), core=core) if changing else core

    @classmethod
    def _made(
        cls,
        problem: Problem,
        z: np.ndarray,
        kinds: Mapping[str, tuple[str, ...]],
        sizes: Mapping[str, Size],
        meter: Meter,
        sharp: int,
    ) -> "Carrier":
        model = problem.model
        assert isinstance(model, Model)
        many = len(problem.experiments) > 1
        bounds = {k: {s: (-1.0, 1.0) for s in states} for k, states in kinds.items() if states}
        changes: dict[str, Parameter] = {n: replace(p, smooth=None) for n, p in problem.space.parameters.items()}
        had = {p.name for p in model.parameters}
        fixed: dict[str, float] = {}
        speeds: dict[tuple[str, str], float] = {}
        for kind, states in kinds.items():
            candidate = candidates(Inside)[kind]
            for s in states:
                own = sizes[s.split(WITH)[1] if isinstance(candidate, Changing) else s]
                # powers of two, and what is fixed in round numbers: what is compiled for one recording serves another
                # of the same plant
                size = candidate.size(own.deviation if isinstance(candidate, Changing) else own.spread, own.rate)
                wide = 2.0 ** np.ceil(np.log2(WIDE * size))
                bounds[kind][s] = (-wide, wide)
                changes[parameter_name(kind, s)] = Parameter(
                    (-wide, wide), per_recording=many and candidate.per_recording
                )
                own_parts = (
                    p for p in (KINDS[kind].beside if kind in KINDS else ()) if parameter_name(p, s) not in had
                )
                for part in own_parts:
                    if part == candidate.speed:
                        speeds[kind, s] = float(2.0 ** np.ceil(np.log2(own.spread)))
                        changes[parameter_name(part, s)] = Parameter(
                            (SLOWEST * speeds[kind, s], FASTEST * speeds[kind, s])
                        )
                    else:
                        fixed[parameter_name(part, s)] = (
                            rounded_to_series(CREEP / sharp * own.spread) if part == "creep" else own.reference
                        )
        changes |= {name: Parameter(value=value) for name, value in fixed.items()}
        inputs = {n: {u: _jittered(e.recording[u]) for u in model.inputs} for n, e in problem.experiments.items()}
        whole = {n: filled(e.recording, inputs[n], model.outputs) for n, e in problem.experiments.items()}
        simulator = problem.predictor.stepping()

        def build() -> Problem:
            experiments = {
                n: replace(e, recording=whole[n], fit=(-np.inf, np.inf), validate=None, skip=0.0)
                for n, e in problem.experiments.items()
            }
            return Problem(
                with_extensions(model, bounds) if bounds else model, experiments, changes, scales=problem.scales,
                stepper=simulator.stepper, substeps=sharp * simulator.substeps,
                hold={u: "linear" if u in simulator.interpolated else "previous" for u in model.inputs},
                name=problem.name,
            )  # fmt: skip

        if problem.mesh:
            made = build()
            made = made.with_mesh({n: m for n, m in problem.mesh.items() if n in made.experiments})
        else:
            key = "carrier", sharp, simulator.stepper, simulator.substeps, str(bounds), str(fixed), str(speeds)
            made = problem.once(key, build).with_recordings(whole).with_scales(problem.scales)
            if made.start_corrections != problem.start_corrections:  # those of another problem that compiled it
                made = made.with_starts(problem.start_corrections)
        order = [made.space.names.index(n) for n in problem.space.names]
        inside = {
            (kind, s): tuple(i for i, c in enumerate(made.space.coordinates) if c.parameter == parameter_name(kind, s))
            for kind, states in kinds.items()
            for s in states
        }
        beside = {
            (kind, s): (made.space.names.index(parameter_name(candidates(Inside)[kind].speed, s)), spread)
            for (kind, s), spread in speeds.items()
        }
        z = np.asarray(z, dtype=float)
        return cls(made, problem, rows_of(problem), z, len(order), inside, beside, fixed, inputs, meter, sharp)

    def charge(self, changes: bool) -> float:
        """Of one call of `at`, in evaluations of the cost."""
        if self.core is not None and not changes:
            return self.core.charge(False)
        return self.sharp * self.problem.jacobian_charge

    def with_starts(self, corrections: Mapping[str, Mapping[str, float]]) -> "Carrier":
        """The same whose states begin so far off first measured values, by recording and output, in its unit."""
        return replace(
            self,
            problem=self.problem.with_starts(corrections),
            given=self.given.with_starts(corrections),
            core=None if self.core is None else self.core.with_starts(corrections),
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Coordinates of the carrier: those of the problem in its order, then the effects inside."""
        return (*self.given.space.names, *(n for n in self.problem.space.names if n not in self.given.space.names))

    def at(
        self, x: np.ndarray, inputs: Inputs | None = None, changes: bool = True, slopes: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Predictions (m,) and derivatives (m, d) at x (d,): cube coordinates of the problem, then effects inside in
        their units.

        Without `changes` the derivatives by what changes with a signal are left zero, and their values are taken for
        zero. Without `slopes` there are no derivatives: (m, 0).
        """
        if self.core is not None and not changes:
            predicted, own_columns = self.core.at(x[self._of_core], inputs, slopes=slopes)
            if not slopes:
                return predicted, own_columns
            jacobian = np.zeros((len(predicted), len(x)))
            jacobian[:, self._of_core] = own_columns
            return predicted, jacobian
        self.meter.charge(self.charge(changes) if slopes else float(self.sharp))
        places, width, centre = self._columns
        own = np.arange(len(x)) < self.own
        cube = np.empty(len(x))
        cube[places] = np.where(own, x, 0.5 + (x - centre) / width)
        problem, numbers = self.problem, None
        if inputs is not None:
            jittered = {n: {u: _jittered(v) for u, v in changed.items()} for n, changed in inputs.items()}
            numbers = None if self._places is None else self._places.filled(jittered)
            if numbers is None:
                problem = problem.with_recordings(self._recordings(jittered))
        numbers = problem.arguments if numbers is None else numbers
        if not slopes:
            r = np.asarray(problem.compiled["residuals"](jnp.asarray(cube), numbers))
            return r + self._measured, np.zeros((len(r), 0))
        r, jacobian = problem.compiled["residuals_and_jacobian"](jnp.asarray(cube), numbers)
        return np.asarray(r) + self._measured, np.asarray(jacobian)[:, places] / width

    @cached_property
    def _columns(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of every coordinate its place among those of the compiled problem (d,), its width, 1 of the problem's own,
        and its centre."""
        space = self.problem.space
        places = np.array([space.names.index(n) for n in self.names])
        own = np.arange(len(places)) < self.own
        return (
            places,
            np.where(own, 1.0, (space.upper - space.lower)[places]),
            np.where(own, 0.0, 0.5 * (space.upper + space.lower)[places]),
        )

    @cached_property
    def _of_core(self) -> np.ndarray:
        """Where the coordinates of the core are among those here."""
        assert self.core is not None
        return np.array([self.names.index(n) for n in self.core.names])

    @cached_property
    def _places(self) -> InputPlaces | None:
        """Where inputs stand in what is compiled; None where they are not simply copied there."""
        return InputPlaces.of(
            self.problem, self.inputs, lambda inputs: self.problem.with_recordings(self._recordings(inputs)).arguments
        )

    @property
    def x(self) -> np.ndarray:
        """The answer (d,), all effects nothing."""
        x = np.r_[self.z, np.zeros(len(self.names) - self.own)]
        for place, spread in self.speeds.values():
            x[self.names.index(self.problem.space.names[place])] = spread
        return x

    @cached_property
    def _measured(self) -> np.ndarray:
        data = self.problem.data["measured"]
        return np.concatenate([data[n][o] / self.problem.scales[o] for n in data for o in self.problem.outputs])

    def _recordings(self, inputs: Inputs) -> dict[str, Recording]:
        made = {}
        for n, e in self.problem.experiments.items():
            changed = {u: Signal(v, e.recording.signals[u].unit) for u, v in inputs.get(n, {}).items()}
            made[n] = Recording(e.recording.t, {**e.recording.signals, **changed}, n)
        return made


def rows_of(problem: Problem, fitted: int = 0) -> Rows:
    """Rows in the order in which the problem writes residuals of whole records; `fitted` as in `Rows`."""
    found: dict[str, list[np.ndarray]] = {
        k: [] for k in ("recording", "output", "sample", "measured", "fit", "unseen", "weight")
    }
    for n, e in problem.experiments.items():
        for o in problem.outputs:
            y = e.recording[o]
            there = np.isfinite(y)
            found["recording"].append(np.full(len(y), n, dtype=object))
            found["output"].append(np.full(len(y), o, dtype=object))
            found["sample"].append(np.arange(len(y)))
            found["measured"].append(y / problem.scales[o])
            found["fit"].append(e.mask("fit") & there)
            found["unseen"].append(e.mask("validation") & there)
            found["weight"].append(
                np.full(len(y), 1.0 if problem.weights is None else np.sqrt(problem.weights.get(n, 1.0)))
            )
    return Rows(*(np.concatenate(v) for v in found.values()), fitted=fitted)


def filled(recording: Recording, inputs: Mapping[str, np.ndarray], outputs: Mapping[str, object]) -> Recording:
    """Missing samples of outputs as straight lines, so that every sample has a row, and inputs that jump at each
    sample."""
    signals = dict(recording.signals)
    for o in outputs:
        y = recording[o]
        good = np.isfinite(y)
        if not good.all():
            signals[o] = Signal(
                np.interp(recording.t, recording.t[good], y[good]) if good.any() else np.zeros(len(y)), signals[o].unit
            )
    for u, values in inputs.items():
        signals[u] = Signal(values, signals[u].unit)
    return Recording(recording.t, signals, recording.name)


def _jittered(u: np.ndarray) -> np.ndarray:
    size = float(np.std(u)) or max(float(np.max(np.abs(u), initial=0.0)), 1.0)
    return u + JITTER * size * (np.arange(len(u)) % 2)


def rounded_to_series(value: float) -> float:
    """The number of the series 1, 2, 5 that is nearest by its logarithm."""
    tens = 10.0 ** np.floor(np.log10(value))
    return float(f"{tens * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(np.log(value / tens / m))):.1g}")
