"""Where local searches begin: seeded points, spread points, points far from each other."""

import warnings
from collections.abc import Iterator

import numpy as np
from scipy.stats import qmc

import plantfit.runtime  # noqa: F401

import jax
from jax import Array


def generator(key: Array) -> np.random.Generator:
    """A numpy generator that depends on the jax key alone."""
    return np.random.default_rng(np.asarray(jax.random.key_data(key), dtype=np.uint32))


def warm_then_uniform(start: np.ndarray | None, dimension: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """The warm starts, then uniform points without end."""
    if start is not None:
        yield from np.clip(np.asarray(start, dtype=float), 0.0, 1.0)
    while True:
        yield rng.random(dimension)


def sobol(n: int, dimension: int, rng: np.random.Generator) -> np.ndarray:
    """n points (n, d) of a scrambled Sobol sequence (Owen 1998)."""
    return following(qmc.Sobol(dimension, scramble=True, rng=rng), n)


def following(sequence: qmc.Sobol, n: int) -> np.ndarray:
    """The next n points (n, d) of a sequence."""
    with warnings.catch_warnings():
        # the balance of powers of two is not needed here
        warnings.simplefilter("ignore", UserWarning)
        return sequence.random(n)


def far_apart(points: np.ndarray, costs: np.ndarray, share: float = 0.25) -> tuple[list[int], list[int]]:
    """Indices of finite points, best first: those farther than `share` of the mean random distance
    sqrt(d / 6) from every better chosen one, and the others."""
    order = [int(i) for i in np.argsort(costs, kind="stable") if np.isfinite(costs[i])]
    radius = share * np.sqrt(points.shape[1] / 6)
    chosen: list[int] = []
    others: list[int] = []
    for i in order:
        alone = not chosen or np.min(np.linalg.norm(points[chosen] - points[i], axis=1)) > radius
        (chosen if alone else others).append(i)
    return chosen, others
