"""A study that takes its time, for tests with several processes.

python worked_study.py DATABASE STUDY WORKERS     goes on with a study that is begun, with helpers
python worked_study.py DATABASE STUDY ADDRESS     the same on the workers of a dask scheduler
"""

import os
import sys
import time
from functools import cache
from tempfile import TemporaryDirectory

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.optimize.contract import Objective
from plantfit.study import Plan, Store, begin, helping, resume, run
from plantfit.study.problem_recipe import Recipe

import jax
import jax.numpy as jnp

PLAN = Plan(
    name="worked", methods=("lbfgsb", "pso"), runs=6, budget=600, seed=11, settings={"pso": {"population": 10}}, chunk=1
)
MAKER = "worked_study:make"
CHECKPOINT_SECONDS = 0.1


def rosenbrock(z):
    x = 4 * z - 2
    return jnp.sum(100 * (x[..., 1:] - x[..., :-1] ** 2) ** 2 + (1 - x[..., :-1]) ** 2, axis=-1)


slope = jax.jit(jax.value_and_grad(rosenbrock))


def objective(delay: float) -> Objective:
    """A Rosenbrock valley that takes `delay` seconds per batch of candidates, with the same bits for any delay."""

    def wait(x):
        time.sleep(delay)
        return np.zeros((), np.float64)

    def costs(z):
        nothing = jax.pure_callback(wait, jax.ShapeDtypeStruct((), jnp.float64), z) if delay else 0.0
        return rosenbrock(z) + nothing

    def value_and_gradient(z):
        time.sleep(delay / 8)
        value, gradient = slope(z)
        return float(value), np.asarray(gradient)

    return Objective(dimension=3, costs=costs, value_and_gradient=value_and_gradient)


def physical(z):
    return 10.0 * jnp.asarray(z)


def make(text, path, files, start):
    """A `recipe.Maker`: the text is the delay."""
    return objective(float(text)), physical


def another(text, path, files, start):
    """The wrong problem."""
    right = objective(0.0)
    return Objective(dimension=3, costs=lambda z: right.costs(z) + 0.5), physical


def broken(text, path, files, start):
    return 1 / 0  # pyrefly: ignore[division-by-zero]


def deadly(text, path, files, start):
    """Ends the process that makes the problem, as one without memory is ended."""
    os._exit(9)


def sums(text, path, files, start):
    """Least squares to numbers in a file, which the text names."""
    numbers = jnp.asarray([float(word) for word in files[text].read_text().split()])
    return Objective(dimension=2, costs=lambda z: jnp.sum((z - numbers) ** 2, axis=-1)), physical


def begun(store: Store, plan: Plan = PLAN, delay: float = 0.02) -> int:
    return begin(plan, objective(0.0), store, spec_text=str(delay), to_physical=physical)


@cache
def alone():
    """The runs of PLAN by one worker in one sitting."""
    with TemporaryDirectory() as folder:
        store = Store.open(f"{folder}/study.db")
        return store.runs(run(PLAN, objective(0.0), store, to_physical=physical))


def main(database: str, study_id: int, workers: str) -> None:
    store = Store.open(database)
    if not workers.isdigit():
        from plantfit.study.cluster.driver import Job, connected, work_on_cluster

        with connected(workers) as client:
            recipe = Recipe(MAKER, str(store.study(study_id).spec_text), "")
            return work_on_cluster(store, [Job(study_id, recipe)], client, checkpoint_seconds=CHECKPOINT_SECONDS)
    with helping(store, [study_id], int(workers) - 1, maker=MAKER, checkpoint_seconds=CHECKPOINT_SECONDS):
        mine = objective(float(str(store.study(study_id).spec_text)))
        resume(store, study_id, mine, to_physical=physical, checkpoint_seconds=CHECKPOINT_SECONDS)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), sys.argv[3])
