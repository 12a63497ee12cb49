"""The fitted plant as a function of its inputs: predictions and exact derivatives at every sample, compiled once.

Additions before the plant change the recorded input, additions behind it the prediction; those inside it (friction, initial values) are
parameters of the compiled model whose effect is nothing at zero. So all additions together cost one compilation.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.models.extensions import parameter_name, with_extensions
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.simulator import Drive
from plantfit.space import Parameter
from plantfit.trust.diagnosis.candidates import Inside, candidates
from plantfit.trust.diagnosis.meter import Meter
from plantfit.trust.diagnosis.plant.input_places import InputPlaces

import jax.numpy as jnp

WIDE = 50.0  # bounds of an effect inside the plant, in sizes that would be seen at once
CREEP = 0.02  # of the spread of a velocity: where dry friction is whole
JITTER = 1e-9  # of an input's spread: every sample is then a jump, and late copies of all inputs have one shape

Inputs = Mapping[str, Mapping[str, np.ndarray]]  # recording -> input -> values (n,)


@dataclass(frozen=True)
class Rows:
    """One row for each sample of each output of each recording: where it stands, what was measured (scaled) and how it is used."""

    recording: np.ndarray
    output: np.ndarray
    sample: np.ndarray
    measured: np.ndarray
    fit: np.ndarray
    unseen: np.ndarray
    weight: np.ndarray

    def part(self, recording: str, output: str) -> np.ndarray:
        """Places of the rows of an output of a recording, in time."""
        return np.flatnonzero((self.recording == recording) & (self.output == output))


@dataclass(frozen=True)
class Carrier:
    """`at` gives predictions (m,) in scaled units with derivatives (m, d) by parameters; the first `own` of them are the problem's, in
    the unit cube, the rest effects inside the plant, in their units. `inside` maps (kind, state) to the places of its coordinates."""

    problem: Problem
    given: Problem
    rows: Rows
    z: np.ndarray
    own: int
    inside: Mapping[tuple[str, str], tuple[int, ...]]
    creeps: Mapping[str, float]
    inputs: Inputs
    meter: Meter = field(default_factory=Meter)
    sharp: int = 1

    @classmethod
    def of(
        cls, problem: Problem, z: np.ndarray, kinds: Mapping[str, tuple[str, ...]], meter: Meter | None = None, sharp: int = 1
    ) -> "Carrier":
        """A carrier at the cube point z (d,) with these effects inside the plant: kind -> states; `meter` counts what it does.

        Dry friction is whole from a speed on that is `sharp` times less than usual, and steps are as many times finer.
        """
        model = problem.model
        assert isinstance(model, Model)
        sizes = _sizes(problem, z)
        many = len(problem.experiments) > 1
        bounds = {k: {s: (-1.0, 1.0) for s in states} for k, states in kinds.items() if states}
        changes: dict[str, Parameter] = dict(problem.space.parameters)
        creeps, inside_the_plant = {}, candidates(Inside)
        for kind, states in kinds.items():
            for s in states:
                spread, rate = sizes[s]
                # powers of two, and creep in round numbers: what is compiled for one recording serves another of the same plant
                wide = 2.0 ** np.ceil(np.log2(WIDE * inside_the_plant[kind].size(spread, rate)))
                bounds[kind][s] = (-wide, wide)
                changes[parameter_name(kind, s)] = Parameter((-wide, wide), per_recording=many and inside_the_plant[kind].per_recording)
                if kind == "coulomb":
                    creeps[s] = _round(CREEP / sharp * spread)
                    changes[f"creep_{s}"] = Parameter(value=creeps[s])
        inputs = {n: {u: _jittered(e.recording[u]) for u in model.inputs} for n, e in problem.experiments.items()}
        filled = {n: _filled(e.recording, inputs[n], model.outputs) for n, e in problem.experiments.items()}
        simulator = problem.predictor.stepping()

        def build() -> Problem:
            experiments = {
                n: replace(e, recording=filled[n], fit=(-np.inf, np.inf), validate=None, skip=0.0) for n, e in problem.experiments.items()
            }
            return Problem(
                with_extensions(model, bounds) if bounds else model, experiments, changes, scales=problem.scales,
                stepper=simulator.stepper, substeps=sharp * simulator.substeps,
                hold={u: "linear" if u in simulator.interpolated else "previous" for u in model.inputs}, name=problem.name,
            )  # fmt: skip

        if problem.mesh:
            made = build()
            made = made.with_mesh({n: m for n, m in problem.mesh.items() if n in made.experiments})
        else:
            key = "carrier", sharp, simulator.stepper, simulator.substeps, str(bounds), str(creeps)
            made = problem.once(key, build).with_recordings(filled).with_scales(problem.scales)
        order = [made.space.names.index(n) for n in problem.space.names]
        inside = {
            (kind, s): tuple(i for i, c in enumerate(made.space.coordinates) if c.parameter == parameter_name(kind, s))
            for kind, states in kinds.items()
            for s in states
        }
        z = np.asarray(z, dtype=float)
        return cls(made, problem, rows_of(problem), z, len(order), inside, creeps, inputs, meter or Meter(), sharp)

    @property
    def charge(self) -> float:
        """Of one call of `at`, in evaluations of the cost."""
        return self.sharp * self.problem.jacobian_charge

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Coordinates of the carrier: those of the problem in its order, then the effects inside."""
        return (*self.given.space.names, *(n for n in self.problem.space.names if n not in self.given.space.names))

    def at(self, x: np.ndarray, inputs: Inputs | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Predictions (m,) and derivatives (m, d) at x (d,): cube coordinates of the problem, then effects inside in their units."""
        self.meter.charge(self.charge)
        places, width = self._columns
        own = np.arange(len(x)) < self.own
        cube = np.empty(len(x))
        cube[places] = np.where(own, x, 0.5 + x / width)
        problem, numbers = self.problem, None
        if inputs is not None:
            jittered = {n: {u: _jittered(v) for u, v in changed.items()} for n, changed in inputs.items()}
            numbers = None if self._places is None else self._places.filled(jittered)
            if numbers is None:
                problem = problem.with_recordings(self._recordings(jittered))
        numbers = problem.arguments if numbers is None else numbers
        r, jacobian = problem.compiled["residuals_and_jacobian"](jnp.asarray(cube), numbers)
        return np.asarray(r) + self._measured, np.asarray(jacobian)[:, places] / width

    @cached_property
    def _columns(self) -> tuple[np.ndarray, np.ndarray]:
        """Of every coordinate its place among those of the compiled problem (d,), and its width: 1 of the problem's own."""
        space = self.problem.space
        places = np.array([space.names.index(n) for n in self.names])
        return places, np.where(np.arange(len(places)) < self.own, 1.0, (space.upper - space.lower)[places])

    @cached_property
    def _places(self) -> InputPlaces | None:
        """Where inputs stand in what is compiled; None where they are not simply copied there."""
        return InputPlaces.of(self.problem, self.inputs, lambda inputs: self.problem.with_recordings(self._recordings(inputs)).arguments)

    @property
    def x(self) -> np.ndarray:
        """The answer (d,), all effects nothing."""
        return np.r_[self.z, np.zeros(len(self.names) - self.own)]

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


def rows_of(problem: Problem) -> Rows:
    """Rows in the order in which the problem writes residuals of whole records."""
    found: dict[str, list[np.ndarray]] = {k: [] for k in ("recording", "output", "sample", "measured", "fit", "unseen", "weight")}
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
            found["weight"].append(np.full(len(y), 1.0 if problem.weights is None else np.sqrt(problem.weights.get(n, 1.0))))
    return Rows(**{k: np.concatenate(v) for k, v in found.items()})


def _filled(recording: Recording, inputs: Mapping[str, np.ndarray], outputs: Mapping[str, object]) -> Recording:
    """Missing samples of outputs as straight lines, so that every sample has a row, and inputs that jump at each sample."""
    signals = dict(recording.signals)
    for o in outputs:
        y = recording[o]
        good = np.isfinite(y)
        if not good.all():
            signals[o] = Signal(np.interp(recording.t, recording.t[good], y[good]) if good.any() else np.zeros(len(y)), signals[o].unit)
    for u, values in inputs.items():
        signals[u] = Signal(values, signals[u].unit)
    return Recording(recording.t, signals, recording.name)


def _jittered(u: np.ndarray) -> np.ndarray:
    size = float(np.std(u)) or max(float(np.max(np.abs(u), initial=0.0)), 1.0)
    return u + JITTER * size * (np.arange(len(u)) % 2)


def _round(value: float) -> float:
    """The number of the series 1, 2, 5 that is nearest by its logarithm."""
    tens = 10.0 ** np.floor(np.log10(value))
    return float(f"{tens * min((1.0, 2.0, 5.0, 10.0), key=lambda m: abs(np.log(value / tens / m))):.1g}")


def _sizes(problem: Problem, z: np.ndarray) -> dict[str, tuple[float, float]]:
    """Of every state its spread over the recordings (rms about zero) and that of its rate."""
    values = np.asarray(problem.space.physical(z))
    found: dict[str, tuple[float, float]] = {}
    for name, drive in problem.whole_drives.items():
        if not isinstance(drive, Drive):
            continue
        t = problem.experiments[name].recording.t
        paths = problem.compiled["trajectories"](problem.space.tree(values, name), drive)
        for s in problem.model.states:  # type: ignore[union-attr]
            x = np.asarray(paths[s], dtype=float)[: len(t)]
            x = np.broadcast_to(x, t.shape) if x.ndim == 0 else x
            size = max(float(np.sqrt(np.mean(x**2))), 1e-9)
            rate = max(float(np.sqrt(np.mean(np.gradient(x, t[: len(x)]) ** 2))), size / max(float(np.ptp(t)), 1e-300))
            was = found.get(s, (0.0, 0.0))
            found[s] = max(size, was[0]), max(rate, was[1])
    return found
