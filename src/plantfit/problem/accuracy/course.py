"""States along the steps of a record, one step after another, as a compiled loop over blocks of one length.

A mesh has another number of steps in every round of its making. A loop over all of them would be compiled anew for each
number, so it is compiled for one block of `BLOCK` steps, and records are worked off in such blocks, the last one filled
with steps of length 0.
"""

from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native.kept_programs import kept
from plantfit.native.scan import native_scan
from plantfit.simulate.steps.registry import STEPPERS
from plantfit.simulate.steps.vector import VectorModel

import jax
import jax.numpy as jnp

BLOCK = 256  # steps of one call: some 0.1 ms beside what they take


class Course:
    """The states of candidates along steps; compiled once for a number of candidates."""

    def __init__(self, vector: VectorModel, stepper: str):
        step = STEPPERS[stepper].step

        def block(x, u0, u1, length, values):
            def body(x, row):
                x = step(vector.rate, x, row[0], row[1], row[2], values, True, vector.pattern)
                x = tuple(jnp.asarray(v, dtype=float) for v in x)
                return x, x

            rows = tuple(u0.T), tuple(u1.T), length
            _, states = native_scan(body, tuple(x), rows, keep=True, fallback=True)
            return jnp.stack(states, axis=1)

        self.compiled = kept(jax.vmap(block), "course", (vector.model, stepper))

    def states(self, x0: np.ndarray, u0: np.ndarray, u1: np.ndarray, length: np.ndarray, values: Any) -> np.ndarray:
        """States (C, K + 1, n) at all ends of steps; from one on that cannot be taken they are not finite.

        From first states (C, n), inputs at both ends of the steps (C, K, c), lengths (C, K) in seconds and parameters,
        each (C, ...).
        """
        count, steps = length.shape
        found = np.empty((count, steps + 1, x0.shape[1]))
        found[:, 0], values = x0, jax.device_put(values)
        for begin in range(0, steps, BLOCK):
            stop = min(begin + BLOCK, steps)
            a, b, h = (_filled(v[:, begin:stop]) for v in (u0, u1, length))
            found[:, begin + 1 : stop + 1] = np.asarray(self.compiled(found[:, begin], a, b, h, values))[
                :, : stop - begin
            ]
        return found


def _filled(rows: np.ndarray) -> np.ndarray:
    """Values of steps (C, k, ...) as those of a whole block, with zeros behind them."""
    return np.pad(rows, [(0, 0), (0, BLOCK - rows.shape[1])] + [(0, 0)] * (rows.ndim - 2))
