"""Where the samples of inputs stand among the numbers that a compiled problem takes, so that other inputs are written
there alone.

Preparing a recording takes twenty times as long as simulating it, and a diagnosis simulates some hundred changed
inputs.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.problem.problem import Problem

import jax

Inputs = Mapping[str, Mapping[str, np.ndarray]]  # recording -> input -> values (n,)


@dataclass(frozen=True)
class InputPlaces:
    """`leaves` of the numbers as they are, and for every leaf that holds samples of inputs which flat places take
    which sample of all inputs one after the other, in the order of `inputs`."""

    structure: Any
    leaves: tuple[Any, ...]
    places: Mapping[int, tuple[np.ndarray, np.ndarray]]
    inputs: Inputs

    @classmethod
    def of(cls, problem: Problem, inputs: Inputs, prepared: Callable[[Inputs], Any]) -> "InputPlaces | None":
        """None where samples of inputs are not simply copied: with inputs that go in straight lines, or late ones whose
        edges move.

        `prepared` gives the numbers of other inputs, the slow way: it is asked twice, for which sample stands where,
        and whether that is all.
        """
        leaves, structure = jax.tree.flatten(problem.arguments)
        count = sum(len(v) for own in inputs.values() for v in own.values())
        order = np.random.default_rng(0).permutation(count)
        first, second = order + 0.5, (order + 1) % max(count, 2) + 0.5  # every sample differs between the two
        asked, other = (jax.tree.flatten(prepared(_cut(v, inputs))) for v in (first, second))
        if asked[1] != structure or other[1] != structure:
            return None
        sample = np.empty(count, dtype=int)
        sample[order] = np.arange(count)
        places: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for i, (base, seen, again) in enumerate(zip(leaves, asked[0], other[0], strict=True)):
            base, seen, again = (np.asarray(a) for a in (base, seen, again))
            if base.shape != seen.shape or base.shape != again.shape:
                return None
            moved = (
                np.flatnonzero((seen != again).ravel() & ~(np.isnan(seen) & np.isnan(again)).ravel())
                if base.dtype.kind == "f"
                else np.zeros(0, dtype=int)
            )
            if len(moved):
                value = seen.ravel()[moved]
                if np.any((value < 0) | (value >= count) | (value != np.floor(value) + 0.5)):
                    return None
                places[i] = moved, sample[np.floor(value).astype(int)]
        found = cls(structure, tuple(leaves), places, inputs)
        for values, truth in ((_cut(second, inputs), other[0]), (inputs, leaves)):
            if not all(map(_same, jax.tree.leaves(found.filled(values)), truth)):
                return None
        return found

    def filled(self, inputs: Inputs) -> Any:
        """The numbers with other values of some inputs, recording -> input -> values (n,)."""
        values = np.concatenate(
            [inputs.get(n, {}).get(u, v) for n, own in self.inputs.items() for u, v in own.items()] or [np.zeros(0)]
        )
        leaves = list(self.leaves)
        for i, (place, sample) in self.places.items():
            leaf = np.array(leaves[i])
            leaf.reshape(-1)[place] = values[sample]
            leaves[i] = leaf
        return jax.tree.unflatten(self.structure, leaves)


def _same(a: Any, b: Any) -> bool:
    a, b = np.asarray(a), np.asarray(b)
    return np.array_equal(a, b, equal_nan=b.dtype.kind == "f")


def _cut(values: np.ndarray, inputs: Inputs) -> dict[str, dict[str, np.ndarray]]:
    """Values of all inputs one after the other, by recording and input."""
    made, at = {}, 0
    for n, own in inputs.items():
        made[n] = {}
        for u, v in own.items():
            made[n][u], at = values[at : at + len(v)], at + len(v)
    return made
