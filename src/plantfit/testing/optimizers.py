"""Conformance suite for optimizers: what every method, built in or a plug-in, must keep.

    from plantfit.testing import check_optimizer
    check_optimizer(MyMethod())

Every check raises AssertionError with a sentence; `CHECKS` lists them for parametrised tests.
"""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from plantfit.errors import Status
from plantfit.optimize import Checkpoint, Facts, Objective, RunResult, make, minimise
from plantfit.testing.objectives import OUTSIDE, bowl, centre, corner, flat, hopeless

import jax
import jax.numpy as jnp

# Compiling takes most of an exam, and budgets, numbers of runs and dimensions decide what is compiled. So the checks
# share these few.
BUDGET, SMALL = 1500, 601  # evaluations; no number of rows divides the small one
FEW, MANY, MANY_OF_HOST = 2, 9, 5  # runs side by side; those of a host method come one after another
ALONE = 3  # the run taken alone


def check_optimizer(method: Any) -> list[str]:
    """Run every check on a registered name or a ready method; the names of the checks.

    Raises AssertionError with what was expected and what came.
    """
    for check in CHECKS:
        check(method)
    return [check.__name__ for check in CHECKS]


def check_bounds_and_budget(method: Any) -> None:
    """No candidate outside the cube, no evaluation beyond the budget, a falling history."""
    for budget, runs in ((BUDGET, _many(method)), (SMALL, FEW)):
        for r in minimise(corner(3), method, runs=runs, budget=budget, seed=4)[:FEW]:
            _expect(r.cost > OUTSIDE and np.all((r.x >= 0) & (r.x <= 1)), method, f"a candidate left the cube: {r.x}")
            _expect(0 < r.evaluations <= budget, method, f"{r.evaluations} evaluations were spent of {budget}")
            _expect(bool(np.all(np.diff(r.history_evaluations) > 0)), method, "history evaluations do not increase")
            _expect(bool(np.all(np.diff(r.history_cost) <= 0)), method, "the best cost rose")
            _expect(
                r.history_evaluations[-1] == r.evaluations and r.history_cost[-1] == r.cost,
                method,
                "the history does not reach the end",
            )


def check_rows_of_a_generation(method: Any) -> None:
    """A population method asks for as many points as its `rows` says, under every budget that covers them."""
    made: Any = make(method) if isinstance(method, str) else method
    if hasattr(made, "run"):
        return
    for budget in (1, 7, BUDGET):
        facts = Facts(3, budget, np.zeros(3), np.ones(3))
        if (rows := made.rows(facts)) > budget:
            continue  # the loop refuses it

        def asked(key: Any, facts: Facts = facts) -> Any:
            return made.ask(key, made.init(key, facts))[0]

        shape = jax.eval_shape(asked, jax.random.key(0)).shape
        _expect(
            shape == (rows, 3),
            method,
            f"`rows` says {rows} with a budget of {budget}, but `ask` returns points of shape {shape}",
        )


def check_calls_within_budget(method: Any) -> None:
    """The charges of the calls that a host method really makes stay within the budget."""
    charged = [0.0]
    base = bowl(3)

    def counted(function: Callable, charge: float) -> Callable:
        def call(x: np.ndarray) -> Any:
            charged[0] += charge
            return function(x)

        return call

    assert base.value_and_gradient is not None
    assert base.residuals_and_jacobian is not None
    objective = dataclasses.replace(
        base,
        value_and_gradient=counted(base.value_and_gradient, base.gradient_charge),
        residuals_and_jacobian=counted(base.residuals_and_jacobian, base.jacobian_charge),
    )
    [r] = minimise(objective, method, budget=SMALL, seed=2)
    _expect(
        charged[0] <= r.evaluations <= SMALL,
        method,
        f"derivatives worth {charged[0]} were called, {r.evaluations} booked, {SMALL} allowed",
    )


def check_optimum_in_corner_beside_failures(method: Any) -> None:
    """The best point lies in a corner of the cube and half of the cube cannot be simulated."""
    results = minimise(corner(3), method, runs=_many(method), budget=BUDGET, seed=1)[:3]
    best = min(r.cost for r in results)
    made = make(method) if isinstance(method, str) else method
    close = 0.05 if made.needs.baseline else 0.011
    _expect(best <= close, method, f"the corner costs 0.01, but the best found was {best}")
    _expect(any(r.failures > 0 for r in results), method, "failed candidates were not counted")
    _expect(all(np.isfinite(r.cost) for r in results), method, "a failed candidate was taken for the best")


def check_nothing_works(method: Any) -> None:
    """When no candidate can be simulated the runs fail and nothing is raised."""
    for r in minimise(hopeless(3), method, runs=FEW, budget=SMALL, seed=1):
        _expect(
            r.status is Status.failed and r.cost == np.inf,
            method,
            f"status {r.status} and cost {r.cost} without any working candidate",
        )
        _expect(
            r.failures > 0 and r.evaluations <= SMALL, method, f"{r.failures} failures in {r.evaluations} evaluations"
        )


def check_flat_and_one_dimension(method: Any) -> None:
    """A flat cost over one coordinate is searched without an error."""
    for r in minimise(flat(1), method, runs=FEW, budget=SMALL, seed=1):
        _expect(
            r.cost == 1.0 and r.status is not Status.failed,
            method,
            f"a flat cost of 1 came back as {r.cost} with status {r.status}",
        )


def check_same_seed_same_bits(method: Any) -> None:
    """The same seed gives the same bits, another seed another search."""
    one, two, other = (minimise(corner(3), method, runs=FEW, budget=SMALL, seed=s) for s in (7, 7, 8))
    _same(method, one, two, "the same seed")
    _expect(
        any(not np.array_equal(a.history_cost, b.history_cost) for a, b in zip(one, other, strict=True)),
        method,
        "the seed has no effect",
    )


def check_alone_equals_beside_others(method: Any) -> None:
    """A run has the same bits alone and beside others."""
    together = minimise(corner(3), method, runs=_many(method), budget=SMALL, seed=7)
    alone = minimise(corner(3), method, runs=1, first_run=ALONE, budget=SMALL, seed=7)
    _same(method, together[ALONE : ALONE + 1], alone, "a run taken alone")


def check_resume_same_bits(method: Any) -> None:
    """A search stopped in the middle and resumed from bytes ends with the same bits."""
    kept: list[bytes] = []

    def search(**more: Any) -> list[RunResult]:
        return minimise(corner(3), method, runs=FEW, budget=SMALL, seed=7, **more)

    whole = search(checkpoint=lambda c: kept.append(c.to_bytes()))
    _expect(bool(kept), method, "no checkpoint was sent")
    for data in kept:
        _same(method, whole, search(resume=Checkpoint.from_bytes(data)), "a resumed search")
    kept.clear()
    partial = search(checkpoint=lambda c: kept.append(c.to_bytes()), stop=lambda: bool(kept))
    stopped = len(partial) < FEW or partial[-1].status is Status.interrupted
    _expect(stopped, method, "the search did not stop when told to")
    _same(method, whole, search(resume=Checkpoint.from_bytes(kept[-1])), "a stopped and resumed search")


def check_no_favoured_place(method: Any) -> None:
    """Moving the optimum or reversing the coordinates does not change how well it is found."""
    places = [_typical(method, objective) for objective in (bowl(3), bowl(3, moved=0.2), bowl(3, turned=True))]
    _expect(
        max(places) - min(places) < 3 or max(places) < -10,
        method,
        f"log10 cost depends on the place of the optimum: {places}",
    )


def check_310_dimensions(method: Any) -> None:
    """A large problem runs and ends better than at the mirror image of its optimum."""
    objective = bowl(310)
    [r] = minimise(objective, method, budget=SMALL, seed=1)
    _expect(r.x.shape == (310,), method, f"the answer has shape {r.x.shape}")
    _expect(
        r.cost < float(np.asarray(objective.costs(jnp.asarray(1.0 - centre(310))[None]))[0]),
        method,
        f"cost {r.cost} is no better than the mirror image of the optimum",
    )


CHECKS: list[Callable[[Any], None]] = [
    check_bounds_and_budget,
    check_rows_of_a_generation,
    check_calls_within_budget,
    check_optimum_in_corner_beside_failures,
    check_nothing_works,
    check_flat_and_one_dimension,
    check_same_seed_same_bits,
    check_alone_equals_beside_others,
    check_resume_same_bits,
    check_no_favoured_place,
    check_310_dimensions,
]


def _expect(condition: bool | np.bool_, method: Any, sentence: str) -> None:
    if not condition:
        raise AssertionError(f"Optimizer {method!r}: {sentence}.")


def _same(method: Any, one: list[RunResult], two: list[RunResult], what: str) -> None:
    _expect(len(one) == len(two), method, f"{what} gave {len(two)} runs, not {len(one)}")
    for a, b in zip(one, two, strict=True):
        for name in ("run", "x", "cost", "evaluations", "status", "history_evaluations", "history_cost", "failures"):
            left, right = getattr(a, name), getattr(b, name)
            _expect(np.array_equal(left, right), method, f"{what} differs in {name} of run {a.run}: {left} and {right}")


def _many(method: Any) -> int:
    return MANY_OF_HOST if hasattr(make(method) if isinstance(method, str) else method, "run") else MANY


def _typical(method: Any, objective: Objective) -> float:
    # many for a steady median; few runs of a host method differ much
    costs = [r.cost for r in minimise(objective, method, runs=_many(method), budget=BUDGET, seed=11, target=1e-12)]
    return float(np.log10(np.median(costs) + 1e-300))
