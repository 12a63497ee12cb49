"""A regulator with its filter, searched so that all plants of a family are held, from as far as they can be caught."""

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.control.catching import _farthest
from plantfit.control.holding.linear_loop import controller_of, largest_sensitivity, near, poles
from plantfit.control.holding.point import held_point
from plantfit.control.linear.design import Design
from plantfit.control.linear.kalman import kalman_observer
from plantfit.control.linear.linear_plant import LinearPlant, linearised
from plantfit.control.linear.lqr import lqr
from plantfit.errors import SimulationError
from plantfit.findings.results.held_plant import HoldWishes
from plantfit.models.model import Model
from plantfit.runtime import jit
from plantfit.simulate.loop.sensors import Actuator, Sensor

import jax
import jax.numpy as jnp

# weights of the input, noise of it that the filter expects
INPUTS, SHAKES = (np.geomspace(1e-4, 1e4, 17), np.geomspace(1e-3, 10.0, 9))
TRIED = 12  # designs that are simulated
FEW = 16  # plants that a design is simulated on in the search
DISTANCES = 24  # of a start, up to the largest
ROOM = 1.15  # times the least sensitivity, where the one asked for cannot be had
FREQUENCIES = 300
PARTS = 4  # of the simulations that progress tells of
QUICK = 0.2  # of a period times the fastest pole: below it a step of a period follows the plant


@dataclass(frozen=True, eq=False)
class HoldRow:
    """One regulator: its `design`, weight of the input and noise that its filter expects, and on every plant (n,)
    whether it is `stable`, its `ms`, and how far below and above the point the plant may begin and return (n, 2)."""

    name: str
    design: Design
    weight: float
    shake: float
    stable: np.ndarray
    ms: np.ndarray
    caught: np.ndarray

    def kept(self, wishes: HoldWishes) -> np.ndarray:
        """Plants (n,) that are stable and return from the lean that was asked for, to both sides."""
        return self.stable & np.all(self.caught >= wishes.lean, axis=1)

    def share(self, wishes: HoldWishes) -> float:
        """Of the plants."""
        return float(np.mean(self.kept(wishes)))


@dataclass(frozen=True, eq=False)
class HoldDesign:
    """`rows`, the first searched on all plants and the second on the best fit; `plant` is the linearised best fit,
    `unstable` its poles in the right half plane (1/s), `plants` parameters (n,) by name that judge."""

    wishes: HoldWishes
    model: Model
    plant: LinearPlant
    plants: Mapping[str, np.ndarray]
    unstable: np.ndarray
    rows: tuple[HoldRow, ...]
    distances: np.ndarray

    @property
    def best(self) -> HoldRow:
        return self.rows[0]

    def responses(self, row: HoldRow) -> dict[str, np.ndarray]:
        """t (N,), the output that leans and the input (n, N) of every plant, begun at the lean that was asked for."""
        w = self.wishes
        loop = _closed(row.design, self.model, w)
        x0 = dict(zip(self.plant.states, self.plant.x0, strict=True))
        x0[w.along] += w.lean
        p = {n: jnp.asarray(v) for n, v in self.plants.items()}
        n = round(w.seconds / w.period)

        def one(p):
            seen = loop.simulate(row.design.parameters, p, {}, samples=n, x0=x0)
            return seen.states[w.along], seen.u[self.plant.inputs[0]]

        y, u = jax.vmap(one)(p)
        return {"t": w.period * np.arange(n), "y": np.asarray(y), "u": np.asarray(u)}


def hold(
    model: Model, train: Mapping[str, np.ndarray], family: Mapping[str, np.ndarray], wishes: HoldWishes,
    progress: Callable[[str], None] | None = None,
) -> HoldDesign:  # fmt: skip
    """The regulator that keeps the `train` plants (first the best fit) stable and catches them from farthest away,
    judged on `family`.

    The weights are those of Bryson's rule, 1 / (size of the output)^2 and a multiple of 1 / (half the input's range)^2;
    the filter expects noise of the input, a multiple of half its range in a second, and that of the sensors. Of these
    two multiples 153 pairs are designed on the best fit; those that hold most of the plants with the Ms that was asked
    for, or the least that there is, are simulated. Raises SimulationError where the best fit has no equilibrium there,
    no regulator or no filter, and where none holds the best fit.
    """
    best = {n: float(v[0]) for n, v in train.items()}
    input_ = wishes.input if model.inputs else None
    at, u0 = held_point(model, best, wishes.at, input_, wishes.lower, wishes.upper)
    held = u0[wishes.input]
    if not wishes.lower < held < wishes.upper:
        known = model.inputs[wishes.input]
        unit = f" {known}" if known and known != "1" else ""
        raise SimulationError(
            f"Holding the point takes {wishes.input} = {held:.4g}{unit}, beyond its limits {wishes.lower:.4g} to "
            f"{wishes.upper:.4g}{unit}; choose "
            "another point, or give the limits of the actuator ([control] lower and upper, or --lower and --upper)."
        )
    plant = linearised(model, best, at, u0)
    found = np.linalg.eigvals(plant.A)
    unstable = found[np.real(found) > 1e-9 * max(float(np.max(np.abs(found))), 1e-9)]
    pairs = [(float(rho), float(shake)) for rho in INPUTS for shake in SHAKES]
    designs = [designed(plant, wishes, *pair) for pair in pairs]
    began, rows, chosen = time.monotonic(), [], []

    def tell(part: int) -> None:
        if progress is not None:
            spent = time.monotonic() - began
            left = f", about {spent / part * (PARTS - part):.0f} s left" if part else ""
            progress(f"{len(designs)} regulators designed, simulating starts: part {part + 1} of {PARTS}{left}")

    for plants in (train, {n: v[:1] for n, v in train.items()}):
        tell(len(chosen))
        kept = _linear_choice(designs, model, plant, plants, wishes)
        chosen.append(kept[_farthest_of(kept, designs, model, plant, plants, wishes)])
    linear = near(model, family, plant.x0, plant.u0, wishes.period)
    w = _frequencies(wishes)
    distances = np.linspace(0.0, wishes.largest, DISTANCES + 1)[1:]
    for name, k in zip(("all plants", "best fit alone"), chosen, strict=True):
        tell(len(chosen) + len(rows))
        c = controller_of(designs[k].parameters)
        stable, ms = poles(linear, c) < 1.0 - 1e-9, largest_sensitivity(linear, c, w, wishes.period)
        far = _caught([designs[k]], model, plant, family, wishes, distances)[0]
        weight, shake = pairs[k]
        rows.append(HoldRow(name, designs[k], weight, shake, stable, ms, far))
    return HoldDesign(wishes, model, plant, family, unstable, tuple(rows), distances)


def designed(plant: LinearPlant, wishes: HoldWishes, weight: float, shake: float) -> Design:
    """The regulator and its filter for a weight of the input and a noise of it that the filter expects."""
    sizes = np.array([wishes.sizes[n] for n in plant.outputs])
    q = plant.C.T @ np.diag(1.0 / sizes**2) @ plant.C
    half = 0.5 * (wishes.upper - wishes.lower)
    process = dict(zip(plant.states, np.abs(plant.B[:, 0]) * half * shake, strict=True))
    noise = {
        n: max(wishes.noise[n], wishes.quantum[n] / math.sqrt(12.0), 1e-9 * wishes.sizes[n]) for n in plant.outputs
    }
    estimator = kalman_observer(plant, wishes.period, process, noise)
    return lqr(
        plant,
        wishes.period,
        q,
        {wishes.input: weight / half**2},
        estimator=estimator,
        limits=(wishes.lower, wishes.upper),
    )


def _frequencies(wishes: HoldWishes) -> np.ndarray:
    return np.geomspace(1e-4 * math.pi / wishes.period, math.pi / wishes.period, FREQUENCIES)


def _linear_choice(
    designs: list[Design], model: Model, plant: LinearPlant, plants: Mapping[str, np.ndarray], wishes: HoldWishes
) -> list[int]:  # fmt: skip
    """Numbers of the designs that are worth a simulation: they hold most plants, with the Ms asked for or little
    more than the least."""
    linear, w = near(model, plants, plant.x0, plant.u0, wishes.period), _frequencies(wishes)
    stable, ms = [], []
    for d in designs:
        c = controller_of(d.parameters)
        stable.append(float(np.mean(poles(linear, c) < 1.0 - 1e-9)))
        ms.append(float(np.quantile(largest_sensitivity(linear, c, w, wishes.period), 0.9)))
    if not max(stable):
        raise SimulationError(
            "No regulator holds the plant at that point with this period; give a shorter one ([control] period)."
        )
    most = np.flatnonzero(np.array(stable) >= max(stable) - 1e-12)
    least = min(ms[k] for k in most)
    calm = [int(k) for k in most if ms[k] <= max(wishes.ms, ROOM * least)]
    calm.sort(key=lambda k: ms[k])
    return calm if len(calm) <= TRIED else [calm[i] for i in np.linspace(0, len(calm) - 1, TRIED).round().astype(int)]


def _closed(design: Design, model: Model, wishes: HoldWishes) -> Any:
    sensors = {n: Sensor(quantum=wishes.quantum[n]) for n in design.plant.outputs}
    actuator = Actuator(wishes.lower, wishes.upper)
    steps = max(1, math.ceil(float(np.max(np.abs(np.linalg.eigvals(design.plant.A)))) * wishes.period / QUICK))
    return design.close(model, sensor=sensors, actuator=actuator, stepper="rk4", substeps=steps)


def _farthest_of(
    kept: list[int], designs: list[Design], model: Model, plant: LinearPlant, plants: Mapping[str, np.ndarray],
    wishes: HoldWishes
) -> int:  # fmt: skip
    """Which of the designs `kept` catches the plants from farthest away: the tenth that are caught worst, to their
    worse side."""
    some = {n: v[:FEW] for n, v in plants.items()}
    distances = np.linspace(0.0, wishes.largest, DISTANCES + 1)[1:]
    far = _caught([designs[k] for k in kept], model, plant, some, wishes, distances)
    return int(np.argmax([np.quantile(np.min(v, axis=1), 0.1) + 1e-3 * np.mean(v) for v in far]))


def _caught(
    designs: list[Design], model: Model, plant: LinearPlant, plants: Mapping[str, np.ndarray], wishes: HoldWishes,
    distances: np.ndarray
) -> np.ndarray:  # fmt: skip
    """How far (designs, n, 2) below and above the point each plant may begin and return: the last of `distances`
    before one that fails."""
    loop = _closed(designs[0], model, wishes)
    stacked = jax.tree.map(lambda *v: jnp.stack([jnp.asarray(a) for a in v]), *(d.parameters for d in designs))
    x0 = dict(zip(plant.states, (float(v) for v in plant.x0), strict=True))
    samples = round(wishes.seconds / wishes.period)
    begin = round(0.85 * samples) * wishes.period
    watch = _farthest(tuple((n, float(v)) for n, v in zip(plant.outputs, plant.y0, strict=True)), begin)
    p = {n: jnp.asarray(v, dtype=float) for n, v in plants.items()}
    ways = jnp.asarray(np.concatenate([-distances, distances]))

    def one(parameters, p, distance):
        start = x0 | {wishes.along: x0[wishes.along] + distance}
        return loop.observe(watch, parameters, p, {}, samples=samples, x0=start)

    every = jit(jax.vmap(lambda d: jax.vmap(lambda p: jax.vmap(lambda far: one(d, p, far))(ways))(p)))
    good = np.asarray(every(stacked)) <= wishes.tolerance  # nan is not caught
    good = good.reshape(*good.shape[:-1], 2, len(distances))
    reached = np.cumprod(good, axis=-1).sum(axis=-1)
    return np.concatenate([[0.0], distances])[reached]
