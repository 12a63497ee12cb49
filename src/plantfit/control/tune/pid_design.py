"""A PID searched on all plants that the data allow, beside classical rules and beside the same search on the best fit alone."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.control.steps.robust import STEEPNESS, Demand, stacked_controllers
from plantfit.control.tune.frequency import Margins, frequencies, margins, pid_response, sampled_response
from plantfit.control.tune.loop_scores import Judge, LoopScores, StepAndLoad
from plantfit.control.tune.one_loop import OneLoop, Rest
from plantfit.control.tune.reduction import Reduced, gain_of, integrators, poles, reduced
from plantfit.control.tune.rules import FILTER, RULES, Isa, rule_gains
from plantfit.errors import SearchError, SimulationError
from plantfit.optimize import Objective, minimise
from plantfit.space import Parameter, Space

import jax
import jax.numpy as jnp

COARSE, FINE = 200, 1200  # frequencies in the search and in the figures
SETTLED = 0.05  # of the step: a loop that is farther off at the end of it does not hold the set point
MOST_SAMPLES = 4000
TAIL = 0.5  # of the plants that may miss a limit: the worst that the search looks at, so that fresh ones miss it no more often
ROOM = 0.95  # of a limit: what the search keeps, so that plants that it has not seen keep the limit
ROBUST, BEST_FIT = "all plants", "best fit alone"  # names of the two that are searched


@dataclass(frozen=True)
class Wishes:
    """What a loop is asked for, all in the units of the study.

    From rest at `set_point` - `step` to `set_point`, then `load` at the plant's input. `period` (s) of the controller, input limits,
    `quantum` of the sensor and standard deviation `noise` of the measurement. `overshoot` (%) and `ms` are limits that the `share` of
    the plants has to keep; `input_noise` is how much of the input's range the noise may move it (standard deviation). `horizon` (s) of
    step and load.
    """

    set_point: float
    step: float
    load: float
    period: float
    lower: float
    upper: float
    quantum: float = 0.0
    noise: float = 0.0
    overshoot: float = 10.0
    ms: float = 1.6
    share: float = 0.95
    input_noise: float = 0.05
    controller: str = "pid"
    horizon: float | None = None
    anti_windup: str = "clamping"

    @property
    def settled(self) -> float:
        """How far off the set point, as a share of the step, a loop may be at the end of the step: 5 %, or a step of the sensor."""
        return max(SETTLED, self.quantum / abs(self.step))


class Judged(NamedTuple):
    """Controllers on plants, arrays (controllers, plants): `scores`, `ms`, `stable`, standard deviation `input_noise` of the input by the
    noise (share of its range), `kept` whether the wishes are."""

    scores: LoopScores
    ms: np.ndarray
    stable: np.ndarray
    input_noise: np.ndarray
    kept: np.ndarray


@dataclass(frozen=True, eq=False)
class Row:
    """One controller of the table: its name, `gains`, `isa` form, its `source`; `scores` and `margins` on the best fit, the `share` of
    plants that keep the wishes and the `worst` tenth of overshoot, Ms and IAE (their 90 % quantiles)."""

    name: str
    gains: Gains
    source: str
    scores: LoopScores
    margins: Margins
    share: float
    worst: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class PidDesign:
    """The tuned PID: `rows` of the table, the first tuned on all plants, the second on the best fit alone, then the rules.

    `reduced` is what the rules saw, `sign` that of the plant's gain, `judged` all controllers on the fresh plants of `family` (its first is
    the best fit), `course` what they were judged by, `rest` the plants at the set point. `held` is the share of plants that the input's
    limits can hold at both levels.
    """

    wishes: Wishes
    family: OneLoop
    rest: Rest
    course: StepAndLoad
    reduced: Reduced
    sign: int
    rows: tuple[Row, ...]
    judged: Judged
    judge: Judge
    held: float
    right_sign: float
    rows_used: np.ndarray
    tracking_time: float | None

    @property
    def best(self) -> Row:
        return self.rows[0]

    @property
    def promised(self) -> bool:
        """Whether the share of plants that was asked for keeps the wishes."""
        return self.best.share >= self.wishes.share

    def row(self, name: str) -> Row | None:
        return next((r for r in self.rows if r.name == name), None)


def tuned_pid(
    train: OneLoop,
    family: OneLoop,
    wishes: Wishes,
    *,
    budget: int = 500,
    seed: int = 1,
    progress: Callable[[Any], None] | None = None,
) -> PidDesign:
    """Search a PID (or PI) whose loop keeps the `wishes` on the `train` plants; judge it on those of `family`. Both begin with the best
    fit.

    The cost on a plant is the mean of the IAE of set-point step and load, each over that of SIMC on the best fit (C. Grimholt, S.
    Skogestad, IFAC PID 2012, eq. 3), times 1 + 10 times every excess over a limit as a share of it; over plants `Demand.over_plants`:
    the mean of all and of the worst 1 - `share`.
    Raises SimulationError for a plant that is unstable, that has no gain, or that the limits cannot hold at the set point.
    """
    _check(wishes)
    levels = (wishes.set_point - wishes.step, wishes.set_point)
    middle = (wishes.lower + 0.1 * (wishes.upper - wishes.lower), 0.5 * (wishes.lower + wishes.upper), wishes.upper)
    rests = [[plant.at_rest(level, middle) for level in levels] for plant in (train, family)]
    start, rest = rests[1]
    _check_holds(family, start, rest, wishes)
    sign, wrong = _sign(rest)
    whole = [_whole(pair) for pair in rests]
    held, right = float(np.mean(_held(rests[1], wishes))), float(1.0 - np.mean(wrong))
    train, family = train.part(whole[0]), family.part(whole[1])
    first = [_part(r, whole[0]) for r in rests[0]]
    start, rest = (_part(r, whole[1]) for r in rests[1])
    small = reduced(rest, 0.5 * wishes.period)
    _check_dead_time(small, wishes)
    course = _course(small, wishes)
    options = (wishes.lower, wishes.upper, wishes.quantum, wishes.anti_windup, _tracking(small, wishes))
    judge, trained = Judge.of(family, start, course, *options), Judge.of(train, first[0], course, *options)
    slow, count = slowest(small), 1 + integrators(rest)
    w = frequencies(wishes.period, slow, COARSE)
    h = sampled_response(first[1], wishes.period, w)
    derivative = wishes.controller == "pid"
    rules = {name: isa for name in RULES if (isa := rule_gains(name, small, derivative)) is not None}
    search = _Search(trained, h, w, wishes, small, sign, derivative)
    nominal = search.of(slice(0, 1)).found(rules, max(200, budget // 2), seed, progress)
    robust = search.found({**rules, BEST_FIT: nominal}, budget, seed + 1, progress)
    named = {ROBUST: robust, BEST_FIT: nominal} | {n: isa.gains() for n, isa in rules.items()}
    fine = frequencies(wishes.period, slow, FINE)
    found = judged_on(judge, list(named.values()), sampled_response(rest, wishes.period, fine), fine, wishes, count)
    sources = {ROBUST: "this search", BEST_FIT: "the same search on one plant"} | RULES
    rows = tuple(_row(i, n, g, sources[n], found, rest, wishes, fine, count) for i, (n, g) in enumerate(named.items()))
    used = np.flatnonzero(whole[1])
    return PidDesign(wishes, family, rest, course, small, sign, rows, found, judge, held, right, used, options[-1])


def _part(rest: Rest, rows: np.ndarray) -> Rest:
    return Rest(*(getattr(rest, n)[rows] for n in ("x", "u", "A", "B", "C", "D", "late")))


def _tracking(small: Reduced, wishes: Wishes) -> float | None:
    """Back-calculation within the time of the reduced plant."""
    return max(slowest(small), wishes.period) if wishes.anti_windup == "back-calculation" else None


def slowest(small: Reduced) -> float:
    """Seconds that a reduced plant takes: its lag and its dead time."""
    _, lag, dead = small.first_order
    return (lag if np.isfinite(lag) else small.second_order[2]) + dead


def course_seconds(small: Reduced) -> float:
    """Seconds in which a loop settles after a step, and again after a load."""
    _, lag, dead = small.first_order
    return 2.0 * (40.0 * dead if small.integrating else max(6.0 * (lag + dead), 12.0 * dead))


def _course(small: Reduced, wishes: Wishes) -> StepAndLoad:
    seconds = wishes.horizon if wishes.horizon is not None else course_seconds(small)
    if seconds / wishes.period > 20 * MOST_SAMPLES:
        raise SimulationError(
            f"The loop takes {seconds:.4g} s to settle twice, {seconds / wishes.period:.0f} samples of {wishes.period:g} s; "
            f"give a longer period "
            f"([control] period, or --period), such as {seconds / MOST_SAMPLES:.2g} s, or a shorter horizon."
        )
    return StepAndLoad(wishes.set_point - wishes.step, wishes.set_point, wishes.load, seconds, wishes.period)


def _check(wishes: Wishes) -> None:
    for name, low in (("period", 0.0), ("overshoot", 0.0), ("ms", 1.0), ("input_noise", 0.0)):
        value = getattr(wishes, name)
        if not (math.isfinite(value) and value > low):
            raise SimulationError(f"{name} = {value:g} cannot be asked for; give a number above {low:g}.")
    if not 0 < wishes.share < 1:
        raise SimulationError(f"share = {wishes.share:g} cannot be promised; give a share of the plants between 0 and 1, such as 0.95.")
    if not wishes.lower < wishes.upper:
        raise SimulationError(f"The input's limits are {wishes.lower:g} and {wishes.upper:g}; give lower below upper.")
    if not wishes.step or not math.isfinite(wishes.step):
        raise SimulationError(f"A step of {wishes.step:g} moves nothing; give the change of the set point.")
    if wishes.controller not in ("pid", "pi"):
        raise SimulationError(f"Controller {wishes.controller!r} is not known; give 'pid' or 'pi'.")


def _inside(u: np.ndarray, wishes: Wishes, load: float = 0.0) -> np.ndarray:
    return (u - load >= wishes.lower) & (u - load <= wishes.upper) & np.isfinite(u)


def _held(rests: Sequence[Rest], wishes: Wishes) -> np.ndarray:
    return _inside(rests[0].u, wishes) & _inside(rests[1].u, wishes) & _inside(rests[1].u, wishes, wishes.load)


def _whole(rests: Sequence[Rest]) -> np.ndarray:
    """Plants (n,) with a rest at both levels; whether it lies within the limits shows in their loops."""
    whole = np.isfinite(rests[0].u) & np.isfinite(rests[1].u)
    whole[0] = True
    return whole


def _sign(rest: Rest) -> tuple[int, np.ndarray]:
    """Of the best fit's gain, and whether the others (n,) have another."""
    gains = np.array([_gain(rest, i) for i in range(len(rest.u))])
    if not np.isfinite(gains[0]) or gains[0] == 0:
        raise SimulationError(
            "The input does not move the output at the set point (its gain is 0); choose another input, output or set point, or measure "
            "with an input that moves it."
        )
    return int(np.sign(gains[0])), ~(np.sign(gains) == np.sign(gains[0]))


def _gain(rest: Rest, at: int) -> float:
    if not np.all(np.isfinite(rest.A[at])):
        return float("nan")
    return gain_of(rest, at)


def _check_holds(plant: OneLoop, start: Rest, rest: Rest, wishes: Wishes) -> None:
    """Of the best fit: stable, and within the limits at both levels and under the load."""
    unit_y, unit_u = plant.model.outputs[plant.output] or "", plant.model.inputs[plant.input] or ""
    for where, level in ((start, wishes.set_point - wishes.step), (rest, wishes.set_point)):
        u = float(where.u[0])
        if not np.isfinite(u):
            raise SimulationError(
                f"No constant {plant.input} holds {plant.output} at {level:.4g} {unit_y}: the model has no rest there. Choose "
                f"another set point "
                "or step."
            )
        if not wishes.lower <= u <= wishes.upper:
            raise SimulationError(
                f"{plant.output} at {level:.4g} {unit_y} takes {plant.input} = {u:.4g} {unit_u}, beyond its limits {wishes.lower:.4g} to "
                f"{wishes.upper:.4g} {unit_u}: they cannot hold that set point. {_reach(plant, wishes)}Choose another set point "
                f"or step, or "
                "give the limits of the actuator ([control] lower and upper, or --lower and --upper)."
            )
    u = float(rest.u[0]) - wishes.load
    if not wishes.lower <= u <= wishes.upper:
        raise SimulationError(
            f"Against a load of {wishes.load:.4g} {unit_u} {plant.output} at {wishes.set_point:.4g} {unit_y} takes "
            f"{plant.input} = {u:.4g} {unit_u}, "
            f"beyond its limits {wishes.lower:.4g} to {wishes.upper:.4g} {unit_u}; give a smaller load ([control] load, or --load)."
        )
    found = poles(rest)
    fastest = float(np.max(np.real(found)))
    if fastest > 1e-6 * max(float(np.max(np.abs(found))), 1e-9):
        raise SimulationError(
            f"The plant is unstable at {plant.output} = {wishes.set_point:.4g} {unit_y}: a pole at +{fastest:.4g} 1/s doubles a "
            f"deviation every "
            f"{math.log(2) / fastest:.3g} s. The rules and the search here are for stable and integrating plants; use lqr or mpc "
            "(docs/control.md)."
        )


def _reach(plant: OneLoop, wishes: Wishes) -> str:
    """The levels that the limits hold, where the model is near to linear in between; empty where that is not known."""
    lines = []
    for share in (0.35, 0.65):
        level = wishes.set_point - wishes.step + share * wishes.step
        lines.append((level, float(plant.part(slice(0, 1)).at_rest(level, (wishes.lower, wishes.upper)).u[0])))
    (y1, u1), (y2, u2) = lines
    if not np.isfinite(u1 + u2) or u1 == u2:
        return ""
    ends = sorted(y1 + (u - u1) * (y2 - y1) / (u2 - u1) for u in (wishes.lower, wishes.upper))
    return f"They hold about {ends[0]:.4g} to {ends[1]:.4g} {plant.model.outputs[plant.output] or ''}. "


def _check_dead_time(small: Reduced, wishes: Wishes) -> None:
    dead = small.first_order[2]
    if wishes.horizon is not None and wishes.horizon < 4.0 * dead:
        raise SimulationError(
            f"The horizon of {wishes.horizon:.4g} s is shorter than four times the dead time of {dead:.4g} s, so that nothing "
            f"can be judged in it; "
            f"give at least {8 * dead:.3g} s, or leave horizon out."
        )


@dataclass(frozen=True, eq=False)
class _Search:
    """Gains searched over the plants of `judge`, whose sampled responses are `h` (n, F) at w (F,)."""

    judge: Judge
    h: np.ndarray
    w: np.ndarray
    wishes: Wishes
    small: Reduced
    sign: int
    derivative: bool

    def of(self, rows: slice) -> "_Search":
        """The same on some of the plants."""
        start = self.judge.start
        part = Rest(*(getattr(start, n)[rows] for n in ("x", "u", "A", "B", "C", "D", "late")))
        judge = Judge(self.judge.plant.part(rows), part, self.judge.course, self.judge.loop)
        return _Search(judge, self.h[rows], self.w, self.wishes, self.small, self.sign, self.derivative)

    def _space(self) -> Space:
        simc = rule_gains("SIMC", self.small, self.derivative)
        assert simc is not None
        slow, dead = slowest(self.small), self.small.first_order[2]
        size = abs(simc.K)
        gains = {
            "K": Parameter((size / 50, size * 30), scale="log"),
            "Ti": Parameter((0.2 * dead, 30.0 * (slow + dead)), scale="log"),
            "b": Parameter((0.0, 1.0)),
        }
        if self.derivative:
            gains |= {"Td": Parameter((0.01 * dead, 2.0 * slow), scale="log"), "ratio": Parameter((2.0, 30.0), scale="log")}
        return Space(gains)

    def found(self, starts: Mapping[str, Isa | Gains], budget: int, seed: int, progress: Callable[[Any], None] | None) -> Gains:
        """The gains of least cost, the starts among those that are tried."""
        space, wishes = self._space(), self.wishes
        simc = rule_gains("SIMC", self.small, self.derivative)
        assert simc is not None
        base = self.judge.scores(stacked_controllers([simc.gains()]))
        sizes = [float(v) if np.isfinite(v) and v > 0 else 1.0 for v in (base.iae[0, 0], base.load_iae[0, 0])]
        demand = Demand(share=TAIL * (1.0 - wishes.share), mean=0.5)
        h, w = jnp.asarray(self.h), jnp.asarray(self.w)
        weights = np.gradient(self.w) / np.pi * wishes.period
        ms_limit = 1.0 + ROOM * (wishes.ms - 1.0)

        def gains_of(z):
            v = dict(zip(space.names, space.physical(z), strict=True))
            gain = self.sign * v["K"]
            td = v.get("Td", 0.0)
            return Gains(gain, gain / v["Ti"], gain * td, v["b"], 0.0, td / v.get("ratio", FILTER))

        def over(value, limit):
            return STEEPNESS * jnp.maximum(value / limit - 1.0, 0.0)

        @jax.jit
        def costs(zs):
            controllers = jax.vmap(gains_of)(zs)
            scores = self.judge.scores(controllers)

            def response(gains):
                c = pid_response(gains, wishes.period, w, jnp)
                return 1.0 / (1.0 + c * h), c

            s, c = jax.vmap(response)(controllers)
            ms = jnp.max(jnp.abs(s), axis=-1)
            moved = wishes.noise * jnp.sqrt(jnp.sum(jnp.abs(c[:, None] * s) ** 2 * weights, axis=-1)) / (wishes.upper - wishes.lower)
            cost = 0.5 * (scores.iae / sizes[0] + scores.load_iae / sizes[1])
            cost = cost * (1.0 + over(scores.overshoot, ROOM * wishes.overshoot) + over(ms, ms_limit) + over(moved, wishes.input_noise))
            cost = cost * (1.0 + STEEPNESS * jnp.maximum(scores.left - wishes.settled, 0.0))
            return demand.over_plants(jnp.where(jnp.isfinite(cost), cost, 1e6))

        begin = np.stack([np.clip(space.cube(_coordinates(g, space.names)), 0.0, 1.0) for g in starts.values()])
        first = np.asarray(costs(begin))
        best = begin[np.argsort(first)[:1]]
        runs = minimise(Objective(space.dimension, costs, start=best), "cmaes", budget=budget, runs=1, seed=seed, progress=progress)
        run = min(runs, key=lambda r: r.cost)
        x = run.x if run.cost < np.min(first) else best[0]
        if min(run.cost, np.min(first)) >= 1e5:
            raise SearchError(
                "No PID within the bounds of the search keeps the plants that the data allow finite; give a longer period or "
                "wider limits, or "
                "measure again."
            )
        return Gains(*(float(v) for v in gains_of(np.asarray(x))))


def _coordinates(gains: Isa | Gains, names: Sequence[str]) -> np.ndarray:
    if isinstance(gains, Gains):
        isa, ratio = isa_of(gains), (gains.Kd / gains.Kp / gains.filter_time if gains.filter_time > 0 else FILTER)
    else:
        isa, ratio = gains, FILTER
    values = {"K": abs(isa.K), "Ti": isa.Ti, "Td": max(isa.Td, 1e-12), "b": isa.b, "ratio": ratio}
    return np.array([values[n] for n in names])


def isa_of(gains: Gains) -> Isa:
    """The ideal form of parallel gains."""
    return Isa(gains.Kp, gains.Kp / gains.Ki if gains.Ki else math.inf, gains.Kd / gains.Kp if gains.Kp else 0.0, gains.b)


def judged_on(judge: Judge, gains: Sequence[Gains], h: np.ndarray, w: np.ndarray, wishes: Wishes, count: int) -> Judged:
    """`Judged` of controllers on the plants of a judge whose sampled responses are `h` (n, F); `count` poles of every loop lie at 1."""
    scores = jax.jit(judge.scores)(stacked_controllers(list(gains)))
    scores = LoopScores(*(np.asarray(v) for v in scores))
    ms, stable, moved = [], [], []
    weights = np.gradient(w) / np.pi * wishes.period
    for one in gains:
        c = pid_response(one, wishes.period, w)
        loop = c[None, :] * h
        seen = margins(loop, w, count)
        ms.append(seen.ms)
        stable.append(seen.stable)
        moved.append(wishes.noise * np.sqrt(np.sum(np.abs(c / (1.0 + loop)) ** 2 * weights, axis=-1)) / (wishes.upper - wishes.lower))
    ms, stable = np.array(ms), np.array(stable)
    with np.errstate(invalid="ignore"):
        kept = stable & (scores.overshoot <= wishes.overshoot) & (ms <= wishes.ms) & (scores.left <= wishes.settled)
    return Judged(scores, ms, stable, np.array(moved), kept)


def _row(
    i: int, name: str, gains: Gains, source: str, found: Judged, rest: Rest, wishes: Wishes, w: np.ndarray, count: int
) -> Row:  # fmt: skip
    first = LoopScores(*(float(v[i, 0]) for v in found.scores))
    h = sampled_response(_part(rest, np.array([0])), wishes.period, w)
    own = margins(pid_response(gains, wishes.period, w)[None, :] * h, w, count)
    own = Margins(*(v[0].item() for v in own))

    def high(values):
        return float(np.quantile(np.where(np.isfinite(values), values, np.inf), 0.9, method="higher"))

    worst = {"overshoot": high(found.scores.overshoot[i]), "ms": high(found.ms[i]), "iae": high(found.scores.iae[i])}
    return Row(name, gains, source, first, own, float(np.mean(found.kept[i])), worst)
