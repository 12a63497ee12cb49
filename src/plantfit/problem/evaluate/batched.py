"""A simulated problem as functions of a cube point, all records in one compiled loop.

A record's residuals depend on its own coordinates only (the shared ones and those per recording), so
that derivatives are taken in these q local coordinates; the zeros of a full Jacobian are never made.
"""

import contextlib
import dataclasses
import pickle
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native import NativeUnsupported
from plantfit.simulate.records.batch import Batch
from plantfit.simulate.records.rows import RecordRows, filled, make_rows
from plantfit.simulate.records.schedule import Chunks, Schedule, Track, make_schedule
from plantfit.simulate.records.whole_records import residuals_of_records, slopes_of_records, squares_of_records
from plantfit.simulate.simulator import Drive, Simulator
from plantfit.space import Space

import jax
import jax.numpy as jnp

WIDE = 256  # candidates that run side by side
WIDE_GRADIENTS = 20


class Numbers(NamedTuple):
    """What compiled functions need and that is not compiled in; a pytree."""

    rows: Chunks
    records: Any  # the `Records` of `BatchedRecords.whole`, None without
    steps_first: Any
    first_input: tuple[Any, ...]  # (L,)
    first_output: tuple[Any, ...]  # (L,)
    scale: tuple[Any, ...]  # per output
    weight: Any = None  # (L,) of the squares of every record; None: 1
    count: Any = None  # scored samples that the squares of a cost are divided by; None: of the compiled records


@dataclass(frozen=True, eq=False)
class BatchedRecords:
    """The fitted parts of records under one simulator, as pure functions of (z, numbers)."""

    simulator: Simulator
    space: Space
    names: tuple[str, ...]
    rows: Schedule
    whole: RecordRows | None  # for costs and gradients; None with too many edges, or with records of too unequal length
    few_edges: bool
    scored: tuple[tuple[np.ndarray, ...], ...]  # per record and output: which samples
    local: np.ndarray  # (L, q) coordinates of every record

    @classmethod
    def of(
        cls,
        simulator: Simulator,
        space: Space,
        drives: Mapping[str, Drive],
        index: Mapping[tuple[str, str], np.ndarray],
        measured: Mapping[tuple[str, str], np.ndarray],
    ) -> "BatchedRecords":
        """`index` and `measured` give, for every record and output, the scored samples and their values."""
        outputs, names = simulator.vector.outputs, tuple(drives)
        ranges = tuple(_widened(space.range(d.parameter)) for d in simulator.vector.model.delays)
        tracks = []
        for name in names:
            n = len(drives[name].t)
            y, scored = [np.zeros(n) for _ in outputs], [np.zeros(n, bool) for _ in outputs]
            for i, output in enumerate(outputs):
                places = drives[name].places(index[name, output])
                y[i][places], scored[i][places] = measured[name, output], True
            tracks.append(Track(drives[name], tuple(y), tuple(scored), ranges))
        linear = [c in simulator.interpolated for c in simulator.vector.model.inputs]
        linear += [d.input in simulator.interpolated for d in simulator.vector.model.delays]
        rows = make_schedule(tracks, linear)
        scored = tuple(tuple(drives[name].places(np.asarray(index[name, o])) for o in outputs) for name in names)
        few_edges = Batch(simulator, rows.windows).few_edges(rows.chunks)
        whole = make_rows(tracks, linear) if few_edges and filled(tracks) else None
        return cls(
            simulator, space, names, rows, whole, few_edges, scored, np.stack([space.local(name) for name in names])
        )

    def serves(self, other: "BatchedRecords") -> bool:
        """Whether functions compiled for these records serve the other's as well."""
        shapes = [jax.tree.map(np.shape, (b.rows.chunks, b.whole and b.whole.records)) for b in (self, other)]
        return shapes[0] == shapes[1] and pickle.dumps(self.compiled_in) == pickle.dumps(other.compiled_in)

    @property
    def compiled_in(self) -> Any:
        """Which rows are scored and where they lie: records of other lengths may lie elsewhere though the same
        samples are scored."""
        whole = self.whole and self.whole.compiled_in
        return self.names, self.rows.windows, self.few_edges, whole, self.scored, self.picked, self.local

    def with_simulator(self, simulator: Simulator) -> "BatchedRecords":
        """The same records with other steps."""
        return dataclasses.replace(self, simulator=simulator)

    def arguments(self, data: Mapping[str, Any]) -> Numbers:
        """The pytree that the functions below take; "weight" of `data` are those of the records' squares, 1 without."""
        first, weights = [data["drive"][n] for n in self.names], data.get("weight")
        numbers = Numbers(
            self.rows.chunks,
            self.whole and self.whole.records,
            self.whole and self.whole.steps_first,
            tuple(np.array(v) for v in zip(*(d.first_input for d in first), strict=True)),
            tuple(np.array(v) for v in zip(*(d.first_output for d in first), strict=True)),
            tuple(np.asarray(data["scale"][o]) for o in self.simulator.vector.outputs),
            None if weights is None else np.array([weights[n] for n in self.names]),
        )
        with jax.ensure_compile_time_eval():  # a search may ask for them first inside a program of its own
            return jax.device_put(numbers)

    @property
    def recordings(self) -> list[tuple[str, ...]]:
        """Every recording is a block of its own."""
        return [(n,) for n in self.names]

    @property
    def local_dimension(self) -> int:
        """Coordinates that the residuals of one recording are derived by."""
        return self.local.shape[1]

    @property
    def count(self) -> int:
        """Scored samples of all outputs."""
        return sum(len(i) for record in self.scored for i in record)

    @cached_property
    def picked(self) -> tuple[tuple[np.ndarray, ...], ...]:
        """Per record and output: flat places in `rows` of what is scored."""
        return tuple(
            tuple(place[i] for i in record) for place, record in zip(self.rows.place, self.scored, strict=True)
        )

    # -- pure functions of a cube point -------------------------------------------------------------

    def cost(self, z: Any, numbers: Numbers, *, reverse: bool = False) -> Any:
        """Mean squared scaled residual at a cube point (d,), chunk by chunk; differentiable only with `reverse`, and
        backwards."""
        p, x0 = self._start(z[self.local], numbers)
        squares = Batch(self.simulator, self.rows.windows).squares(p, x0, numbers.rows, numbers.weight, reverse=reverse)
        return self._mean(squares, numbers)

    def costs(self, zs: Any, numbers: Numbers) -> Any:
        """Costs (n,) of cube points (n, d)."""

        def costs(z):
            # of few candidates, rows of chunks have fewer idle lanes
            if self.whole is not None and not self.whole.together(z.shape[0]):
                with contextlib.suppress(NativeUnsupported):
                    return self._of_whole_records(self.whole, z, numbers)
            return jax.vmap(lambda z: self.cost(z, numbers))(z)

        return _in_groups(costs, zs, WIDE)

    def values_and_gradients(self, zs: Any, numbers: Numbers) -> tuple[Any, Any]:
        """Costs (n,) and gradients (n, d)."""

        def pulled(costs, z):
            found, pull = jax.vjp(costs, z)
            return found, pull(jnp.ones_like(found))[0]

        def pushed(z):
            r, slopes = self.residuals_and_jacobian(z, numbers)
            return r @ r / self.count, 2.0 / self.count * (r @ slopes)

        def both(z):
            whole = self.whole
            if whole is not None:
                with contextlib.suppress(NativeUnsupported):
                    return pulled(lambda z: self._of_whole_records(whole, z, numbers), z)
            if self.simulator.vector.model.frictions and self.simulator.vector.model.events:
                return jax.lax.map(pushed, z)  # jax has no reverse mode for steps of the one within steps of the other
            return pulled(jax.vmap(lambda z: self.cost(z, numbers, reverse=True)), z)

        return _in_groups(both, zs, WIDE_GRADIENTS)

    def _of_whole_records(self, whole: RecordRows, zs: Any, numbers: Numbers) -> Any:
        """Costs (n,) by one native loop, differentiable backwards; raises NativeUnsupported, also where it is
        derived."""
        p, x0 = jax.vmap(lambda z: self._start(z[self.local], numbers), out_axes=-1)(zs)
        p = jax.tree.map(lambda a: jnp.moveaxis(a, 0, -2), p)
        together = whole.together(zs.shape[0])
        records = numbers.steps_first if together else numbers.records
        squares = squares_of_records(
            self.simulator, whole.windows, p, x0, records, numbers.weight, steps_first=together
        )
        return self._mean(squares, numbers)

    def _mean(self, squares: tuple[Any, ...], numbers: Numbers) -> Any:
        """The cost of squares of all outputs."""
        count = self.count if numbers.count is None else numbers.count
        return sum(s / scale**2 for s, scale in zip(squares, numbers.scale, strict=True)) / count

    def residuals(self, z: Any, numbers: Numbers) -> Any:
        """Scaled residuals (m,), recording by recording, output by output."""
        if self.whole is not None and self.whole.even:
            with contextlib.suppress(NativeUnsupported):
                return self._all_at_once(self.whole, z[self.local], numbers)
        placed = [r.reshape(-1) / s for r, s in zip(self._placed(z[self.local], numbers), numbers.scale, strict=True)]
        roots = self._roots(numbers)
        return jnp.concatenate(
            [
                jnp.take(r, i) * w
                for record, w in zip(self.picked, roots, strict=True)
                for r, i in zip(placed, record, strict=True)
            ]
        )

    def blocks(self, z: Any, numbers: Numbers) -> list[tuple[Any, Any]]:
        """For every record its scaled residuals (m_k,) and their derivatives (m_k, q) by its local coordinates."""
        if self.whole is not None and self.whole.even:
            with contextlib.suppress(NativeUnsupported):
                return self._side_by_side(self.whole, z[self.local], numbers)
        r, columns = (self._pulled if self.few_edges else self._pushed)(z[self.local], numbers)
        return [
            (
                jnp.concatenate([jnp.take(a, i) * w for a, i in zip(r, record, strict=True)]),
                jnp.concatenate([jnp.take(a, i, axis=0) @ (by * w) for a, i in zip(columns, record, strict=True)]),
            )
            for record, by, w in zip(
                self.picked, self._makers(z[self.local], numbers), self._roots(numbers), strict=True
            )
        ]

    def only(self, numbers: Numbers, wanted: np.ndarray) -> Numbers:
        """Numbers with which `_side_by_side` derives no interval of records that are not `wanted`."""
        if numbers.records is None:
            return numbers
        used = np.where(wanted, np.asarray(numbers.records.used), 0)  # by numpy, which compiles nothing
        return numbers._replace(records=numbers.records._replace(used=used))

    def _side_by_side(self, whole: RecordRows, local, numbers: Numbers) -> list[tuple[Any, Any]]:
        """`blocks` of whole records; raises NativeUnsupported."""
        q = local.shape[1]

        def directions(z, *first):
            return jax.vmap(lambda e: jax.jvp(lambda z: self._begin(z, *first), (z,), (e,))[1])(jnp.eye(q))

        p, x0 = self._start(local, numbers)
        moved = jax.vmap(directions)(local, numbers.first_input, numbers.first_output)
        r, slopes = slopes_of_records(self.simulator, whole.windows, p, x0, moved, numbers.records, numbers.steps_first)
        scale = self._row_scales(numbers)
        return [
            (
                jnp.concatenate([_at(a[:, k], i) * s[k] for a, i, s in zip(r, record, scale, strict=True)]),
                jnp.concatenate([_at(a[k], i) * s[k] for a, i, s in zip(slopes, record, scale, strict=True)]),
            )
            for k, record in enumerate(self.scored)
        ]

    def _all_at_once(self, whole: RecordRows, local, numbers: Numbers) -> Any:
        """The residuals that `_side_by_side` gives; raises NativeUnsupported."""
        p, x0 = self._start(local, numbers)
        r = residuals_of_records(self.simulator, whole.windows, p, x0, numbers.steps_first)
        scale = self._row_scales(numbers)
        return jnp.concatenate(
            [
                _at(a[:, k], i) * s[k]
                for k, record in enumerate(self.scored)
                for a, i, s in zip(r, record, scale, strict=True)
            ]
        )

    def _row_scales(self, numbers: Numbers) -> list[Any]:
        """By output, what the residuals of every record are multiplied by (L,)."""
        return [self._roots(numbers) / s for s in numbers.scale]

    def _roots(self, numbers: Numbers) -> Any:
        """What the residuals of every record are multiplied by (L,)."""
        return np.ones(len(self.names)) if numbers.weight is None else jnp.sqrt(numbers.weight)

    def _makers(self, local, numbers: Numbers):
        """(L, e, q): derivatives of all entries of parameters and initial states by the local coordinates."""
        if not self.few_edges:
            return jnp.broadcast_to(jnp.eye(local.shape[1]), (len(local), local.shape[1], local.shape[1]))

        def flat(z, first_input, first_output):
            return jnp.concatenate([jnp.ravel(a) for a in jax.tree.leaves(self._begin(z, first_input, first_output))])

        return jax.vmap(jax.jacfwd(flat))(local, numbers.first_input, numbers.first_output)

    def _pulled(self, local, numbers: Numbers):
        """Per output: scaled residuals (MCR,) and derivatives (MCR, e) by all entries of parameters and initial
        states."""
        p, x0 = self._start(local, numbers)
        residuals, slopes = Batch(self.simulator, self.rows.windows).slopes(p, x0, numbers.rows)

        def matrix(tree):
            parts = [a.reshape(*a.shape[:3], -1) for a in jax.tree.leaves(tree)]  # (M, R, C, e)
            return jnp.swapaxes(jnp.concatenate(parts, axis=-1), 1, 2)

        return (
            [r.reshape(-1) / s for r, s in zip(residuals, numbers.scale, strict=True)],
            [(a := matrix(tree)).reshape(-1, a.shape[-1]) / s for tree, s in zip(slopes, numbers.scale, strict=True)],
        )

    def _pushed(self, local, numbers: Numbers):
        """Per output: scaled residuals (MCR,) and derivatives (MCR, q) by the local coordinates, in forward mode."""

        def along(direction):
            moved = jnp.broadcast_to(direction, local.shape)
            return jax.jvp(lambda v: self._placed(v, numbers), (local,), (moved,))

        r, columns = jax.vmap(along, out_axes=(None, 0))(jnp.eye(local.shape[1]))
        return (
            [a.reshape(-1) / s for a, s in zip(r, numbers.scale, strict=True)],
            [a.reshape(local.shape[1], -1).T / s for a, s in zip(columns, numbers.scale, strict=True)],
        )

    def residuals_and_jacobian(self, z: Any, numbers: Numbers) -> tuple[Any, Any]:
        """Residuals (m,) and dense derivatives (m, d)."""
        blocks = self.blocks(z, numbers)
        dense = [
            jnp.zeros((r.shape[0], self.space.dimension)).at[:, own].set(j)
            for (r, j), own in zip(blocks, self.local, strict=True)
        ]
        return jnp.concatenate([r for r, _ in blocks]), jnp.concatenate(dense)

    # -- inside -------------------------------------------------------------------------------------

    def _begin(self, z, first_input, first_output):
        """Parameters and initial states of one record from its local coordinates (q,)."""
        own = self.space.of_one_recording()
        p = own.tree(own.physical(z))
        return self.simulator.positional(p), self.simulator.initial(p, first_input, first_output)

    def _start(self, local, numbers: Numbers):
        """Parameters (L, ...) and initial states (L,) of all records, from local coordinates (L, q)."""
        return jax.vmap(self._begin)(local, numbers.first_input, numbers.first_output)

    def _placed(self, local, numbers: Numbers):
        p, x0 = self._start(local, numbers)
        return Batch(self.simulator, self.rows.windows).residuals(p, x0, numbers.rows)


def _in_groups(function: Any, zs: Any, most: int) -> Any:
    """`function` of cube points (n, d), of at most so many at once."""
    whole, rest = divmod(zs.shape[0], most)
    if not whole or (whole == 1 and not rest):
        return function(zs)
    grouped = jax.lax.map(function, zs[: whole * most].reshape(whole, most, -1))
    first = jax.tree.map(lambda a: a.reshape(whole * most, *a.shape[2:]), grouped)
    return (
        first if not rest else jax.tree.map(lambda a, b: jnp.concatenate([a, b]), first, function(zs[whole * most :]))
    )


def _at(a: Any, samples: np.ndarray) -> Any:
    """`a` (K, ...) at these samples, as a slice where they follow one another."""
    first = int(samples[0]) if len(samples) else 0
    following = np.array_equal(samples, first + np.arange(len(samples)))
    return a[first : first + len(samples)] if following else jnp.take(a, samples, axis=0)


def _widened(bounds: tuple[float, float]) -> tuple[float, float]:
    """A little more, for rounding."""
    low, high = bounds
    margin = 1e-9 * (high - low)
    return low - margin, high + margin
