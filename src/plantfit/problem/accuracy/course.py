"""States along the steps of a record, one step after another, as a compiled loop over blocks of one length.

A mesh has another number of steps in every round of its making. A loop over all of them would be compiled anew for each number, so it is
compiled for one block of `BLOCK` steps, and records are worked off in such blocks, the last one filled with steps of length 0.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.native.kept_programs import Kept, described
from plantfit.native.scan import native_scan
from plantfit.simulate.steps.registry import STEPPERS
from plantfit.simulate.steps.vector import VectorModel

import jax
import jax.numpy as jnp

BLOCK = 256  # steps of one call: some 0.1 ms beside what they take


def course(vector: VectorModel, stepper: str) -> Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, Any], np.ndarray]:
    """A function of first states (C, n), inputs at both ends of steps (C, K, c), lengths (C, K) in seconds and parameters, each (C, ...).

    It gives the states (C, K + 1, n) at all ends of steps; from one on that cannot be taken they are not finite.
    """
    step = STEPPERS[stepper].step

    def block(x, u0, u1, length, values):
        def body(x, row):
            x = step(vector.rate, x, row[0], row[1], row[2], values, True, vector.pattern)
            x = tuple(jnp.asarray(v, dtype=float) for v in x)
            return x, x

        rows = tuple(u0.T), tuple(u1.T), length
        _, states = native_scan(body, tuple(x), rows, keep=True, fallback=True)
        return jnp.stack(states, axis=1)

    compiled = Kept(jax.vmap(block), "course", described((vector.model, stepper)))

    def states(x0, u0, u1, length, values):
        count, steps = length.shape
        found = np.empty((count, steps + 1, x0.shape[1]))
        found[:, 0], values = x0, jax.device_put(values)
        for begin in range(0, steps, BLOCK):
            part = slice(begin, min(begin + BLOCK, steps))
            rest = begin + BLOCK - part.stop
            a, b, h = (np.pad(v[:, part], [(0, 0), (0, rest)] + [(0, 0)] * (v.ndim - 2)) for v in (u0, u1, length))
            found[:, begin + 1 : part.stop + 1] = np.asarray(compiled(found[:, begin], a, b, h, values))[:, : BLOCK - rest]
        return found

    return states
