"""Dead time of a plant's inputs in a sampled loop: held inputs that act late, by any time, not only by whole samples.

An input held over the samples and late by Td = (d + f) h, 0 <= f < 1, is over sample k

    u[k - d - 1] until the share f of it,  u[k - d] after that

(Astrom, Wittenmark, Computer-Controlled Systems, 3rd ed., section 2.3), so that a step of the plant is cut there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.models.model import Model
from plantfit.models.parts.tables import Table
from plantfit.simulate.steps.vector import VectorModel

import jax.numpy as jnp
from jax import lax
from jax.core import Tracer

ROUNDING = 1e-9  # of a sample: dead times nearer to a whole number of samples are that number


class Piece(NamedTuple):
    """A part of a sample over which the delayed inputs rest: where it begins and how long it is, shares; their
    values by channel."""

    begin: Any
    length: Any
    late: Mapping[int, Any]


@dataclass(frozen=True)
class Late:
    """A delayed copy of a driven input: places of its channel, of the input among the driven ones and of the
    parameter."""

    channel: int
    input: int
    parameter: int
    name: str
    table: Table | None  # of the dead time over the input, where it is not one number


@dataclass(frozen=True)
class DeadTimes:
    """All of a plant's, `samples` long at most; `pieces` is how many parts a sample has."""

    late: tuple[Late, ...]
    period: float
    samples: int

    @property
    def pieces(self) -> int:
        return len(self.late) + 1

    @property
    def fixed(self) -> bool:
        """Whether every dead time is one number for the whole run."""
        return all(one.table is None for one in self.late)

    def seconds(self, p: tuple[Any, ...], u: tuple[Any, ...]) -> list[Any]:
        """Dead times (s) at the parameters p and the inputs u of now."""
        return [
            p[one.parameter] if one.table is None else one.table(p[one.parameter], u[one.input]) for one in self.late
        ]

    def shares(self, p: tuple[Any, ...], u: tuple[Any, ...]) -> tuple[list[Any], list[Any]]:
        """(d, f) of every dead time, d + f in samples."""
        counts = [jnp.asarray(s) / self.period for s in self.seconds(p, u)]
        whole = [jnp.floor(c + ROUNDING) for c in counts]
        return whole, [jnp.maximum(c - w, 0.0) for c, w in zip(counts, whole, strict=True)]

    def edges(self, shares: list[Any]) -> list[Any]:
        """Where the pieces of a sample begin, and its end, as shares."""
        return [0.0, *jnp.sort(jnp.stack(shares)), 1.0]

    def begin(self, u: tuple[Any, ...]) -> tuple[Any, ...]:
        """The rings of past inputs, at rest at u."""
        return tuple(jnp.full(self.samples + 2, jnp.asarray(u[i], dtype=float)) for i in self._inputs)

    def push(
        self, rings: tuple[Any, ...], k: Any, u: tuple[Any, ...], p: tuple[Any, ...]
    ) -> tuple[tuple[Any, ...], list[Piece]]:
        """The rings with the inputs u of sample k, and that sample in pieces. A dead time too long for them gives
        nan."""
        size = self.samples + 2
        rings = tuple(
            lax.dynamic_update_index_in_dim(ring, jnp.asarray(u[i], dtype=float), k % size, 0)
            for ring, i in zip(rings, self._inputs, strict=True)
        )
        whole, shares = self.shares(p, u)
        before, after = [], []
        for one, d in zip(self.late, whole, strict=True):
            ring, back = rings[self._inputs.index(one.input)], jnp.clip(d, 0, self.samples).astype(int)
            known = (d >= 0) & (d <= self.samples)
            before.append(jnp.where(known, ring[(k - back - 1) % size], jnp.nan))
            after.append(jnp.where(known, ring[(k - back) % size], jnp.nan))
        edges, pieces = self.edges(shares), []
        for begin, end in pairwise(edges):
            values = {
                one.channel: jnp.where(begin >= f, a, b)
                for one, f, b, a in zip(self.late, shares, before, after, strict=True)
            }
            pieces.append(Piece(begin, end - begin, values))
        return rings, pieces

    def check(self, model: Model, p: tuple[Any, ...]) -> None:
        """SimulationError for dead times known now that are negative or too long."""
        for one in self.late:
            value = p[one.parameter]
            if isinstance(value, Tracer):
                continue
            if not np.all((np.asarray(value) >= 0) & (np.asarray(value) < (self.samples + 1) * self.period)):
                raise SimulationError(
                    f"Plant {model.name!r}: the dead time {one.name!r} is {np.asarray(value).tolist()}; "
                    f"the loop keeps inputs for {self.samples * self.period:g} s, give it a "
                    "longest_delay that is enough, and times of 0 s or more."
                )

    @property
    def _inputs(self) -> tuple[int, ...]:
        return tuple(dict.fromkeys(one.input for one in self.late))


def dead_times_of(
    vector: VectorModel, inputs: tuple[str, ...], period: float, longest: float | None
) -> DeadTimes | None:
    """Of a plant whose `inputs` a loop drives; None without any. `longest` (s) is that of the parameters' bounds
    where it is None."""
    model = vector.model
    if not model.delays:
        return None
    late, bounds = [], [0.0 if longest is None else longest]
    for delay in model.delays:
        if delay.input not in inputs:
            raise SimulationError(
                f"Plant {model.name!r} delays {delay.input!r}, which this loop does not "
                "drive; give that input already delayed, to a plant without that delay."
            )
        declared = model.declared(delay.parameter)
        if longest is None:
            most = (
                declared.value
                if declared.value is not None
                else declared.bounds[1]
                if declared.bounds is not None
                else None
            )
            if most is None:
                raise SimulationError(
                    f"Plant {model.name!r}: nothing says how long the dead time "
                    f"{delay.parameter!r} may be; give closed_loop a longest_delay in seconds."
                )
            bounds.append(float(np.max(most)))
        late.append(
            Late(
                vector.channels.index(delay.channel),
                inputs.index(delay.input),
                vector.parameters.index(delay.parameter),
                delay.parameter,
                next((t for t in model.tables if t.name == delay.parameter), None),
            )
        )
    if not (np.isfinite(max(bounds)) and (longest is None or longest >= 0)):
        raise SimulationError(f"longest_delay = {longest}; give the longest dead time in seconds, 0 or more.")
    return DeadTimes(tuple(late), period, int(np.ceil(max(bounds) / period - ROUNDING)))
