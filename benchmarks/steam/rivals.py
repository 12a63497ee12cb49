"""Every rival on workload S: what to call, for how many candidates, and how far its responses are from the
reference."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from benchmarks.data import Steam
from benchmarks.steam.casadi_rival import casadi_cost
from benchmarks.steam.diffrax_rival import diffrax_cost
from benchmarks.steam.reference import worst_error
from benchmarks.steam.scipy_rivals import bdf, cost_of, lsoda
from benchmarks.steam.twin import Scheme, twin


class Tolerances(NamedTuple):
    """What makes the largest error at the truth come out just under `name`; (rtol, atol) for scipy, both alike for
    diffrax."""

    name: str
    bdf: tuple[float, float]
    lsoda: tuple[float, float]
    diffrax: float


LOOSE = Tolerances("1e-3 bar", bdf=(1e-4, 1e-4), lsoda=(5e-5, 1e-4), diffrax=5e-6)
EQUAL = Tolerances("2e-5 bar", bdf=(1e-6, 1e-6), lsoda=(1e-6, 1e-7), diffrax=1e-7)  # as the fixed steps of the C twin


@dataclass(frozen=True)
class Rival:
    """A call that evaluates `batch` candidates (`kind` "cost") or one gradient; `error` in bar at the truth, None if
    not its own."""

    call: Callable[[], Any]
    batch: int = 1
    kind: str = "cost"
    error: float | None = None


def twins(steam: Steam, batches: tuple[int, ...]) -> dict[str, Rival]:
    """The C twin: both schemes with kept pieces (the best C), and the exponential one with a look-up at every step.

    A batch is drawn over the box; one candidate alone is the truth.
    """
    rows: dict[str, Rival] = {}
    variants: tuple[tuple[str, Scheme, bool], ...] = (
        ("C twin", "exponential", True),
        ("C twin, looked up", "exponential", False),
        ("C twin, ROS2", "ros2", True),
        ("C twin, ROS2, looked up", "ros2", False),
    )
    for name, scheme, keep in variants:
        for batch in batches:
            engine = twin(steam, scheme, keep=keep, width=2 if batch == 1 else 3)
            if engine is None:
                print("SKIPPED the C twin: no C compiler, and apt could not bring one")
                return {}
            theta = steam.truth.reshape(1, -1) if batch == 1 else steam.draw(batch, 5)
            error = worst_error(steam, [steam.truth], [engine.responses(steam.truth)])
            rows[f"{name}, {batch}"] = Rival(
                lambda engine=engine, theta=theta: engine.cost_batch(theta), batch, error=error
            )
    return rows


def solvers(steam: Steam, quick: bool) -> dict[str, Rival]:
    """scipy, CasADi and diffrax on the truth; QUICK leaves out the tight tolerances."""
    rows = _scipy(steam, LOOSE) | _casadi(steam) | _diffrax(steam, LOOSE)
    if not quick:
        rows |= _scipy(steam, EQUAL) | _diffrax(steam, EQUAL)
    return rows


def _scipy(steam: Steam, tolerances: Tolerances) -> dict[str, Rival]:
    theta = steam.truth.ravel()
    runs = {
        "scipy BDF": bdf(steam, theta, *tolerances.bdf),
        "scipy LSODA, C rate": lsoda(steam, theta, *tolerances.lsoda),
    }
    rows = {}
    for name, run in runs.items():
        if run is None:
            print(f"SKIPPED {name}: no C compiler or no Python headers (package python3-dev)")
            continue
        error = worst_error(steam, [theta], [run()])
        rows[f"{name}, {tolerances.name}"] = Rival(lambda run=run: cost_of(steam, run()), error=error)
    return rows


def _casadi(steam: Steam) -> dict[str, Rival]:
    theta, compiled = steam.truth.ravel(), casadi_cost(steam)
    if compiled is None:
        print("SKIPPED CasADi: not installed (pip install 'plantfit[bench]') or no C compiler")
        return {}
    error = worst_error(steam, [theta], [compiled.responses(theta)])
    return {
        "CasADi, generated C": Rival(lambda: compiled.cost(theta), error=error),
        "CasADi, gradient": Rival(lambda: compiled.value_and_gradient(theta), kind="gradient", error=error),
    }


def _diffrax(steam: Steam, tolerances: Tolerances) -> dict[str, Rival]:
    theta, compiled = steam.truth.ravel(), diffrax_cost(steam, tolerances.diffrax)
    if compiled is None:
        print("SKIPPED diffrax: not installed (pip install 'plantfit[bench]')")
        return {}
    responses = np.where(np.isnan(steam.y), np.nan, np.asarray(compiled.responses(theta)))
    error = worst_error(steam, [theta], [responses])
    return {
        f"diffrax, {tolerances.name}": Rival(lambda: compiled.cost(theta), error=error),
        f"diffrax, gradient, {tolerances.name}": Rival(
            lambda: compiled.value_and_gradient(theta), kind="gradient", error=error
        ),
    }
