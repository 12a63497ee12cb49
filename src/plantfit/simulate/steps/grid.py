"""Where steps end: at every sample and wherever an edge of a delayed input falls.

The step lengths then depend smoothly on the delays, so that derivatives by a dead time are right
on the sample grid, off it and at bounds. Nothing is sorted: ranks follow from `searchsorted`.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401

import jax.numpy as jnp

FEW = 32_768  # comparisons that cost less than a search among so many


class Pieces(NamedTuple):
    """An input as straight pieces: value + slope (t - origin); piece i + 1 begins at `knots[i]` (s)."""

    value: Any  # (E + 1,)
    slope: Any  # (E + 1,)
    origin: Any  # (E + 1,) s
    knots: Any  # (E,) s


@dataclass(frozen=True)
class Held:
    """How an input goes on between samples: "previous" holds, "linear" interpolates."""

    PREVIOUS = "previous"
    LINEAR = "linear"


def delayed_pieces(t: np.ndarray, u: np.ndarray, hold: str, before: float) -> Pieces:
    """Pieces of a signal that was `before` ahead of its first sample; only real changes become knots."""
    if hold == Held.PREVIOUS:
        changed = np.flatnonzero(np.diff(u, prepend=before) != 0.0)
        value = np.r_[before, u[changed]]
        return Pieces(value, np.zeros_like(value), np.r_[t[0], t[changed]], t[changed])
    slope = np.diff(u) / np.diff(t) if len(t) > 1 else np.zeros(0)
    slope = np.r_[0.0, slope, 0.0]
    value = np.r_[before, u[:-1], u[-1]]
    jump = np.r_[before != u[0], np.zeros(len(t) - 1, bool)]
    keep = np.flatnonzero((np.diff(slope) != 0.0) | jump)
    pick = np.r_[0, keep + 1]
    return Pieces(value[pick], slope[pick], np.r_[t[0], t][pick], t[keep])


def sampled_pieces(t: np.ndarray, u: np.ndarray, hold: str) -> tuple[np.ndarray, np.ndarray]:
    """Value and slope of an undelayed input on every sample interval, both (N,)."""
    slope = np.zeros_like(u)
    if hold == Held.LINEAR and len(t) > 1:
        slope[:-1] = np.diff(u) / np.diff(t)
    return u, slope


class Steps(NamedTuple):
    """The merged grid: K steps and where the samples lie on it."""

    start: Any  # (K,) s
    length: Any  # (K,) s
    sample: Any  # (K,) last sample at or before the start of the step
    piece: tuple[Any, ...]  # per delayed channel (K,): its piece during the step
    rank: Any  # (N,) position of every sample among the K + 1 grid points


def _within(t: Any, edge: Any) -> Any:
    # not minimum and maximum: their derivative at a tie would be half of the right one
    return jnp.where(edge < t[0], t[0], jnp.where(edge < t[-1], edge, t[-1]))


def merge(t: Any, knots: tuple[Any, ...], delays: tuple[Any, ...]) -> Steps:
    """Merge sample times (N,) with the knots of every delayed channel moved by its delay (s).

    Knots outside the record end up at its first or last sample, in steps of length zero.
    """
    t = jnp.asarray(t)
    lists = [t, *(_within(t, k + d) for k, d in zip(knots, delays, strict=True))]
    ranks = []
    for i, own in enumerate(lists):
        rank = jnp.arange(own.shape[0])
        for j, other in enumerate(lists):
            if j != i:
                # ties: samples first, then the channels in order
                rank = rank + _counted(other, own, "right" if j < i else "left")
        ranks.append(rank)
    total = sum(x.shape[0] for x in lists)
    grid = t
    if len(lists) > 1:
        grid = jnp.zeros(total, t.dtype)
        for own, rank in zip(lists, ranks, strict=True):
            grid = grid.at[rank].set(own, unique_indices=True)
    pieces = tuple(_so_far(rank, total) for rank in ranks[1:])
    sample = jnp.arange(total - 1) - sum(pieces)  # every place of the grid is one of a list
    return Steps(grid[:-1], jnp.diff(grid), sample, pieces, ranks[0])


def _counted(values: Any, edges: Any, side: str) -> Any:
    """`searchsorted`; of few values by comparing all, which XLA compiles in a fifth of the time. The same whole
    numbers."""
    few = values.shape[0] * edges.shape[0] <= FEW
    return jnp.searchsorted(values, edges, side=side, method="compare_all" if few else "scan")


def _so_far(rank: Any, total: int) -> Any:
    """How many of the places `rank` are at or before each place of the grid but the last, (total - 1,)."""
    if rank.shape[0] * total <= FEW:
        return _counted(rank, jnp.arange(total - 1), "right")
    return jnp.cumsum(jnp.zeros(total, int).at[rank].set(1, unique_indices=True))[:-1]
