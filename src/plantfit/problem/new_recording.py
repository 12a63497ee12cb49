"""A recording beside those of a problem: simulated with steps of its own."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from plantfit.errors import RecordingError, SimulationError, SpaceError
from plantfit.problem.measure.experiment import Experiment, before_in_units, in_units
from plantfit.problem.predictor import Predictor
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.runtime import jit
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.simulate.steps.registry import STEPPERS

import jax.numpy as jnp

SMALL = 0.001  # step error, as a share of the spread of an output
FINEST = 256  # steps a sample


def predict_over(
    problem: Problem, values: Any, recording: Recording | Experiment | str, named: Mapping[str, Any] | None = None
) -> dict[str, np.ndarray]:
    """Every output (n,), in its unit, over a recording that need not be one of the problem, at parameter values (d,) in
    their units.

    It needs the signals that the model reads, in units that can be converted, and a measured value of an output where
    the model begins at one. A Recording begins as those of the problem do (`before`, `initial_time`); an Experiment
    says its own. `named` values of parameters, scalars or arrays of their shapes in their units, go before `values`.
    Steps are halved until their error is below 0.1 % of the spread of the outputs, unless the problem was given
    `substeps`; a recording with the numbers of one of the problem's is simulated as that one. Raises RecordingError,
    UnitError, SpaceError and SimulationError.
    """
    if isinstance(recording, str):
        if recording not in problem.experiments:
            raise RecordingError(f"There is no recording {recording!r}; there are {list(problem.experiments)}.")
        recording = problem.experiments[recording]
    elif not isinstance(recording, Recording | Experiment):
        raise RecordingError(
            f"{type(recording).__name__} is no recording to predict over; give a recording, "
            f"as of pf.read_csv, or the name of one of {list(problem.experiments)}."
        )
    return NewRecording.of(problem, recording).outputs(np.asarray(values, dtype=float), dict(named or {}))


def begun_off(
    problem: Problem, recording: Recording | Experiment | str, moved: Mapping[str, float]
) -> "NewRecording | None":
    """A recording that states begin in at first measured values, of which those of outputs `moved` by so much, in their
    units; None where the fit has estimated how far these are off."""
    given = problem.experiments[recording] if isinstance(recording, str) else recording
    new = NewRecording.of(problem, given)
    if new.known is not None and np.any(problem.experiments[new.known].mask("fit")):
        return None
    return NewRecording(problem, replace(new.experiment, start_corrections=dict(moved)), None)


@dataclass(frozen=True)
class NewRecording:
    """A recording in the units of the model; `known` is the recording of the problem that has the same numbers, None
    if there is none."""

    problem: Problem
    experiment: Experiment
    known: str | None

    @classmethod
    def of(cls, problem: Problem, given: Recording | Experiment) -> "NewRecording":
        """Raises RecordingError for a missing signal, UnitError for one that cannot be converted."""
        if isinstance(given, Recording):
            before, initial_time = problem.begins
            given = Experiment(given, before=before, initial_time=initial_time)
        needs, outputs = problem.needs, problem.outputs
        r = in_units(
            given.recording, {n: u for n, u in needs.items() if n not in outputs or n in given.recording.signals}
        )
        unmeasured = {o: Signal(np.full(len(r), np.nan), needs[o]) for o in outputs if o not in r.signals}
        r = Recording(r.t, {**r.signals, **unmeasured}, r.name, r.log)
        experiment = replace(
            given, recording=r, before=before_in_units(given.recording, given.before, needs), shared_errors={}
        )
        return cls(
            problem, experiment, next((n for n, e in problem.experiments.items() if _same(e, experiment, needs)), None)
        )

    def outputs(self, values: np.ndarray, named: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Every output (n,) at parameter values (d,) in their units, of which `named` ones are others."""
        problem = self.problem
        p = _parameters(problem, values, named, self.known or self.experiment.recording.name)
        if self.known is not None:
            return problem.outputs_over(self.known, p)
        predictor, mesh = problem.predictor, self._mesh()
        found = self._simulated(predictor, p, mesh)
        if not predictor.has_steps or problem.substeps_chosen or self.experiment.steady:
            return found
        even = max(1, round(problem.steps_a_sample)) if problem.mesh and mesh is None else predictor.stepping().substeps
        order = STEPPERS[predictor.stepping().stepper].order
        while True:
            even *= 2
            finer = self._simulated(_with_steps(predictor, even), p, mesh)
            if _error(found, finer, order) <= SMALL or even >= FINEST:
                return finer
            found = finer

    def _mesh(self) -> np.ndarray | None:
        """Times of steps (k,) that the problem has for a recording at the same times."""
        for name, mesh in self.problem.mesh.items():
            if np.array_equal(self.problem.experiments[name].recording.t, self.experiment.recording.t):
                return mesh
        return None

    def _simulated(self, predictor: Predictor, p: Mapping[str, Any], mesh: np.ndarray | None) -> dict[str, np.ndarray]:
        drive = predictor.drive(self.experiment, longest=self.problem.longest_delays(), mesh=mesh)
        if isinstance(drive, Drive):
            self._check_start(predictor.stepping(), p, drive)
        return _arrays(_compiled(predictor)(p, drive))

    def _check_start(self, simulator: Simulator, p: Mapping[str, Any], drive: Drive) -> None:
        lost = [o for o, y in zip(simulator.vector.outputs, drive.first_output, strict=True) if not np.isfinite(y)]
        start = [bool(np.all(np.isfinite(x))) for x in simulator.initial(p, drive.first_input, drive.first_output)]
        if all(start):
            return
        r, state = self.experiment.recording, simulator.vector.states[start.index(False)]
        if lost:
            raise RecordingError(
                f"Recording {r.name!r} has no value of {lost[0]!r}, and the model {simulator.vector.model.name!r} "
                "begins at the first measured one; add the signal with its first value (the others may be missing)."
            )
        raise SimulationError(
            f"Recording {r.name!r}: the state {state!r} begins at no finite value; check the parameters."
        )


@lru_cache(maxsize=16)  # bands ask for thousands of draws, with the same few steps
def _compiled(predictor: Predictor) -> Any:
    return jit(predictor.outputs)


@lru_cache(maxsize=16)  # a new predictor would be compiled anew
def _with_steps(predictor: Predictor, substeps: int) -> Predictor:
    s = predictor.stepping()
    return predictor.with_simulator(Simulator(s.vector, s.stepper, substeps, s.interpolated))


def _arrays(outputs: Mapping[str, Any]) -> dict[str, np.ndarray]:
    return {k: np.asarray(v) for k, v in outputs.items()}


def _error(coarse: Mapping[str, np.ndarray], fine: Mapping[str, np.ndarray], order: int) -> float:
    """The step error that the fine outputs still have, rms as a share of the spread of each output; 0 for exact
    steps."""
    left = 1.0 / (2.0**order - 1.0)
    shares = []
    for name, y in fine.items():
        with np.errstate(all="ignore"):
            off, spread = np.sqrt(np.mean((coarse[name] - y) ** 2)), np.std(y)
        shares.append(left * off / max(spread, 1e-300) if off > 0 else 0.0)
    return float(np.nan_to_num(np.max(shares), nan=np.inf))


def _same(a: Experiment, b: Experiment, needs: Mapping[str, Any]) -> bool:
    """Whether two recordings in the units of the model have the same numbers and begin alike."""
    r, s = a.recording, b.recording
    return (
        np.array_equal(r.t, s.t)
        and all(np.array_equal(r[n], s[n], equal_nan=True) for n in needs)
        and (a.before, a.initial_time, a.steady) == (b.before, b.initial_time, b.steady)
    )


def _parameters(problem: Problem, values: np.ndarray, named: Mapping[str, Any], recording: str) -> dict[str, Any]:
    """Every parameter by name, fixed and tied ones too."""
    space, given = problem.space, {}
    for name, value in named.items():
        if name not in space.parameters:
            raise SpaceError(f"values names {name!r}, which is not one of the parameters {list(space.parameters)}.")
        shape = space.parameters[name].shape
        try:
            number = np.asarray(value, dtype=float)
        except (TypeError, ValueError):
            number = np.asarray(np.nan)
        if number.shape != shape or not np.all(np.isfinite(number)):
            raise SpaceError(
                f"values has {name!r} as {value!r}; give "
                f"{f'finite numbers of shape {shape}' if shape else 'one finite number'}."
            )
        given[space.root(name)] = jnp.asarray(number)
    own = {n for n in space.parameters if (p := space.parameters[space.root(n)]).per_recording and p.value is None}
    lost = [n for n in own if space.root(n) not in given] if recording not in problem.experiments else []
    if lost:
        name = sorted(lost)[0]
        raise SpaceError(
            f"Parameter {name!r} has a value for each of the recordings {list(problem.experiments)} and none for "
            f"{recording!r}; "
            f"give it, as in predict(recording, values={{{name!r}: 0.0}})."
        )
    at = recording if recording in problem.experiments else next(iter(problem.experiments))
    return {n: given.get(space.root(n), v) for n, v in space.tree(values, at).items()}
