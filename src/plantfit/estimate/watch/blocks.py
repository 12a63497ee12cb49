"""A filter in blocks of samples: innovations, what each parameter does to them, and the parameters tracked beside
it."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.estimate.filters.filter_step import filter_step, linearised
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.filters.rows_on_line import RowsOnLine
from plantfit.estimate.filters.square_root import whitened
from plantfit.estimate.filters.state_space import Row, StateSpace, state_space
from plantfit.native import native_scan
from plantfit.native.kept_programs import Kept as Program
from plantfit.native.kept_programs import described
from plantfit.problem.problem import Problem

import jax
import jax.numpy as jnp

KEPT = 128  # blocks that are kept for a look back


class Kept(NamedTuple):
    """A block as it was worked off: the belief before it and its time (s), rows, their slopes by dead times, places of
    the samples among the rows, times (b,) and whitened innovations (b, m)."""

    belief: Any
    begin: float
    chunks: list[tuple[Row, Row | None]]
    places: np.ndarray
    t: np.ndarray
    white: np.ndarray


@dataclass(frozen=True)
class Block:
    """What B samples told.

    Whitened innovations (B, m), 0 where nothing was measured; their slopes (B, m, d) by the watched parameters, each in
    units of its `size`; how many outputs were measured (B,); and the tracked belief at the end, mean (n + k,) and root
    (n + k, n + k).
    """

    t: np.ndarray
    white: np.ndarray
    slopes: np.ndarray
    measured: np.ndarray
    mean: np.ndarray
    root: np.ndarray

    @property
    def scores(self) -> np.ndarray:
        """Slopes (B, d) of each sample's log-likelihood by its prediction, in units of `size`."""
        return -np.einsum("bmd,bm->bd", self.slopes, self.white)

    @property
    def information(self) -> np.ndarray:
        """What the samples can tell of the parameters (d, d), in units of `size`."""
        return np.einsum("bmd,bme->de", self.slopes, self.slopes)


class BlockFilter:
    """An extended Kalman filter of a problem with its parameters held at `values` (d,), beside one that tracks those in
    `joint`.

    `watched` are places of coordinates whose effect on the innovations is wanted, `size` (w,) their units; `root` (n,
    n) is that of the first state, `prior` and `drift` (k,) the standard deviations of tracked parameters in their
    coordinates and how far these wander in a second. Blocks have `length` samples; shorter ones are filled up.
    """

    def __init__(
        self,
        problem: Problem,
        noise: Noise,
        values: np.ndarray,
        watched: Sequence[int],
        size: np.ndarray,
        joint: Sequence[str],
        prior: np.ndarray,
        drift: np.ndarray,
        root: np.ndarray,
        recording: str,
        length: int,
    ):
        held, tracked = state_space(problem, noise, (), recording), state_space(problem, noise, joint, recording)
        self.plant, self.tracked = replace(held, exact=False), tracked
        self.values, self.length, self.prior = np.asarray(values, dtype=float), length, np.asarray(prior, dtype=float)
        self.axes = np.zeros((len(watched), len(values)))
        self.axes[np.arange(len(watched)), list(watched)] = size
        self.root = np.asarray(root, dtype=float)
        self.drift = np.asarray(drift, dtype=float)
        self.own = tracked.place(self.values[list(tracked.joint)])
        self.rows = RowsOnLine(self.plant, self.values)
        self.size = length * (1 + len(self.rows.dead_times))  # rows that are worked off at once
        begun = jax.vmap(lambda a, drive: jax.jvp(lambda v: held.first(v, drive), (self.values,), (a,)), (0, None))
        of = described((*map(_compiled_in, (self.plant, tracked)), self.values, self.axes, self.drift))
        self._advance, self._since, self._begun = (
            Program(f, f"watch {name}", of, careful=True)
            for f, name in ((self._advanced, "advanced"), (self._slopes_since, "since"), (begun, "begun"))
        )
        self.carry: Any = None
        self.past: deque[Kept] = deque(maxlen=KEPT)

    def reset(self) -> None:
        """Begin anew with the next block."""
        self.carry = None
        self.rows.reset()
        self.past.clear()

    def open(self, spread: np.ndarray) -> None:
        """Let the tracked parameters (k,) be as uncertain again as `spread`, in their coordinates."""
        if self.carry is None:
            return
        n, (held, moved, mean, root) = self.tracked.states, self.carry
        root = np.asarray(root).copy()
        added = np.zeros((len(root), len(spread)))
        added[n:] = np.diag(spread)
        joined = np.linalg.qr(np.concatenate([root, added], axis=1).T, mode="r")
        self.carry = held, moved, mean, jnp.asarray(np.asarray(joined).T)

    def run(self, t: np.ndarray, u: np.ndarray, y: np.ndarray) -> Block:
        """The next samples: times (b,), inputs (b, inputs), outputs (b, m) with NaN where nothing was measured, b up
        to `length`."""
        if self.carry is None:
            self._first(t, u, y)
        before: Any = self.carry
        begin = float(t[0]) if self.rows.last is None else self.rows.last
        fed, told = self.rows.feed(t, u), []
        chunks = fed.chunks(self.size, y)
        for rows, moved in chunks:
            self.carry, parts = self._advance(self.carry, rows, moved)
            told.append(parts)
        white, slopes = (np.concatenate([np.asarray(part[i]) for part in told], axis=i) for i in range(2))
        carry: Any = self.carry
        mean, root = (np.asarray(v) for v in carry[2:])
        own = np.moveaxis(slopes, 0, -1)[fed.places]
        self.past.append(Kept(before[0], begin, chunks, fed.places, t, white[fed.places]))
        return Block(t, white[fed.places], own, np.sum(np.isfinite(y), axis=1), mean, root)

    def since(self, blocks: int, onsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whitened innovations (B, m) of the last blocks, and their slopes (o, B, m, w) by changes of each watched
        parameter that begin at `onsets` (o,) in s, in units of its `size`."""
        kept = list(self.past)[-blocks:]
        n, lanes = self.plant.states, (len(self.axes), len(onsets))
        tangents: Any = jnp.zeros((*lanes, n)), jnp.zeros((*lanes, n, n))
        found = []
        for block in kept:
            belief, at, slopes = block.belief, block.begin, []
            for rows, moved in block.chunks:
                begins = at + np.concatenate([[0.0], np.cumsum(rows.h)])
                at = float(begins[-1])
                gates = (begins[:-1] >= onsets[:, None] - 1e-9 * (1.0 + abs(at))).astype(float)
                belief, tangents, told = self._since(belief, tangents, rows, moved, gates)
                slopes.append(np.asarray(told))
            found.append(np.moveaxis(np.concatenate(slopes, axis=2)[:, :, block.places], 0, -1))
        return np.concatenate([b.white for b in kept]), np.concatenate(found, axis=1)

    def _first(self, t: np.ndarray, u: np.ndarray, y: np.ndarray) -> None:
        model, simulator = self.plant.model, self.plant.simulator
        drive = simulator.drive(
            t[:1],
            {n: u[:1, i] for i, n in enumerate(model.inputs)},
            measured={n: y[:, i] for i, n in enumerate(model.outputs)},
        )
        # states that begin at an output begin at nothing where it is not measured; the wide first belief makes up for
        # it
        seen = tuple(v if np.isfinite(v) else 0.0 for v in map(float, drive.first_output))
        drive = drive._replace(first_output=seen, first_input=self.rows.first(float(t[0]), u[0]))
        (means, moved), n = self._begun(jnp.asarray(self.axes), drive), self.plant.states
        first = means[0] if len(self.axes) else self.plant.first(jnp.asarray(self.values), drive)
        root = jnp.asarray(self.root)
        still = jnp.zeros((len(self.axes), n, n))
        joint = np.zeros((n + len(self.prior),) * 2)
        joint[:n, :n], joint[n:, n:] = self.root, np.diag(self.prior)
        self.carry = (first, root), (moved, still), jnp.concatenate([first, jnp.asarray(self.own)]), jnp.asarray(joint)

    def _advanced(self, carry: Any, rows: Row, by_dead_times: Row | None) -> Any:
        held, moved, mean, root = carry
        tracked = self.tracked
        along = self._along(held, rows, by_dead_times)
        (beliefs, tangents), told = jax.vmap(along)(jnp.asarray(self.axes), moved)
        belief = jax.tree.map(lambda a: a[0], beliefs)
        c = tracked.constants(jnp.asarray(self.values), self.drift)
        (mean, root), _ = native_scan(
            lambda own, row: (filter_step(tracked, linearised, False, c, own, row)[0], None),
            (mean, root),
            rows,
            fallback=True,
        )
        white, slopes = told
        return (belief, tangents, mean, root), (white[0], slopes)

    def _along(self, held: Any, rows: Row, by_dead_times: Row | None) -> Any:
        """The filter from the belief `held` with its slope along an axis `a` (d,) of the parameters, of which a share
        `gates` (r,) of each row acts."""
        plant, dead = self.plant, jnp.asarray(self.rows.by_values)

        def step(c, belief, row):
            belief, told = filter_step(plant, linearised, True, c, belief, row)
            return belief, (told["error"], told["scale"], told["white"])

        def along(a, moved, gates=None):
            c, dc = jax.jvp(plant.constants, (jnp.asarray(self.values),), (a,))

            def both(pair, given):
                row, row_moved, gate = given
                row_moved = jax.tree.map(jnp.zeros_like, row) if row_moved is None else row_moved
                dc_now = dc if gate is None else jax.tree.map(lambda v: gate * v, dc)
                tangent = dc_now, pair[1], row_moved
                (belief, told), (belief_moved, told_moved) = jax.jvp(step, (c, pair[0], row), tangent)
                return (belief, belief_moved), (told[2], whitened(told[1], told_moved[0]))

            by_a = None
            if by_dead_times is not None:
                by_a = jax.tree.map(lambda v: jnp.tensordot(dead @ a, v, 1), by_dead_times)
                if gates is not None:
                    by_a = jax.tree.map(lambda v: v * gates.reshape(-1, *[1] * (v.ndim - 1)), by_a)
            return native_scan(both, (held, moved), (rows, by_a, gates), keep=True, fallback=True)

        return along

    def _slopes_since(
        self, belief: Any, tangents: Any, rows: Row, by_dead_times: Row | None, gates: Any
    ) -> tuple[Any, Any, Any]:
        """The belief and its slopes (w, o, ...) behind the rows, and those (w, o, r, m) of the innovations, by changes
        of which `gates` (o, r) say in which rows they act."""
        along = self._along(belief, rows, by_dead_times)
        each = jax.vmap(jax.vmap(along, (None, 0, 0)), (0, 0, None))
        (beliefs, tangents), (_, slopes) = each(jnp.asarray(self.axes), tangents, gates)
        return jax.tree.map(lambda v: v[0, 0], beliefs), tangents, slopes


def _compiled_in(plant: StateSpace) -> tuple[Any, ...]:
    """What the programs of a state-space model depend on."""
    simulator, space = plant.simulator, plant.space
    steps = simulator.stepper, simulator.substeps, simulator.interpolated
    return (
        simulator.vector.model, *steps, space.parameters, space.recordings, plant.joint, plant.recording, plant.exact,
    )  # fmt: skip


def shapes(plant: StateSpace, values: np.ndarray) -> np.ndarray:
    """Whether each coordinate (d,) enters rates or outputs of the model or is a dead time, and not its first state
    alone."""
    rng = np.random.default_rng(0)
    vector, x, u = (
        plant.simulator.vector,
        jnp.asarray(rng.standard_normal(plant.states)),
        rng.standard_normal(len(plant.simulator.vector.channels)),
    )

    def all_of(v):
        p = plant.simulator.positional(plant.space.tree(v, plant.recording))
        scalars = tuple(x[i] for i in range(plant.states))
        return jnp.stack([*vector.rate(scalars, tuple(u), p), *vector.output(scalars, tuple(u), p)])

    slopes = jax.vmap(lambda a: jax.jvp(all_of, (jnp.asarray(values),), (a,))[1])(jnp.eye(len(values)))
    dead = np.any(RowsOnLine(plant, values).by_values != 0.0, axis=0)
    return np.any(np.nan_to_num(np.asarray(slopes), nan=1.0) != 0.0, axis=1) | dead
