"""Operations on small arrays as lines on numbers, and reads of a table at a place that is known when the lines run."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from plantfit.simulate.straight_line import Writer

_REDUCED = {
    "reduce_sum": "add",
    "reduce_max": "max",
    "reduce_min": "min",
    "reduce_and": "and",
    "reduce_or": "or",
    "reduce_prod": "mul",
}


class Held(NamedTuple):
    """An array: expressions of its entries, and the name under which the running text holds them in one flat tuple,
    if it does."""

    entries: np.ndarray
    name: str | None = None


class ArrayWriter(Writer):
    """A writer of plain Python in which an array is `Held`: its shape is known, its entries are lines of their own."""

    def number(self, value: Any) -> Any:
        array = np.asarray(value)
        if array.ndim == 0:
            return super().number(array)
        entries = np.empty(array.shape, dtype=object)
        for index in np.ndindex(*array.shape):
            entries[index] = super().number(array[index])
        return Held(entries)

    def operation(self, equation: Any, name: str, values: Sequence[Any]) -> list[Any]:
        arrays = any(isinstance(v, Held) for v in values) or any(v.aval.ndim for v in equation.outvars)
        if not arrays:
            return super().operation(equation, name, values)
        entries = [v.entries if isinstance(v, Held) else _scalar(v) for v in values]
        shape = equation.outvars[0].aval.shape
        if name in ("gather", "dynamic_slice"):
            return [_returned(self._read(equation, name, values))]
        if name in _SHAPED:
            return [_returned(_SHAPED[name](entries, equation.params, shape))]
        if name == "dot_general":
            return [_returned(self._product(entries, equation.params["dimension_numbers"]))]
        if name in _REDUCED:
            return [_returned(self._reduced(_REDUCED[name], entries[0], equation.params["axes"]))]
        spread, found = [np.broadcast_to(e, shape) for e in entries], np.empty(shape, dtype=object)
        for index in np.ndindex(*shape):
            found[index] = self.assigned(self.of_numbers(equation, name, [str(e[index]) for e in spread]))
        return [_returned(found)]

    def _reduced(self, name: str, entries: np.ndarray, axes: Sequence[int]) -> np.ndarray:
        kept = [k for k in range(entries.ndim) if k not in axes]
        moved = np.transpose(entries, [*kept, *axes]).reshape(*(entries.shape[k] for k in kept), -1)
        found = np.empty(moved.shape[:-1], dtype=object)
        for index in np.ndindex(*found.shape):
            found[index] = self._gathered(name, moved[index].tolist())
        return found

    def _gathered(self, name: str, row: Sequence[str]) -> str:
        found = row[0]
        for other in row[1:]:
            found = self.assigned(self.words[name].format(found, other))
        return found

    def _product(self, entries: Sequence[np.ndarray], numbers: Any) -> np.ndarray:
        """Sums over the contracted axes of two arrays, those of the first that are left in front."""
        (contracted, batch), rows = numbers, []
        if any(batch):
            raise self.refused("products of many matrices")
        for array, axes in zip(entries, contracted, strict=True):
            kept = [k for k in range(array.ndim) if k not in axes]
            rows.append(np.transpose(array, [*kept, *axes]).reshape(*(array.shape[k] for k in kept), -1))
        left, right = (row.shape[:-1] for row in rows)
        found = np.empty((*left, *right), dtype=object)
        for index in np.ndindex(*found.shape):
            pairs = zip(rows[0][index[: len(left)]], rows[1][index[len(left) :]], strict=True)
            found[index] = self._gathered("add", [self.assigned(f"{a}*{b}") for a, b in pairs])
        return found

    def _read(self, equation: Any, name: str, values: Sequence[Any]) -> np.ndarray:
        """A window (slice_sizes) of the first value, from a place that other values tell."""
        params, table = equation.params, values[0]
        sizes = params["slice_sizes"]
        if name == "dynamic_slice":
            limits = [n - size for n, size in zip(table.entries.shape, sizes, strict=True)]
            begin = [f"min(max(int({v}), 0), {limit})" for v, limit in zip(values[1:], limits, strict=True)]
        else:
            numbers, rank = params["dimension_numbers"], table.entries.ndim
            plain = numbers.offset_dims == tuple(range(rank)) == numbers.start_index_map
            if (
                not plain
                or numbers.collapsed_slice_dims
                or numbers.operand_batching_dims
                or values[1].entries.shape != (rank,)
            ):
                raise self.refused("reads of this kind from tables")
            begin = [f"int({v})" for v in values[1].entries]
        strides = [int(np.prod(table.entries.shape[k + 1 :])) for k in range(table.entries.ndim)]
        place = self.assigned(" + ".join(f"{stride}*{b}" for stride, b in zip(strides, begin, strict=True)))
        held = table.name or self.assigned(f"({', '.join(table.entries.reshape(-1))},)")
        found = np.empty(sizes, dtype=object)
        for index in np.ndindex(*sizes):
            found[index] = self.assigned(f"{held}[{place} + {sum(i * s for i, s in zip(index, strides, strict=True))}]")
        return found


def _scalar(value: str) -> np.ndarray:
    entries = np.empty((), dtype=object)
    entries[()] = value
    return entries


def _returned(entries: np.ndarray) -> Any:
    return Held(entries) if entries.ndim else entries.item()


def _sliced(entries: Sequence[np.ndarray], params: Any, shape: tuple[int, ...]) -> np.ndarray:
    strides = params["strides"] or (1,) * len(shape)
    return entries[0][tuple(map(slice, params["start_indices"], params["limit_indices"], strides))]


def _spread(entries: Sequence[np.ndarray], params: Any, shape: tuple[int, ...]) -> np.ndarray:
    whole = np.ones(len(shape), dtype=int)
    whole[list(params["broadcast_dimensions"])] = entries[0].shape
    return np.broadcast_to(entries[0].reshape(whole), shape)


_SHAPED: dict[str, Callable[[Sequence[np.ndarray], Any, tuple[int, ...]], np.ndarray]] = {
    "broadcast_in_dim": _spread,
    "concatenate": lambda e, p, _: np.concatenate(list(e), axis=p["dimension"]),
    "rev": lambda e, p, _: np.flip(e[0], p["dimensions"]),
    "reshape": lambda e, _, shape: e[0].reshape(shape),
    "slice": _sliced,
    "squeeze": lambda e, _, shape: e[0].reshape(shape),
    "stack": lambda e, p, _: np.stack(list(e), axis=p["axis"]),
    "transpose": lambda e, p, _: np.transpose(e[0], p["permutation"]),
}  # fmt: skip

__all__ = ["ArrayWriter", "Held"]
