"""A fingerprint of an objective, so that a study is never resumed on another problem."""

from collections.abc import Callable
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import StoreError
from plantfit.optimize.contract import Objective
from plantfit.study.store.codec import from_blob, to_blob

import jax.numpy as jnp

POINTS = 3
TOLERANCE = 1e-6  # other CPUs and library versions change last bits, other data change far more


def probe(objective: Objective, to_physical: Callable[[Any], Any] | None) -> bytes:
    """Costs and physical values at a few fixed points of the cube, and what is held, as one blob."""
    d = objective.dimension
    # irrational steps: inside the cube, in no special place of any model
    z = np.mod(0.5 + np.outer(np.arange(1, POINTS + 1), np.sqrt(np.arange(2, d + 2))), 1.0)
    costs = np.asarray(objective.costs(jnp.asarray(z)), dtype=float)
    values = z if to_physical is None else np.asarray(to_physical(z), dtype=float)
    held = [] if objective.held is None else [objective.held]
    return to_blob(np.concatenate([costs.ravel(), values.ravel(), held]))


def check_same(before: bytes, now: bytes, study_id: int) -> None:
    """Raise StoreError when two probes differ by more than rounding."""
    a, b = from_blob(before), from_blob(now)
    held = len(a) % POINTS, len(b) % POINTS
    if held == (1, 1) and a[-1] != b[-1] and len(a) == len(b):
        raise StoreError(
            f"Study {study_id} began with other values that are held, or other nodes of tables: the file of a table "
            "may have changed. Resume it with its own, or start a new study."
        )
    a, b = (v[: len(v) - n] for v, n in zip((a, b), held, strict=True))  # earlier versions kept no number of these
    if a.shape != b.shape:
        raise StoreError(
            f"Study {study_id} has another number of free parameters than this problem; resume it with its own spec."
        )
    if not np.allclose(a[:POINTS], b[:POINTS], rtol=TOLERANCE, atol=0.0, equal_nan=True):
        k = int(np.argmin(np.isclose(a[:POINTS], b[:POINTS], rtol=TOLERANCE, atol=0.0, equal_nan=True)))
        raise StoreError(
            f"Study {study_id} began with another problem (the cost at a test point was {a[k]:.9g} and is {b[k]:.9g}); "
            "resume it with its own data and spec, or start a new study."
        )
    if not np.allclose(a[POINTS:], b[POINTS:], rtol=TOLERANCE, atol=0.0):
        raise StoreError(
            f"Study {study_id} began with other bounds, scales or "
            "to_physical; resume it with its own spec, or start a new study."
        )
