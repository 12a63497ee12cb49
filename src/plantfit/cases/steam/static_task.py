"""The static task: four constants for each opening, in the paper's two steps and jointly, and what its dead times
are worth."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.steam.problems import STATIC_START, opening_costs, static_problem
from plantfit.native.kept_programs import kept
from plantfit.optimize import minimise
from plantfit.optimize.contract import CostOfData, KeptCosts, Objective
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.rig.steam_chamber import SteamChamberRig
from plantfit.study.objective import objective_of
from plantfit.trust.finish.refit import refit
from plantfit.trust.validate.dead_time import DeadTime, dead_time

import jax.numpy as jnp

WINDOW = 2.0  # s, from which the paper takes the dead time
NAMES = tuple(STATIC_START)
STEP = "step"


@dataclass(frozen=True)
class StaticTask:
    """`constants` {opening: {name: value}}, `costs` (bar^2) of the openings, and of every run (openings, runs) that
    of its last step."""

    label: str
    constants: Mapping[str, Mapping[str, float]]
    costs: Mapping[str, float]
    runs: np.ndarray
    evaluations: float

    @property
    def total(self) -> float:
        """The paper's cost, equation (7), bar^2."""
        return float(sum(self.costs.values()))


def joint(recordings: Mapping[str, Recording], seed: int = 0) -> StaticTask:
    """All four constants at once on whole records, by bounded least squares with restarts."""
    problem = static_problem(recordings)
    [found] = minimise(objective_of(problem), "least_squares", budget=3000, seed=seed)
    costs = opening_costs(problem, found.x)
    values = problem.space.names, np.asarray(problem.space.physical(found.x))
    return StaticTask("joint, least squares", _by_opening(*values), costs, _column(costs), found.evaluations)


def two_step(recordings: Mapping[str, Recording], seed: int = 0) -> StaticTask:
    """The paper's two steps, both by bounded least squares: Td >= 0.1 from the first 2 s, then the rest on whole
    records."""
    early, whole = static_problem(recordings, until=WINDOW, dead_time=(0.1, 1.0)), static_problem(recordings)
    [first] = minimise(objective_of(early), "least_squares", budget=3000, seed=seed)
    late = np.array([c.parameter == "Td" for c in whole.space.coordinates])
    start = whole.space.start
    assert start is not None  # `static_problem` has the paper's
    start = np.where(late, whole.space.cube(np.asarray(early.space.physical(first.x))), start)
    z, _ = refit(whole, start, ~late, 1e-9)
    costs = opening_costs(whole, z)
    values = whole.space.names, np.asarray(whole.space.physical(z))
    return StaticTask("two steps, least squares", _by_opening(*values), costs, _column(costs), first.evaluations)


def two_step_by(
    recordings: Mapping[str, Recording], method: str, runs: int = 10, budget: int = 3000, seed: int = 0
) -> StaticTask:
    """The same by a method of the portfolio, `runs` of it and `budget` evaluations for each step of each opening, as in
    the paper.

    Every run begins at the paper's start; L-BFGS-B then goes on from random points until its budget is spent.
    """
    constants, costs, every, spent = {}, {}, [], 0.0
    early, longest = None, max(recordings.values(), key=lambda r: len(r.t))
    held = DeadTimeHeld(static_problem({STEP: longest}))
    for name, recording in recordings.items():
        first = {STEP: beginning(recording)}
        early = static_problem(first, dead_time=(0.1, 1.0)) if early is None else early.with_recordings(first)
        began = minimise(_compiled_once(early), method, runs=runs, budget=budget, seed=seed)
        best = min(began, key=lambda r: r.cost)
        late = float(np.asarray(early.space.physical(best.x))[early.space.names.index(f"Td[{STEP}]")])
        whole = static_problem({STEP: as_long_as(recording, longest)}, dead_time=late)
        found = minimise(held.objective(whole, late), method, runs=runs, budget=budget, seed=seed)
        best = min(found, key=lambda r: r.cost)
        values = np.asarray(whole.space.physical(best.x))
        constants[name] = {n.split("[")[0]: float(v) for n, v in zip(whole.space.names, values, strict=True)} | {
            "Td": late
        }
        costs[name], spent = (
            best.cost,
            spent + float(np.mean([a.evaluations + b.evaluations for a, b in zip(began, found, strict=True)])),
        )
        every.append([r.cost for r in found])
    return StaticTask(f"two steps, {method}", constants, costs, np.array(every), spent)


def _compiled_once(problem: Problem) -> Objective:
    """What a search sees of a problem, by programs that serve all openings of as many samples."""
    program = problem.compiled["costs"]
    return replace(objective_of(problem), costs=CostOfData(KeptCosts(program, program.around, kept), problem.arguments))


@dataclass(frozen=True, eq=False)
class DeadTimeHeld:
    """Searches of k, A1, A2 with the dead time held, by programs that serve all openings: those of `free`, a problem of
    all four constants on a record that no other is longer than."""

    free: Problem

    def objective(self, problem: Problem, late: float) -> Objective:
        """What a search sees of `problem`, which holds the dead time at `late` (s), on a record `as_long_as` the free
        one."""
        numbers, count = problem.arguments, sum(problem.parts.counts.values())
        ends = numbers.records and numbers.records._replace(used=np.array([count + 1]))  # the first is not scored
        data = numbers._replace(records=ends, count=np.float64(count)), np.array([late])
        costs = CostOfData(KeptCosts(self.costs, self._kept, kept), data)
        return replace(objective_of(problem), costs=costs, value_and_gradient=partial(self._value_and_gradient, data))

    def costs(self, zs: Any, data: Any) -> Any:
        """Costs (n,) at points (n, 3) of the problem with the dead time held."""
        numbers, late = data
        return self.free.compiled["costs"](_beside(zs, late), numbers)

    def _kept(self, function: Callable, name: str, thing: Any) -> Any:
        return self.free.compiled["costs"].around(function, name, ("dead time held", thing))

    def _value_and_gradient(self, data: Any, z: np.ndarray) -> tuple[float, np.ndarray]:
        numbers, late = data
        f, g = self.free.compiled["values_and_gradients"](np.append(z, late)[None], numbers)
        return float(np.asarray(f)[0]), np.asarray(g)[0, :-1]


def _beside(zs: Any, late: Any) -> Any:
    """Points (n, 4) of the free problem; its coordinate of the dead time is the dead time in s."""
    return jnp.concatenate([zs, jnp.broadcast_to(late, (zs.shape[0], 1))], axis=1)


def as_long_as(recording: Recording, longest: Recording) -> Recording:
    """The record with samples of which no output was measured behind its last one."""
    n, more = len(recording.t), len(longest.t) - len(recording.t)
    t = np.append(recording.t, recording.t[-1] + (longest.t[n:] - longest.t[n - 1]))
    signals = {
        k: Signal(np.append(s.values, np.full(more, np.nan if k == "y" else s.values[-1])), s.unit)
        for k, s in recording.signals.items()
    }
    return Recording(t, signals, recording.name, (*recording.log, f"Filled up to {t[-1]:g} s."))


def beginning(recording: Recording, until: float = WINDOW) -> Recording:
    """The samples up to `until` s."""
    n = int(np.searchsorted(recording.t, until + 1e-6))
    signals = {k: Signal(s.values[:n], s.unit) for k, s in recording.signals.items()}
    return Recording(recording.t[:n], signals, STEP, (*recording.log, f"Cut to {until:g} s."))


def early_dead_times(recordings: Mapping[str, Recording], until: float = WINDOW) -> dict[str, DeadTime]:
    """The dead time of every opening from its first `until` s, with its interval, Td free in 0 to 1 s.

    So early the pressure has hardly moved and constants stand for the tables; on whole records they do not, and the
    dead time takes up the error of the model.
    """
    found, problem = {}, None
    for name, recording in recordings.items():
        cut = {STEP: beginning(recording, until)}
        problem = static_problem(cut) if problem is None else problem.with_recordings(cut)
        found[name] = dead_time(problem, problem.space.start)
    return found


@dataclass(frozen=True)
class DelayStudy:
    """Over records of one opening: how often the interval held the truth, its median half width (s), the mean error
    and its rms (s), and how often the record told the dead time at all."""

    opening: float
    noise: float
    bits: int
    coverage: float
    half_width: float
    bias: float
    rms: float
    told: float


def delay_study(noise: float, bits: int, opening: float, seeds: range, until: float = WINDOW) -> DelayStudy:
    """`early_dead_times` of many records of one opening on a rig of this noise (bar) and card."""
    rig = SteamChamberRig(noise=noise, bits=bits)
    truth = float(rig.truth(opening)["Td"])
    found = list(early_dead_times({str(k): rig.record(opening, k, until).recording for k in seeds}, until).values())
    low, high = np.array([d.interval for d in found]).T
    error = np.array([d.value for d in found]) - truth
    return DelayStudy(
        opening, noise, bits, float(np.mean((low <= truth) & (truth <= high))), float(np.median(0.5 * (high - low))),
        float(np.mean(error)),
        float(np.sqrt(np.mean(error**2))), float(np.mean([d.determined for d in found])),
    )  # fmt: skip


def _by_opening(names: tuple[str, ...], values: np.ndarray) -> dict[str, dict[str, float]]:
    constants: dict[str, dict[str, float]] = {}
    for name, value in zip(names, values, strict=True):
        parameter, opening = name[:-1].split("[")
        constants.setdefault(opening, {})[parameter] = float(value)
    return constants


def _column(costs: Mapping[str, float]) -> np.ndarray:
    return np.array(list(costs.values()))[:, None]
