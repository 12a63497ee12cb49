"""Tables over operating points: a parameter of one value for each node, linear between, clamped outside."""

from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.errors import ModelError
from plantfit.models.parts.tangents import still

# isort: split
import jax
import jax.numpy as jnp

Nodes = Sequence[float] | np.ndarray


@dataclass(frozen=True)
class Table:
    """Values over one signal or two: `over` names them, `nodes` holds their operating points, increasing.

    `unit` is that of the values. Raises ModelError for nodes that cannot be used.
    """

    name: str
    over: tuple[str, ...]
    nodes: tuple[tuple[float, ...], ...]
    unit: str | None = None

    def __post_init__(self) -> None:
        if len(self.over) not in (1, 2) or len(self.nodes) != len(self.over):
            raise ModelError(
                f"Table {self.name!r} is over {list(self.over)} with {len(self.nodes)} lists of nodes; "
                "give one or two signals and one list of nodes for each."
            )
        for signal, nodes in zip(self.over, self.nodes, strict=True):
            _check_nodes(self.name, signal, nodes)

    @property
    def shape(self) -> tuple[int, ...]:
        """(n,), or (ny, nu) over two signals."""
        return tuple(len(nodes) for nodes in self.nodes)

    @property
    def kinks(self) -> tuple[tuple[float, ...], ...]:
        """By signal where the slope may jump."""
        return self.nodes

    def __call__(self, values: Any, *at: Any) -> Any:
        """The value at operating points: `values` of `shape`, one argument for each signal."""
        if len(at) == 1:
            return lookup(values, self.nodes[0], *at)
        return lookup2(values, (self.nodes[0], self.nodes[1]), *at)


@dataclass(frozen=True)
class Cycle(Table):
    """A table over time that begins anew after each `period` (s): the smoothest curve through its even values.

    With n values it is the sum of harmonics up to n/2 that interpolates them (trigonometric interpolation; Henrici,
    Applied and Computational Complex Analysis 3, 1986, section 13.6):

        y(t) = sum_i v_i D(2 pi (t - t_i)/period),  D(a) = (1 + 2 sum_{0 < k < n/2} cos(k a) [+ cos(n a/2), n even])/n
    """

    period: float = 1.0

    @property
    def kinks(self) -> tuple[tuple[float, ...], ...]:
        """None: it is smooth."""
        return ((),)

    def __call__(self, values: Any, *at: Any) -> Any:
        """The value at times (s): `values` of `shape`."""
        count = self.shape[0]
        # as harmonics of time with weights that are linear in the values: cosines and sines are those of time alone
        orders = np.arange(count // 2 + 1)
        size = np.where((orders == 0) | (2 * orders == count), 1.0, 2.0) / count
        angle = 2.0 * np.pi / self.period * orders[:, None] * np.asarray(self.nodes[0])
        weights = _checked(values, self.shape)
        cosines, sines = (size[:, None] * np.cos(angle)) @ weights, (size[:, None] * np.sin(angle)) @ weights
        now = 2.0 * np.pi * jnp.mod(jnp.asarray(at[0]), self.period)[..., None] / self.period * orders
        return jnp.cos(now) @ cosines + jnp.sin(now) @ sines


def over_a_period(name: str, period: float, count: int, unit: str | None) -> Cycle:
    """A cycle with so many even nodes, at least two."""
    return Cycle(name, ("t",), (tuple(period * k / count for k in range(count)),), unit, period)


def lookup(values: Any, nodes: Nodes, x: Any) -> Any:
    """Piecewise linear in x through (nodes, values), clamped outside.

    `values` (n,), `nodes` (n,) fixed and increasing, `x` of any shape; gives the shape of x.

        y(x) = v_i + w (v_{i+1} - v_i),   w = (x - x_i)/(x_{i+1} - x_i)               (1)
        dy/dx = (v_{i+1} - v_i)/(x_{i+1} - x_i),  0 outside,  to the right at a node  (2)
        dy/dv_i = 1 - w,  dy/dv_{i+1} = w                                             (3)

    Forward, reverse and nested derivatives hold. NaN gives NaN. Raises ModelError for values of another shape.
    """
    known = _KNOWN.get()
    if known is not None and known.slopes:
        return _shared(_value_and_slope, values, tuple(nodes), x)[0]
    return _interpolated(_checked(values, (len(nodes),)), tuple(nodes), x)


def lookup2(values: Any, nodes: tuple[Nodes, Nodes], y: Any, u: Any) -> Any:
    """Bilinear in (y, u), clamped outside in each: `values` (ny, nu), `nodes` ((ny,), (nu,)).

    `y` and `u` broadcast. Within a cell it is eq. (1) of `lookup` by u, then by y; derivatives likewise.
    """
    values = _checked(values, (len(nodes[0]), len(nodes[1])))
    (i, in_y), (j, in_u) = _cell(nodes[0], y), _cell(nodes[1], u)
    corners = _corners(values, i, j)
    low = _between(corners[..., 0, 0], corners[..., 0, 1], in_u)
    high = _between(corners[..., 1, 0], corners[..., 1, 1], in_u)
    return _between(low, high, in_y)


def _checked(values: Any, shape: tuple[int, ...]) -> Any:
    values = _floats(values)
    if values.shape != shape:
        raise ModelError(
            f"A table with nodes of shape {shape} has values of shape {values.shape}; give one value for each node."
        )
    return values


def _floats(a: Any) -> Any:
    """As float64, the same object where it is."""
    return a if isinstance(a, jax.Array) and a.dtype == np.float64 else jnp.asarray(a, dtype=float)


@partial(jax.custom_jvp, nondiff_argnums=(1,))
def _value_and_slope(values: Any, nodes: tuple[float, ...], x: Any) -> tuple[Any, Any]:
    """Eq. (1) and (2) of `lookup`."""
    ends, (_, weight) = _ends(values, nodes, x)
    return _between(*ends, weight), _density(nodes, x) * (ends[1] - ends[0])


@partial(_value_and_slope.defjvp, symbolic_zeros=True)
def _value_and_slope_moved(nodes: tuple[float, ...], primals: Any, tangents: Any) -> Any:
    # what is looked up once is pulled back once, and both by one difference of the ends
    (values, x), (along_values, along_x) = primals, tangents
    found = y, slope = _shared(_value_and_slope, values, nodes, x)
    moved_y, moved_slope = jnp.zeros_like(y), jnp.zeros_like(slope)
    if not still(along_values):
        (low, high), (_, weight) = _ends(along_values, nodes, x)
        rise = high - low
        moved_y, moved_slope = low + weight * rise, _density(nodes, x) * rise
    if not still(along_x):
        moved_y = slope * along_x if still(along_values) else slope * along_x + moved_y
    return found, (moved_y, moved_slope)


def _interpolated(values: Any, nodes: tuple[float, ...], x: Any) -> Any:
    ends, (_, weight) = _ends(values, nodes, x)
    return _between(*ends, weight)


def _ends(values: Any, nodes: tuple[float, ...], x: Any) -> tuple[tuple[Any, Any], tuple[Any, Any]]:
    """The values at both ends of the cell that x lies in, and that cell as `_cell` gives it."""
    cell = _cell(nodes, x)
    ends = _corners(values, cell[0])
    return (ends[..., 0], ends[..., 1]), cell


def _between(left: Any, right: Any, weight: Any) -> Any:
    return left + weight * (right - left)


def _corners(values: Any, *index: Any) -> Any:
    """The entries around a cell, (..., 2) or (..., 2, 2), in one gather.

    The promise drops bounds checks, also from its transpose, a scatter-add of such windows; over 24 000
    steps on a CPU that was two to three times faster than sums over one-hot weights.
    """
    start = jnp.stack(jnp.broadcast_arrays(*index), axis=-1)
    signals, batch = len(index), start.ndim - 1
    numbers = jax.lax.GatherDimensionNumbers(
        offset_dims=tuple(range(batch, batch + signals)), collapsed_slice_dims=(), start_index_map=tuple(range(signals))
    )
    return jax.lax.gather(values, start, numbers, slice_sizes=(2,) * signals, mode="promise_in_bounds")


def _cell(nodes: Nodes, x: Any) -> tuple[Any, Any]:
    """(index, weight): the cell that x lies in, and where in it, 0 to 1; d weight/dx = 0 outside of the table."""

    def found():
        grid, at = np.asarray(nodes, dtype=float), _floats(x)
        index, inside = _even_cell(grid, at) if _is_even(grid) else _uneven_cell(grid, at)
        return index, jnp.where(at >= grid[-1], 1.0, jnp.where(at < grid[0], 0.0, inside))

    return _once(("cell", tuple(nodes), id(x)), x, found)


def _density(nodes: Nodes, x: Any) -> Any:
    """d weight/dx of `_cell`."""

    def found():
        grid, at = np.asarray(nodes, dtype=float), _floats(x)
        steps = np.diff(grid)
        density = (
            jnp.asarray(1.0 / steps).at[_cell(nodes, x)[0]].get(mode="promise_in_bounds")
            if not _is_even(grid)
            else _rate(grid)
        )
        return jnp.where(at >= grid[-1], 0.0, jnp.where(at < grid[0], 0.0, density))

    return _once(("density", tuple(nodes), id(x)), x, found)


class _Known(dict[Any, tuple[Any, Any]]):
    """What has been looked up, with the objects it was looked up with, so that no others get their ids."""

    def __init__(self, slopes: bool):
        super().__init__()
        self.slopes = slopes


@contextmanager
def shared_lookups(share: bool = True, slopes: bool = False) -> Generator[None]:
    """Within, tables over the same nodes look up their place at the same value once, also where derivatives are taken
    backwards.

    With `slopes` a table is read once for values and slopes in all directions; for functions whose arrays are jax's
    own. Without `share` nothing is shared: for functions with control flow that read the same value inside a branch and
    outside of it.
    """
    before = _KNOWN.get()
    token = _KNOWN.set((_Known(slopes) if before is None else before) if share else None)
    try:
        yield
    finally:
        _KNOWN.reset(token)


_KNOWN: ContextVar[_Known | None] = ContextVar("lookups", default=None)


def _once(key: Any, objects: Any, compute: Callable[[], Any]) -> Any:
    known = _KNOWN.get()
    if known is None:
        return compute()
    if key not in known:
        known[key] = objects, compute()
    return known[key][1]


def _shared(function: Callable, values: Any, nodes: tuple[float, ...], x: Any) -> Any:
    """function(values, nodes, x) with the array checked, once for the same objects."""
    key = function, nodes, id(values), id(x)
    return _once(key, (values, x), lambda: function(_checked(values, (len(nodes),)), nodes, _floats(x)))


def _even_cell(grid: np.ndarray, x: Any) -> tuple[Any, Any]:
    cells = len(grid) - 1
    position = (x - grid[0]) * _rate(grid)
    # a node that rounding puts a hair below its number still opens the cell on its right
    number = jnp.clip(jnp.floor(position + _rounding(grid) * _rate(grid)), 0, cells - 1)
    return number.astype(jnp.int32), position - number


def _uneven_cell(grid: np.ndarray, x: Any) -> tuple[Any, Any]:
    index = jnp.sum(x[..., None] >= grid[1:-1], axis=-1, dtype=jnp.int32)
    start = jnp.asarray(grid[:-1]).at[index].get(mode="promise_in_bounds")
    density = jnp.asarray(1.0 / np.diff(grid)).at[index].get(mode="promise_in_bounds")
    return index, (x - start) * density


def _rate(grid: np.ndarray) -> float:
    """Cells per unit of an even grid."""
    return (len(grid) - 1) / (grid[-1] - grid[0])


def _rounding(grid: np.ndarray) -> float:
    return 16 * float(np.finfo(float).eps * np.max(np.abs(grid)))


def _is_even(grid: np.ndarray) -> bool:
    return bool(np.max(np.abs(grid - np.linspace(grid[0], grid[-1], len(grid)))) <= _rounding(grid))


def _check_nodes(name: str, signal: str, nodes: Sequence[float]) -> None:
    where = f"Table {name!r}: the nodes over {signal!r}"
    if len(nodes) < 2:
        raise ModelError(f"{where} are {len(nodes)}; give at least 2.")
    if not np.all(np.isfinite(nodes)):
        raise ModelError(f"{where} are {list(nodes)}; write finite numbers.")
    for k, (a, b) in enumerate(pairwise(nodes)):
        if a >= b:
            raise ModelError(
                f"{where} do not increase at number {k + 1} ({a:g}, then {b:g}); sort them and drop repeated ones."
            )
