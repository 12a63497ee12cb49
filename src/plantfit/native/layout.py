"""The layout of a batch: which axes become groups, which run in turn, and which become SIMD lanes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import plantfit.runtime  # noqa: F401

# isort: split
import jax
import jax.numpy as jnp

COPY = 16.0  # nodes that take as long as a number of step data that is copied between lanes
WHOLE = 1 / 8  # of that, for one copied as part of a whole row


@dataclass(frozen=True)
class Layout:
    """`group_axes` and `lane_axes` partition the axes of the batch; a block is `vectors` vectors of `width` lanes."""

    batch: tuple[int, ...]
    group_axes: tuple[int, ...]
    lane_axes: tuple[int, ...]
    width: int
    vectors: int

    @property
    def groups(self) -> int:
        return math.prod(self.batch[a] for a in self.group_axes)

    @property
    def lanes(self) -> int:
        return math.prod(self.batch[a] for a in self.lane_axes)

    @property
    def blocks(self) -> int:
        """Of a group."""
        return math.ceil(self.lanes / (self.width * self.vectors))

    @property
    def narrow(self) -> bool:
        """Whether a group does not fill one block; it ends in the last vector then, as layouts with fewer cost no
        more."""
        return self.lanes < self.width * self.vectors

    def over_groups(self, present: Sequence[bool]) -> bool:
        return any(present[a] for a in self.group_axes)

    def over_lanes(self, present: Sequence[bool]) -> bool:
        return any(present[a] for a in self.lane_axes)

    def arrange(self, a: Any, present: Sequence[bool], rows: bool) -> Any:
        """(present batch axes..., core...) to (core..., G, B), with `rows` to (G, core..., B); G and B are 1 where
        absent."""
        count = sum(present)
        place = {axis: i for i, axis in enumerate(x for x, p in enumerate(present) if p)}
        core = a.shape[count:]
        for axes in (self.group_axes, self.lane_axes):
            wanted = any(present[x] for x in axes)
            for axis in axes:
                if wanted and axis not in place:  # broadcast over the axes it lacks
                    a = jnp.broadcast_to(jnp.expand_dims(a, 0), (self.batch[axis], *a.shape))
                    place = {k: v + 1 for k, v in place.items()} | {axis: 0}
                    count += 1
        # one transposition, so that it vanishes where it undoes another
        over, beside = ([place[x] for x in axes if x in place] for axes in (self.group_axes, self.lane_axes))
        inner = range(count, a.ndim)
        a = jnp.transpose(a, (*over, *inner, *beside) if rows else (*inner, *over, *beside))
        groups = math.prod(self.batch[x] for x in self.group_axes if x in place)
        lanes = math.prod(self.batch[x] for x in self.lane_axes if x in place)
        return a.reshape(*((groups, *core, lanes) if rows else (*core, groups, lanes)))

    def buffer(self, core: tuple[int, ...], dtype: Any, rows: bool) -> Any:
        """Shape of a result as the kernel writes it."""
        shape = (self.groups, *core, self.lanes) if rows else (*core, self.groups, self.lanes)
        return jax.ShapeDtypeStruct(shape, dtype)

    def restore(self, a: Any, rank: int, rows: bool) -> Any:
        """The inverse of `arrange` for an array that varies over the whole batch."""
        core = a.shape[1:-1] if rows else a.shape[:-2]
        over, beside = ([self.batch[x] for x in axes] for axes in (self.group_axes, self.lane_axes))
        a = a.reshape(*((*over, *core, *beside) if rows else (*core, *over, *beside)))
        first = len(over) if rows else 0  # where the core begins
        inner = range(first, first + rank)
        outer = [i for i in range(a.ndim) if i not in inner]
        axes = (*self.group_axes, *self.lane_axes)
        return jnp.transpose(a, (*(outer[axes.index(x)] for x in range(len(self.batch))), *inner))


def choose_layout(
    batch: tuple[int, ...],
    present: Sequence[Sequence[bool]],
    rows: Sequence[bool],
    width: int,
    most: int,
    nodes: Callable[[Layout], tuple[int, int]],
    apart: Sequence[bool] = (),
    ys: int = 0,
) -> Layout:
    """The axes whose lanes cost least; the others become groups, and so do those that are `apart`.

    `nodes` counts what a step computes once for all lanes and what in every lane. Step data that vary over some of the
    lanes' axes, or of the groups', are copied over the others, and `ys` leaves of results are turned back where lanes
    are of several axes.
    """
    axes = tuple(range(len(batch)))
    data = [p for p, r in zip(present, rows, strict=True) if r]

    def cost(layout: Layout) -> float:
        sets = (layout.group_axes, layout.lane_axes)
        copied = ys * layout.groups * layout.lanes if len(layout.lane_axes) > 1 else 0
        for p in data:
            if any(0 < sum(p[a] for a in axes) < len(axes) for axes in sets):
                over_lanes = layout.over_lanes(p)
                copied += (layout.groups if layout.over_groups(p) else 1) * (layout.lanes if over_lanes else WHOLE)
        shared, own = nodes(layout)
        return layout.groups * layout.blocks * (shared + own * _time(layout.vectors)) + COPY * copied

    free = [a for a in axes if not (apart and apart[a])]
    subsets = (lanes for count in range(len(free), 0, -1) for lanes in combinations(free, count))
    layouts = [_with_lanes(batch, tuple(a for a in axes if a not in lanes), lanes, width, most) for lanes in subsets]
    return min(layouts, key=cost) if layouts else _with_lanes(batch, axes, (), width, most)


def _with_lanes(
    batch: tuple[int, ...], groups: tuple[int, ...], lanes: tuple[int, ...], width: int, most: int
) -> Layout:
    layouts = [Layout(batch, groups, lanes, width, vectors) for vectors in range(1, most + 1)]
    return min(layouts, key=lambda a: a.blocks * _time(a.vectors))


def _time(vectors: int) -> float:
    """Relative time of a block of so many vectors, as measured on loops of some hundred instructions: 4, 4, 5, 6."""
    return (2 + max(2, vectors)) / 4
