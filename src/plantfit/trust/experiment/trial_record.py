"""A recording that has not been made: what it would tell of the parameters, for every plant that the data allow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.models.model import Model
from plantfit.problem.evaluate.points import several
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.simulate.simulator import Simulator
from plantfit.simulate.steps.dependencies import dependencies
from plantfit.simulate.steps.grid import Pieces
from plantfit.simulate.steps.registry import STEPPERS
from plantfit.simulate.steps.vector import placeholders

import jax.numpy as jnp

STEP = 0.05  # of a standard error, by which a parameter is moved to see its effect
LEAST, MOST = 1e-6, 1e-4  # of its size, between which the move stays: a larger one makes open directions look known
ROUGH = 1e-2  # of its size, the largest move where events, friction or backlash jump
EXACT = 1e-3  # step error, as a share of the spread of an output
FINEST = 64  # steps a sample
FEWEST_KNOTS = 16  # of an input that arrives late, that a program is compiled for


@dataclass(frozen=True)
class Told:
    """What a recording would tell: `effects` (K, m, c) of the c coordinates on the outputs over their noise, for
    each of K plants; `course` (K, m) the outputs over their noise; `signals` by name (K, N) what limits are held
    against, in their units."""

    effects: np.ndarray
    course: np.ndarray
    signals: Mapping[str, np.ndarray]

    @property
    def finite(self) -> bool:
        return bool(np.all(np.isfinite(self.effects)))


@dataclass(frozen=True, eq=False)
class TrialRecord:
    """`told(u)` for inputs u (N, inputs) at times `t` (N,), held from one to the next.

    `plants` (K, d) are values of the free parameters in their units, the first the one that is believed most; `noise`
    the standard deviation of each output in its unit; `sizes` (d,) how far a parameter may be moved to see its effect,
    in its unit. The plant begins as in the problem's first recording: input before it, first measured outputs.
    """

    problem: Problem
    plants: np.ndarray
    t: np.ndarray
    noise: Mapping[str, float]
    sizes: np.ndarray
    watched: tuple[str, ...] = ()
    simulator: Simulator | None = None

    @property
    def model(self) -> Model:
        """The model. Raises ModelError for a regression."""
        if not isinstance(self.problem.model, Model):
            raise ModelError("A regression has no inputs over time to design; identify a model with states.")
        return self.problem.model

    @property
    def recording(self) -> str:
        """The recording of the problem whose begin, and whose own parameters, the new one has."""
        return next(iter(self.problem.experiments))

    @cached_property
    def coordinates(self) -> np.ndarray:
        """Numbers (c,) of the coordinates that this recording depends on."""
        found = [i for i, c in enumerate(self.problem.space.coordinates) if c.recording in (None, self.recording)]
        return np.array(found, dtype=int)

    @cached_property
    def own(self) -> np.ndarray:
        """Which (c,) of `coordinates` are unknown anew: of one recording only, or where the states begin."""
        only, coordinates = self._only_initial(), self.problem.space.coordinates
        return np.array(
            [coordinates[i].recording is not None or coordinates[i].parameter in only for i in self.coordinates],
            dtype=bool,
        )

    def _only_initial(self) -> set[str]:
        """Parameters that say where the states begin and nothing else."""
        vector = self._own_simulator.vector
        model = vector.model
        if model.events or model.frictions or model.backlashes:
            return set()
        first = len(vector.states) + len(vector.channels)
        inner = placeholders(model)
        used = set().union(*dependencies(vector.rate, *inner), *dependencies(vector.output, *inner))
        late = {d.parameter for d in (*model.delays, *model.state_delays)}
        return {p for k, p in enumerate(vector.parameters) if first + k not in used and p not in late}

    @property
    def _own_simulator(self) -> Simulator:
        return self.simulator or self.problem.predictor.stepping()

    @cached_property
    def moves(self) -> tuple[np.ndarray, np.ndarray]:
        """Values (K, c) of the coordinates a little lower and a little higher than each plant's, within physical
        limits."""
        on, coordinates = self.coordinates, self.problem.space.coordinates
        values = self.plants[:, on]
        size = np.maximum(np.abs(values), 1e-3 * np.array([coordinates[i].upper - coordinates[i].lower for i in on]))
        most = MOST if self.model.smooth else ROUGH
        wanted = np.where(np.isfinite(self.sizes[on]) & (self.sizes[on] > 0), STEP * self.sizes[on], most * size)
        move = np.clip(wanted, LEAST * size, most * size)
        low, high = (np.array([coordinates[i].limits[side] for i in on]) for side in (0, 1))
        return np.maximum(values - move, low), np.minimum(values + move, high)

    @cached_property
    def _parameters(self) -> dict[str, np.ndarray]:
        """Every parameter by name, stacked over the plants and then, plant by plant, over the moved coordinates."""
        rows = [*self.plants]
        for plant, lows, highs in zip(self.plants, *self.moves, strict=True):
            for i, low, high in zip(self.coordinates, lows, highs, strict=True):
                for value in (low, high):
                    moved = plant.copy()
                    moved[i] = value
                    rows.append(moved)
        trees = [self.problem.space.tree(row, self.recording) for row in rows]
        return {n: np.stack([np.asarray(tree[n], dtype=float) for tree in trees]) for n in trees[0]}

    @cached_property
    def _simulate(self) -> Any:
        return several(self._compiled(self._own_simulator)["outputs"])

    @cached_property
    def _follow(self) -> Any:
        return several(self._compiled(self._own_simulator)["trajectories"])

    def _compiled(self, simulator: Simulator) -> dict[str, Any]:
        """The problem's functions with these steps, which it keeps: another input is designed without compiling
        anew."""
        return self.problem.with_simulator(simulator).compiled

    def drive(self, u: np.ndarray) -> Any:
        """The numbers of a recording with these inputs (N, inputs)."""
        model, begin = self.model, self.problem.experiments[self.recording]
        signals = {n: Signal(u[:, k], unit) for k, (n, unit) in enumerate(model.inputs.items())}
        for name, unit in model.outputs.items():
            seen = begin.recording[name]
            finite = seen[np.isfinite(seen)]
            signals[name] = Signal(np.full(len(self.t), finite[0] if len(finite) else np.nan), unit)
        given = Experiment(Recording(self.t, signals, "new"), before=self.begins)
        drive = self.problem.predictor.with_simulator(self._own_simulator).drive(
            given, longest=self.problem.longest_delays()
        )
        return drive._replace(delayed=tuple(_padded(pieces, self.t) for pieces in drive.delayed))

    @cached_property
    def begins(self) -> dict[str, float]:
        """Inputs before the first sample, in the model's units."""
        begin = self.problem.experiments[self.recording]
        given = {n: float(v) for n, v in begin.before.items()}
        return {n: given.get(n, float(begin.recording[n][0])) for n in self.model.inputs}

    def told(self, u: np.ndarray) -> Told:
        """What these inputs (N, inputs) would tell."""
        drive, outputs = self.drive(u), tuple(self.model.outputs)
        count, c = len(self.plants), len(self.coordinates)
        found = {n: np.asarray(y) for n, y in self._simulate(self._parameters, drive).items()}
        scaled = np.concatenate([found[n] / self.noise[n] for n in outputs], axis=1)
        pairs = scaled[count:].reshape(count, c, 2, -1)
        low, high = self.moves
        with np.errstate(all="ignore"):
            effects = (pairs[:, :, 1] - pairs[:, :, 0]) / np.maximum(high - low, 1e-300)[:, :, None]
        signals = {n: found[n][:count] for n in self.watched if n in found}
        hidden = [n for n in self.watched if n not in found]
        if hidden:
            inner = self._follow({n: v[:count] for n, v in self._parameters.items()}, drive)
            signals |= {n: np.asarray(inner[n]) for n in hidden}
        return Told(np.swapaxes(effects, 1, 2), scaled[:count], signals)

    def refined(self, trials: Sequence[np.ndarray]) -> "TrialRecord":
        """The same with steps halved until their error at the first plant is below 0.1 % of the outputs' spread for
        these inputs."""
        predictor = self.problem.predictor
        if not predictor.has_steps or self.problem.substeps_chosen:
            return self
        simulator = self._own_simulator
        p = {n: jnp.asarray(v[0]) for n, v in self._parameters.items()}
        while True:
            twice = simulator.refined(2)
            coarse, fine = (self._compiled(s)["outputs"] for s in (simulator, twice))
            error = max(
                _step_error(coarse(p, self.drive(u)), fine(p, self.drive(u)), STEPPERS[simulator.stepper].order)
                for u in trials
            )
            if error <= EXACT or twice.substeps > FINEST:
                return self._with(simulator)
            simulator = twice

    def _with(self, simulator: Simulator) -> "TrialRecord":
        return TrialRecord(self.problem, self.plants, self.t, self.noise, self.sizes, self.watched, simulator)


def _padded(pieces: Pieces, t: np.ndarray) -> Pieces:
    """The same input with further knots after the last sample, as many as make their number a power of two: so that
    inputs with other numbers of jumps share a compiled program."""
    count = len(pieces.knots)
    more = max(FEWEST_KNOTS, 1 << max(0, count - 1).bit_length()) - count
    late = t[-1] + (t[-1] - t[0] + 1.0) * np.arange(1.0, more + 1.0)
    value, slope, origin = (np.r_[a, np.repeat(a[-1:], more)] for a in (pieces.value, pieces.slope, pieces.origin))
    return Pieces(value, slope, origin, np.r_[pieces.knots, late])


def _step_error(coarse: Mapping[str, Any], fine: Mapping[str, Any], order: float) -> float:
    """Step error of the coarse outputs, rms as a share of the spread of each."""
    shares = [0.0]
    for name, y in fine.items():
        off, spread = np.asarray(coarse[name]) - np.asarray(y), float(np.std(np.asarray(y)))
        rms = float(np.sqrt(np.mean(off**2)))
        if np.isfinite(rms) and rms > 0:
            shares.append(rms / max(spread, 1e-300) / (1.0 - 2.0**-order))
    return max(shares)
