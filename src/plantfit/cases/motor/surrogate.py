"""The surrogate: a Hammerstein-Wiener model of the record, its order chosen by blocks left out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.motor.bench import Bench
from plantfit.fitting import Answer, fit
from plantfit.models.library.hammerstein_wiener import hammerstein_wiener
from plantfit.optimize import minimise
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.space import Parameter
from plantfit.study.objective import objective_of
from plantfit.trust.validate.blocks_left_out import Structure, StructureChoice, choose_structure

ORDERS, BLOCKS = (1, 2, 3), 5  # blocks of one round of the excitation each
NODES = {"from": -12, "to": 12, "count": 7}  # V at rest
SUBSTEPS = 4


@dataclass(frozen=True)
class Surrogate:
    """`speed` (n,) of the fitted surrogate; `fit_raw`, `fit_exact` in percent to the record and to the motor's true
    speed; `fit_sensor` of the record itself to the true speed; `order` and how it was chosen."""

    order: int
    chosen: StructureChoice
    answer: Answer
    speed: np.ndarray
    fit_raw: float
    fit_exact: float
    fit_sensor: float


def surrogate(made: Bench, seed: int = 1, progress: Callable[[Any], None] | None = None) -> Surrogate:
    """Choose the order and fit the whole record."""
    record = as_block(made.recording)
    chosen = choose_structure({str(n): structure(n) for n in ORDERS}, record, BLOCKS, SUBSTEPS, seed)
    order = int(chosen.simplest)
    own = structure(order)
    answer = fit(
        Problem(own.model, record, own.parameters, substeps=SUBSTEPS, name="motor-surrogate"),
        seed=seed,
        progress=progress,
    )
    speed, seen, exact = answer.predict()["y"], record["y"], made.run.exact["w"]
    return Surrogate(order, chosen, answer, speed, percent(speed, seen), percent(speed, exact), percent(seen, exact))


def surrogate_speeds(records: Sequence[Recording], order: int, seed: int = 1) -> list[np.ndarray]:
    """Speed (n,) of a surrogate of its own for each record, all fitted in one compiled program."""
    own = structure(order)
    named = {f"r{k}": as_block(r) for k, r in enumerate(records)}
    space = {n: replace(p, per_recording=len(named) > 1) for n, p in own.parameters.items()}
    problem = Problem(own.model, named, space, substeps=SUBSTEPS)
    found = minimise(objective_of(problem), "auto", budget=int(1000 * problem.jacobian_charge), seed=seed)[0]
    values = np.asarray(problem.space.physical(found.x))
    return [problem.predict(values, name)["y"] for name in named]


def structure(order: int) -> Structure:
    """Input saturation, linear block of an order, piecewise linear output."""
    model = hammerstein_wiener(
        "saturation", order, output_curve="table", output_nodes=NODES, input_unit="V", output_unit="rad/s"
    )
    times = {
        f"a{k}": Parameter((0.003**k, 2.0**k), next(p.unit for p in model.parameters if p.name == f"a{k}"), "log")
        for k in range(1, order + 1)
    }
    # below 4 V the record would look flat
    edges = {"low": Parameter((-20.0, -4.0), "V"), "high": Parameter((4.0, 20.0), "V")}
    return Structure(model, {**edges, **times, "g": Parameter((-200.0, 200.0), "rad/s", shape=(NODES["count"],))})


def as_block(recording: Recording) -> Recording:
    """Voltage and speed by the names of `hammerstein_wiener`."""
    return Recording(
        recording.t, {"u": recording.signals["V"], "y": recording.signals["w"]}, recording.name, recording.log
    )


def percent(simulated: np.ndarray, measured: np.ndarray) -> float:
    """100 (1 - |y - y_hat| / |y - mean y|), missing samples left out."""
    error = np.sqrt(np.nanmean((simulated - measured) ** 2))
    return float(100 * (1 - error / np.nanstd(measured)))


def two_errors_record(recording: Recording, speed: np.ndarray) -> Recording:
    """What two_errors.toml reads: V, a speed (n,) as w and w_seen, and as Ve the voltage applied until each sample."""
    volts = recording["V"]
    before = np.concatenate([volts[:1], volts[:-1]])
    told = "w and w_seen are the surrogate's speed; Ve is the voltage of the interval that ends at each sample."
    signals = {
        "V": Signal(volts, "V"),
        "w": Signal(speed, "rad/s"),
        "w_seen": Signal(speed, "rad/s"),
        "Ve": Signal(before, "V"),
    }
    return Recording(recording.t, signals, "surrogate", (*recording.log, told))
