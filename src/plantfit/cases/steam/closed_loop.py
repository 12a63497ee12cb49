"""Pressure control of the chamber: PID and predictive controllers, each for the best model alone and for a family of
models."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from scipy.optimize import brentq

from plantfit.cases.steam.whole_plant import FINE, whole_plant
from plantfit.control import (
    Demand,
    Design,
    Gains,
    LinearPlant,
    StepProfile,
    judged,
    linearised,
    offset_free_mpc,
    pid,
    robust_tuning,
    stacked_controllers,
)
from plantfit.errors import SimulationError
from plantfit.rig.steam_chamber import NODES, OPENINGS
from plantfit.runtime import jit
from plantfit.simulate.loop.closed_loop import ClosedLoop, closed_loop
from plantfit.simulate.loop.sensors import Actuator, Sensor
from plantfit.space import Parameter

import jax

Plants = Mapping[str, np.ndarray]

PROFILE = StepProfile((0.0, 100.0, 200.0), (14.0, 17.0, 15.0), 300.0, band=0.05)  # s, bar
MIDDLES = (15.0, 16.0, 14.0, 17.0)  # bar, where models are linearised
LEAST_GAIN = 0.02  # bar/%, below which a model says nothing about how to move the valve
PID_PERIOD, MPC_PERIOD = 0.1, 0.5  # s
NOISE, STEP = 0.05, 39.0 / 4096  # bar, of the rig
GAINS = {
    "Kp": Parameter((0.3, 60.0), "%/bar", "log", start=10.0),
    "Ki": Parameter((0.003, 3.0), "%/(bar s)", "log", start=0.3),
    "Kd": Parameter((0.03, 300.0), "% s/bar", "log", start=1.0),
    "filter_time": Parameter((0.2, 10.0), "s", "log", start=1.0),
    "b": Parameter((0.0, 1.0), start=0.7),
}
WEIGHTS = (1e-4, 1e-3, 1e-2)  # bar^2 / %^2, of the input's distance from where it rests
LOADS = (0.3, 1.0, 3.0)  # % per sqrt s, by which the load at the valve wanders
make_pid = partial(Gains, c=0.0)


@dataclass(frozen=True, eq=False)
class Chosen:
    """A controller: `kind` "PID" or "MPC", what it was made for, the `parameters` in its loop, a sentence on them."""

    kind: str
    made_for: str
    parameters: Any
    said: str


@dataclass(frozen=True, eq=False)
class Bench:
    """The loops of one kind of controller around models of `plants_of` and around the truth on a finer grid of
    openings."""

    of_models: ClosedLoop
    of_truth: ClosedLoop
    noise: np.ndarray = field(repr=False)

    def responses(
        self, parameters: Any, plants: Plants, truth: bool = False
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (N,), pressures and openings (plants, N) of one controller."""
        loop = self.of_truth if truth else self.of_models
        y, u = _simulated(loop, parameters, dict(plants), PROFILE.reference(loop.period), self.noise)
        return loop.period * np.arange(len(self.noise)), np.asarray(y), np.asarray(u)


@partial(jit, static_argnums=0)
def _simulated(loop: ClosedLoop, parameters: Any, plants: Any, reference: Any, noise: Any) -> Any:
    def one(plant):
        seen = loop.simulate(parameters, plant, reference, noise=noise)
        return seen.y, seen.u

    return jax.vmap(one)(plants)


def bench(controller: Any, period: float, seed: int) -> Bench:
    """A loop with the rig's sensor and valve: 12 bits of 39 bar, 0.05 bar rms, 0 to 100 %."""
    shared = {
        "period": period,
        "output": "y",
        "input": "u",
        "sensor": Sensor(quantum=STEP),
        "actuator": Actuator(0.0, 100.0),
    }
    substeps = round(period / PID_PERIOD)
    models, truth = (
        closed_loop(whole_plant(grid), controller, substeps=substeps, **shared) for grid in (OPENINGS, FINE)
    )
    noise = NOISE * np.random.default_rng(seed).standard_normal(PROFILE.samples(period))
    return Bench(models, truth, noise)


def tuned_pid(
    place: Bench,
    plants: Plants,
    demand: Demand,
    made_for: str,
    budget: int,
    seed: int,
    start: Mapping[str, float] | None = None,
) -> Chosen:
    """The PID of 0.1 s that serves all `plants` best, searched from `start` on."""
    gains = {n: replace(p, start=(start or {}).get(n, p.start)) for n, p in GAINS.items()}
    found = robust_tuning(
        place.of_models,
        plants,
        PROFILE,
        gains,
        make_pid,
        demand,
        budget=budget,
        seed=seed,
        settings={"population": 16},
        noise=place.noise,
    )
    return Chosen("PID", made_for, found.parameters, ", ".join(f"{n} = {v:.3g}" for n, v in found.values.items()))


def linear_model(plant: Mapping[str, np.ndarray]) -> tuple[LinearPlant, float] | None:
    """One model of a family near the first of `MIDDLES` where it rests and more steam means more pressure, without
    its dead time, and the dead time (s); None where there is no such place."""
    model, tables = whole_plant(dead_time=False), {n: v for n, v in plant.items() if n != "Td"}
    fine = np.linspace(OPENINGS[0], OPENINGS[-1], 1801)
    for y in MIDDLES:
        gains = [np.interp(y, NODES, column) for column in plant["k"].T]
        excess = np.interp(fine, OPENINGS, gains) * fine - y
        for i in np.flatnonzero((excess[:-1] < 0) & (excess[1:] >= 0)):
            u = brentq(lambda v, gains=gains, y=y: float(np.interp(v, OPENINGS, gains) * v - y), fine[i], fine[i + 1])
            found = linearised(model, tables, {"x1": y, "x2": 0.0}, {"u": u})
            if (found.C @ np.linalg.solve(-found.A, found.B))[0, 0] > LEAST_GAIN:
                return found, float(np.interp(u, OPENINGS, plant["Td"]))
    return None


def predictive(plant: LinearPlant, dead_time: float, weight: float, load: float) -> Design:
    """Offset-free MPC of 0.5 s, 20 moves of 2 s."""
    return offset_free_mpc(
        plant, MPC_PERIOD, 1.0, weight, limits=(0.0, 100.0), dead_time=dead_time, longest_delay=1.0, disturbance=load,
        measurement=NOISE, process={"x2": 0.02}, horizon=20, hold=4,
    )  # fmt: skip


def chosen_mpc(
    place: Bench, nominal: Plants, tuning: Plants, demand: Demand, made_for: tuple[str, str], models: int = 3
) -> list[Chosen]:
    """The best design for `nominal` among those on it, and for all of `tuning` among those on it and on some
    `models` of tuning; every weight and load is tried."""
    plants = {n: np.concatenate([nominal[n], tuning[n]]) for n in tuning}
    designs, labels = [], []
    for i in range(models + 1):
        linear = linear_model({n: v[i] for n, v in plants.items()})
        if linear is None:
            continue
        for weight, load in product(WEIGHTS, LOADS):
            designs.append(predictive(*linear, weight, load).parameters)
            labels.append(f"on {f'member {i}' if i else 'the best model'}, R = {weight:g} bar²/%², load {load:g} %/√s")
    scores = judged(place.of_models, stacked_controllers(designs), plants, PROFILE, noise=place.noise)
    costs = np.asarray(jax.vmap(jax.vmap(demand.of_plant))(scores))
    own = sum(label.startswith("on the best") for label in labels)
    first = int(np.argmin(demand.over_plants(costs[:own, :1])))
    best = int(np.argmin(demand.over_plants(costs[:, 1:])))
    return [
        Chosen("MPC", made_for[0], designs[first], f"{labels[first]}, best of {own}"),
        Chosen("MPC", made_for[1], designs[best], f"{labels[best]}, best of {len(designs)}"),
    ]


def mpc_bench(plants: Plants, seed: int) -> Bench:
    """The loops of `predictive` controllers, which all share one."""
    for i in range(len(plants["Td"])):
        linear = linear_model({n: v[i] for n, v in plants.items()})
        if linear is not None:
            return bench(predictive(*linear, WEIGHTS[0], LOADS[0]).controller, MPC_PERIOD, seed)
    raise SimulationError(
        f"No model of the family rests at one of {MIDDLES} bar with "
        f"a gain above {LEAST_GAIN} bar/%; give another family."
    )


def pid_bench(seed: int) -> Bench:
    """The loops of PID controllers, anti-windup by clamping at the valve's ends."""
    return bench(pid(PID_PERIOD, lower=0.0, upper=100.0), PID_PERIOD, seed)
