"""A problem's plant as a stochastic state-space model: states, and chosen parameters as states that hardly move."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError, SpaceError
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.filters.square_root import sampled_noise_root
from plantfit.models.model import Model
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.problem import Problem
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.simulate.steps.linear import ExactStep, exact_maps, is_linear
from plantfit.space import Space

import jax
import jax.numpy as jnp
from jax import Array

LOGIT_SPREAD = 1.5  # prior standard deviation of a bounded parameter's logit: two of them reach 5 % and 95 % of the box
UNROLLED = 4


class Constants(NamedTuple):
    """What stays the same over a record: base parameter values (d,), noise levels by state and output, drift of
    parameters (k,)."""

    values: Any
    process: Any
    measurement: Any
    drift: Any


class Row(NamedTuple):
    """What changes: channels at both ends of the step before, its length, channels and outputs here (NaN: none),
    exact maps or None."""

    u0: Any
    u1: Any
    h: Any
    here: Any
    y: Any
    exact: tuple[ExactStep, Any] | None  # maps and the root of the process noise


class Record(NamedTuple):
    """The numbers of one recording: drive, outputs y (N, m); for exact steps their distinct lengths (U,) and which
    is where (N,)."""

    drive: Drive
    y: Any
    lengths: Any
    which: Any


@dataclass(frozen=True, eq=False)
class StateSpace:
    """x' = f(x, u, p) + w,  y = g(x, u, p) + e, with states x and joint coordinates s of the space, p = p(s), s' =
    drift.

    A parameter on a log scale is exp(s), so that it stays positive; one on a linear scale is low + (high - low) / (1 +
    exp(-s)), so that it stays in its bounds. The rest of the parameters are held. `exact`: linear in x and u, stepped
    by matrix exponentials.
    """

    simulator: Simulator
    space: Space  # parameters of the problem, then the noise levels
    joint: tuple[int, ...]  # coordinates in the state
    recording: str | None
    exact: bool

    @property
    def model(self) -> Model:
        return self.simulator.vector.model

    @property
    def states(self) -> int:
        return len(self.simulator.vector.states)

    def constants(self, values: Any, drift: Any = None) -> Constants:
        """For values (d,) of the space's coordinates."""
        tree, model = self.space.tree(values, self.recording), self.model
        process = jnp.stack([jnp.asarray(tree[f"process {n}"]) for n in model.states])
        measurement = jnp.stack([jnp.asarray(tree[f"measurement {n}"]) for n in model.outputs])
        return Constants(
            jnp.asarray(values),
            process,
            measurement,
            jnp.zeros(len(self.joint)) if drift is None else jnp.asarray(drift),
        )

    # -- parameters in the state ------------------------------------------------------------------

    def physical(self, s: Any) -> Any:
        """Values (..., k) of the joint coordinates for their states (..., k)."""
        low, high, log = (v[list(self.joint)] for v in (self.space.lower, self.space.upper, self.space.log))
        s = jnp.asarray(s)
        bounded = low + (high - low) * jax.nn.sigmoid(jnp.where(log, 0.0, s))
        return jnp.where(log, jnp.exp(jnp.where(log, s, 0.0)), bounded)

    def place(self, values: Any) -> np.ndarray:
        """The inverse of `physical` for values (k,) inside the bounds."""
        low, high, log = (v[list(self.joint)] for v in (self.space.lower, self.space.upper, self.space.log))
        values = np.asarray(values, dtype=float)
        share = np.clip((values - low) / (high - low), 1e-9, 1.0 - 1e-9)
        return np.where(log, np.log(np.where(log, values, 1.0)), np.log(share / (1.0 - share)))

    def prior_spread(self) -> np.ndarray:
        """Standard deviations (k,) of the joint states that the box stands for: two of them on either side of its
        middle."""
        low, high, log = (v[list(self.joint)] for v in (self.space.lower, self.space.upper, self.space.log))
        return np.where(log, 0.25 * np.log(np.where(log, high, 1.0) / np.where(log, low, 1.0)), LOGIT_SPREAD)

    def parameters(self, c: Constants, x: Any) -> tuple[Any, ...]:
        """Parameter values in the model's order for an augmented state (n + k,)."""
        values = c.values
        if self.joint:
            own = self.physical(x[self.states :])
            values = values.at[np.array(self.joint)].set(own)
        return self.simulator.positional(self.space.tree(values, self.recording))

    # -- functions of the augmented state ---------------------------------------------------------

    def transition(self, c: Constants, x: Any, row: Row) -> Any:
        """The augmented state (n + k,) after the step of a row."""
        n = self.states
        if row.exact is not None:
            maps = row.exact[0]
            moved = maps.state @ x[:n] + maps.start @ row.u0 + maps.constant
            return moved if maps.end is None else moved + maps.end @ row.u1
        return jnp.concatenate([self._stepped(self.parameters(c, x), x[:n], row), x[n:]])

    def _stepped(self, p: tuple[Any, ...], x: Any, row: Row) -> Any:
        simulator, m = self.simulator, self.simulator.parts
        vector, h = simulator.vector, row.h / m

        def one(j, x):
            u0, u1 = (_scalars(row.u0 + (row.u1 - row.u0) * ((j + k) / m)) for k in (0, 1))
            moved = simulator.step(vector.rate, _scalars(x), u0, u1, h, p, simulator.varying, vector.pattern)
            return jnp.stack(moved)

        return jax.lax.fori_loop(0, m, one, x) if m > UNROLLED else _repeated(one, m, x)

    def noise_root(self, c: Constants, x: Any, row: Row) -> Any:
        """Square root (n + k, n + k) of the covariance that a row's step adds, the rate linearised at x."""
        n = self.states
        if row.exact is not None:
            return row.exact[1]
        p = self.parameters(c, x)
        rates = jacobian(lambda v: jnp.stack(self.simulator.vector.rate(_scalars(v), _scalars(row.u0), p)), x[:n])
        return _blocks(sampled_noise_root(rates, c.process, row.h), jnp.diag(c.drift * jnp.sqrt(row.h)))

    def outputs(self, c: Constants, x: Any, row: Row) -> Any:
        """Every output (m,)."""
        return jnp.stack(
            self.simulator.vector.output(_scalars(x[: self.states]), _scalars(row.here), self.parameters(c, x))
        )

    # -- one record -------------------------------------------------------------------------------

    def record(self, problem: Problem, experiment: Experiment, fitted: bool = False) -> Record:
        """An experiment's numbers; with `fitted` only the measurements of its fitted part, up to the last of them."""
        y, stop = np.stack([experiment.recording[n] for n in self.model.outputs], axis=1), None
        if fitted:
            mask = experiment.mask("fit")
            stop = int(np.flatnonzero(mask)[-1]) + 1
            y = np.where(mask[:, None], y, np.nan)[:stop]
        drive = problem.predictor.drive(experiment, stop=stop)
        t = np.asarray(drive.t, dtype=float)
        h = np.concatenate([[0.0], t[1:] - t[:-1]])
        typical = float(np.median(h[1:])) if len(h) > 1 else 1.0
        lengths, which = np.unique(np.round(h / typical, 9), return_inverse=True)
        return Record(
            jax.tree.map(jnp.asarray, drive), jnp.asarray(y), jnp.asarray(lengths * typical), jnp.asarray(which)
        )

    def rows(self, values: Any, record: Record) -> tuple[Row, Any]:
        """Rows of a record, and the places (N,) of the samples among them; edges of late inputs make rows of their
        own."""
        p, drive, y = self.space.tree(values, self.recording), record.drive, record.y
        steps, (u0, u1, h) = self.simulator.steps(p, drive)
        begin, end = jnp.stack(u0, axis=1), jnp.stack(u1, axis=1)
        before = jnp.concatenate([begin[:1], begin]), jnp.concatenate([begin[:1], end])
        length = jnp.concatenate([jnp.zeros(1), h])
        here = (
            jnp.zeros_like(before[0])
            .at[steps.rank]
            .set(jnp.stack([jnp.asarray(v) for v in self.simulator.channels(p, drive)], axis=1))
        )
        places = steps.rank if drive.samples is None else steps.rank[drive.samples]
        seen = jnp.full((len(length), y.shape[1]), jnp.nan).at[places].set(y)
        exact = None
        if self.exact:  # steps of one length share one exponential
            exact = jax.tree.map(lambda a: a[record.which], self.exact_at(values, record.lengths))
        return Row(*before, length, here, seen, exact), places

    def exact_at(self, values: Any, h: Any) -> tuple[ExactStep, Any]:
        """Maps of steps of lengths h (K,) of a linear model and the roots (K, n, n) of their process noise."""
        simulator, zero = self.simulator, jnp.zeros(self.states)
        scalars = simulator.positional(self.space.tree(values, self.recording))
        maps = exact_maps(simulator.vector, scalars, h, simulator.varying)
        still = (0.0,) * len(simulator.vector.channels)
        a = jacobian(lambda v: jnp.stack(simulator.vector.rate(_scalars(v), still, scalars)), zero)
        intensity = self.constants(values).process
        return maps, jax.vmap(lambda length: sampled_noise_root(a, intensity, length))(h)

    def first(self, values: Any, drive: Drive) -> Any:
        """The model's own initial state (n,) at base values."""
        p = self.space.tree(values, self.recording)
        return jnp.stack(self.simulator.initial(p, drive.first_input, drive.first_output))


def jacobian(f: Callable, x: Any) -> Any:
    """df/dx (m, n) of a function of (n,) to (m,); `jax.jacfwd` would use what native loops do not know."""
    return jax.vmap(lambda along: jax.jvp(f, (x,), (along,))[1], out_axes=1)(jnp.eye(x.shape[0]))


def _scalars(x: Any) -> tuple[Any, ...]:
    return tuple(x[i] for i in range(x.shape[0]))  # iterating over it would split it, which native loops do not know


def _repeated(one, times: int, x: Any) -> Any:
    for j in range(times):
        x = one(j, x)
    return x


def _blocks(a: Array, b: Array) -> Array:
    n, k = a.shape[0], b.shape[0]
    return jnp.block([[a, jnp.zeros((n, k))], [jnp.zeros((k, n)), b]]) if k else a


def state_space(problem: Problem, noise: Noise, joint: Sequence[str] = (), recording: str | None = None) -> StateSpace:
    """The stochastic model of one recording (the first by default); `joint` names coordinates of the space that become
    states.

    Raises ModelError for models without states or with jumps or late states, SpaceError for unknown names.
    """
    model = problem.model
    if not isinstance(model, Model) or not model.states:
        raise ModelError(
            f"Model {model.name!r} has no states to filter; a Kalman "
            "filter needs equations of motion, not a regression."
        )
    if not model.smooth:
        raise ModelError(
            f"Model {model.name!r} has resets, dry friction, backlash or late states; filter a smooth form of it."
        )
    levels = noise.parameters(model)
    noise.initial_levels(model)
    space = Space({**problem.space.parameters, **levels}, problem.space.recordings)
    name = recording or next(iter(problem.experiments))
    if name not in problem.experiments:
        raise SpaceError(f"There is no recording {name!r}; there are {list(problem.experiments)}.")
    own = problem.space.names
    unknown = [n for n in joint if n not in own]
    if unknown:
        raise SpaceError(f"{unknown[0]!r} is not a free parameter of the problem; free are {list(own)}.")
    simulator = problem.predictor.stepping()
    late = {d.parameter for d in model.delays}
    if late & {space.coordinates[space.names.index(n)].parameter for n in joint}:
        raise SpaceError(f"A dead time cannot be a state: {sorted(late)}; hold it, or find it with maximum_likelihood.")
    exact = not joint and not model.delays and is_linear(simulator.vector)
    return StateSpace(simulator, space, tuple(space.names.index(n) for n in joint), name, exact)
