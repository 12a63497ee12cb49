"""Rows of a filter for samples as they come, with the past inputs that dead times still need."""

from typing import NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.estimate.filters.state_space import Row, StateSpace

import jax
import jax.numpy as jnp


class Fed(NamedTuple):
    """Rows of new samples: channels (r, c) at both ends of each step, its length (r,), channels (r, c) at its end;
    `places` (b,) of the samples among them; slopes of the first three by each dead time, (d, r, c), (d, r, c) and
    (d, r)."""

    u0: np.ndarray
    u1: np.ndarray
    h: np.ndarray
    here: np.ndarray
    places: np.ndarray
    slopes: tuple[np.ndarray, np.ndarray, np.ndarray]

    def chunks(self, size: int, y: np.ndarray) -> list[tuple[Row, Row | None]]:
        """Rows with outputs (b, m) in chunks of one size, the last filled up with steps of no length, and their
        slopes (d first)."""
        r = len(self.h)
        seen = np.full((r, y.shape[1]), np.nan)
        seen[self.places] = y
        found = []
        for k in range(0, r, size):
            part, more = slice(k, k + size), max(0, k + size - r)
            end = np.repeat(self.here[-1:], more, axis=0)
            u0, u1, here = (np.concatenate([a[part], end]) for a in (self.u0, self.u1, self.here))
            none = np.full((more, y.shape[1]), np.nan)
            row = Row(
                u0, u1, np.concatenate([self.h[part], np.zeros(more)]), here, np.concatenate([seen[part], none]), None
            )
            moved = None
            if len(self.slopes[2]):
                m0, m1, mh = (
                    np.concatenate([a[:, part], np.zeros((len(a), more, *a.shape[2:]))], axis=1) for a in self.slopes
                )
                still = np.zeros((len(mh), size, y.shape[1]))
                moved = Row(m0, m1, mh, np.zeros_like(m0), still, None)
            found.append((row, moved))
        return found


class RowsOnLine:
    """What `StateSpace.rows` makes of a record, made of samples one after the other: an edge of a late input has a row
    of its own.

    `dead_times` (d,) in s are those of the model at parameter `values`, `by_values` (d, coordinates) their slopes by
    these.
    """

    def __init__(self, plant: StateSpace, values: np.ndarray):
        model, simulator = plant.model, plant.simulator
        names, own = list(model.inputs), list(dict.fromkeys(d.parameter for d in model.delays))
        self.linear = np.array(
            [n in simulator.interpolated for n in names] + [d.input in simulator.interpolated for d in model.delays]
        )
        self.input = np.array([*range(len(names)), *(names.index(d.input) for d in model.delays)], dtype=int)
        self.late = np.array([-1] * len(names) + [own.index(d.parameter) for d in model.delays], dtype=int)

        def dead(v):
            tree = plant.space.tree(v, plant.recording)
            return jnp.stack([jnp.asarray(tree[n], dtype=float) for n in own]) if own else jnp.zeros(0)

        at = jnp.asarray(values, dtype=float)
        self.dead_times, self.by_values = np.asarray(dead(at)), np.asarray(jax.jacfwd(dead)(at))
        self.reset()

    @property
    def longest(self) -> float:
        """The longest dead time in s."""
        return float(max(self.dead_times, default=0.0))

    def reset(self) -> None:
        """Forget all samples."""
        self.t, self.u = np.zeros(0), np.zeros((0, 0))
        self.last: float | None = None

    def remember(self, t: np.ndarray, u: np.ndarray) -> None:
        """Inputs (b, inputs) at times (b,) before the filter begins."""
        self.t, self.u = np.concatenate([self.t, t]), np.concatenate([self.u.reshape(-1, u.shape[1]), u])

    def first(self, t: float, u: np.ndarray) -> tuple[float, ...]:
        """All channels at the first sample of the filter."""
        self.remember(np.array([t]), u[None])
        found = self._at(np.array([t]), np.array([t]))[0][0]
        self.t, self.u = self.t[:-1], self.u[:-1]
        return tuple(found.tolist())

    def feed(self, t: np.ndarray, u: np.ndarray) -> Fed:
        """Rows of the next samples, times (b,) and inputs (b, inputs)."""
        start = float(t[0]) if self.last is None else self.last
        self.remember(t, u)
        changes = np.concatenate([np.zeros((1, u.shape[1]), bool), np.diff(self.u, axis=0) != 0.0])
        bends = changes | self.linear[: u.shape[1]]  # a held input has an edge where it changes
        edges = []
        for j, d in enumerate(self.dead_times):
            e = self.t[np.any(bends[:, self.input[self.late == j]], axis=1)] + d
            edges.append((e[(e > start) & (e <= t[-1])], j))
        times = np.concatenate([*(e for e, _ in edges), t])
        of = np.concatenate([*(np.full(len(e), j) for e, j in edges), np.full(len(t), -1)]).astype(int)
        order = np.argsort(times, kind="stable")  # an edge at a sample comes before it
        end, of = times[order], of[order]
        begin, of_begin = np.concatenate([[start], end[:-1]]), np.concatenate([[-1], of[:-1]])
        middle = 0.5 * (begin + end)
        (u0, slope), (u1, _), (here, _) = self._at(begin, middle), self._at(end, middle), self._at(end, end)
        which = np.arange(len(self.dead_times))[:, None]
        from_, to = (of_begin == which).astype(float), (of == which).astype(float)
        channel = np.concatenate([self.late, [-1]]) == which  # whether a channel is late by it
        moved = [slope * (side[:, :, None] - channel[:, None, :]) for side in (from_, to)]
        self.last = float(t[-1])
        keep = max(0, int(np.searchsorted(self.t, self.last - self.longest, side="right")) - 1)
        self.t, self.u = self.t[keep:], self.u[keep:]
        return Fed(u0, u1, end - begin, here, np.flatnonzero(of < 0), (moved[0], moved[1], to - from_))

    def _at(self, time: np.ndarray, piece: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Channels (r, c) at times (r,), each on the piece of its input that holds at `piece` (r,), and their slopes
        (r, c), 1/s."""
        dead = np.concatenate([[0.0], self.dead_times])[self.late + 1]
        k = np.searchsorted(self.t, piece[:, None] - dead, side="right") - 1
        before, k = k < 0, np.maximum(k, 0)
        after = np.minimum(k + 1, len(self.t) - 1)
        own, width = self.u[k, self.input], self.t[after] - self.t[k]
        goes = self.linear & ~before & (width > 0)
        slope = np.where(goes, (self.u[after, self.input] - own) / np.where(width > 0, width, 1.0), 0.0)
        values = own + slope * (time[:, None] - dead - self.t[k])
        return np.concatenate([values, time[:, None]], axis=1), np.concatenate([slope, np.ones((len(time), 1))], axis=1)
