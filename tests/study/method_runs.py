"""Finished runs made by hand, for statistics and comparisons."""

import numpy as np

from plantfit.errors import Status
from plantfit.study.store.records import RunRecord


def made_run(method, run, evaluations, cost, *, x=(0.5, 0.5), seconds=1.0, extra=None):
    """A run from its history; its final cost is the last one."""
    x = np.asarray(x, dtype=float)
    return RunRecord(
        method, run, 1, x, float(cost[-1]), {f"p{k}": float(10 * v) for k, v in enumerate(x)}, float(evaluations[-1]),
        seconds,
        Status.budget, 0, np.array(evaluations, dtype=float), np.array(cost, dtype=float), extra or {},
    )  # fmt: skip


def falling(method, run, rate, *, seed=0, floor=0.01, delay=0.0, budget=2000, points=40):
    """A run whose cost falls from 1 towards `floor` as a power of the evaluations, with a little luck; two places of
    equal worth."""
    rng = np.random.default_rng([seed, run, len(method)])
    at = np.unique(np.geomspace(20, budget, points).round())
    cost = floor + np.exp(rng.normal(0, 0.15)) * (1 + np.maximum(at - delay, 0) / 50) ** -(
        rate * np.exp(rng.normal(0, 0.1))
    )
    return made_run(
        method, run, at, cost, x=(0.3, 0.7)[run % 2] + rng.normal(0, 0.01, 3), seconds=rate * (1 + 0.1 * rng.random())
    )


def two_methods(runs, *, seed=0, floor=0.01):
    """`late` starts late and ends lower than `early`."""
    return [
        *(falling("early", k, 1.0, seed=seed, floor=floor) for k in range(runs)),
        *(falling("late", k, 2.0, seed=seed, floor=floor, delay=300) for k in range(runs)),
    ]
