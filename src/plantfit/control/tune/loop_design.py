"""A controller searched on all plants that the data allow, beside classical rules and beside the same search on the best fit alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.control.steps.robust import stacked_controllers
from plantfit.control.tune.forms import Form, lqi_form, mpc_form, pid_form
from plantfit.control.tune.frequency import Margins, frequencies, margins, sampled_response
from plantfit.control.tune.loop_scores import Judge, LoopScores, StepAndLoad
from plantfit.control.tune.one_loop import OneLoop, Rest
from plantfit.control.tune.plant_checks import check_dead_time, check_holds, check_reached, held_by_limits, sign_of, with_rest
from plantfit.control.tune.reduction import Reduced, integrators, reduced, slowest
from plantfit.control.tune.rules import RULES, rule_gains
from plantfit.control.tune.search import Search
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.control.tune.wishes import Wishes, check_wishes
from plantfit.errors import SimulationError

import jax

COARSE, FINE = 200, 1200  # frequencies in the search and in the figures
MOST_SAMPLES = 4000
ROBUST, BEST_FIT = "all plants", "best fit alone"  # names of the two that are searched
BESIDE = ", all plants"  # after the names of other forms that are searched on the same plants


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
    """One controller of the table: its name, `form`, `parameters` and `source`; `scores` and `margins` on the best fit, the `share` of
    plants that keep the wishes and the `worst` tenth of overshoot, Ms and IAE (their 90 % quantiles)."""

    name: str
    form: Form
    parameters: Any
    source: str
    scores: LoopScores
    margins: Margins
    share: float
    worst: Mapping[str, float]

    @property
    def gains(self) -> Gains:
        """Of a PID, in parallel form; raises SimulationError for another form."""
        if not isinstance(self.parameters, Gains):
            raise SimulationError(f"An {self.form.name} has no Kp, Ki and Kd; its parameters are {', '.join(self.parameters._fields)}.")
        return self.parameters


@dataclass(frozen=True, eq=False)
class LoopDesign:
    """The tuned controller: `rows` of the table, the first tuned on all plants, the second on the best fit alone, then on all plants
    the forms that are simpler, then the rules.

    `reduced` is what the rules saw, `sign` that of the plant's gain, `judged` all controllers on the fresh plants of `family` (its first is
    the best fit), `course` what they were judged by, `rest` the plants at the set point; `judges` by the name of a form. `held` is the
    share of plants that the input's limits can hold at both levels.
    """

    wishes: Wishes
    family: OneLoop
    rest: Rest
    course: StepAndLoad
    reduced: Reduced
    sign: int
    rows: tuple[Row, ...]
    judged: Judged
    judges: Mapping[str, Judge]
    held: float
    right_sign: float
    rows_used: np.ndarray
    tracking_time: float | None

    @property
    def best(self) -> Row:
        return self.rows[0]

    @property
    def judge(self) -> Judge:
        """Of the form that was asked for."""
        return self.judges[self.best.form.name]

    @property
    def promised(self) -> bool:
        """Whether the share of plants that was asked for keeps the wishes."""
        return self.best.share >= self.wishes.share

    def row(self, name: str) -> Row | None:
        return next((r for r in self.rows if r.name == name), None)


def tuned_loop(
    train: OneLoop,
    family: OneLoop,
    wishes: Wishes,
    *,
    budget: int = 500,
    seed: int = 1,
    progress: Callable[[Any], None] | None = None,
) -> LoopDesign:
    """Search the controller of `wishes` on the `train` plants; judge it on those of `family`. Both begin with the best fit.

    The cost on a plant is the mean of the IAE of set-point step and load, each over that of SIMC on the best fit (C. Grimholt, S.
    Skogestad, IFAC PID 2012, eq. 3), times 1 + 10 times every excess over a limit as a share of it; over plants `Demand.over_plants`:
    the mean of all and of the worst 1 - `share`.
    Raises SimulationError for a plant that is unstable, that has no gain, or that the limits cannot hold at the set point.
    """
    check_wishes(wishes)
    levels = (wishes.set_point - wishes.step, wishes.set_point)
    middle = (wishes.lower + 0.1 * (wishes.upper - wishes.lower), 0.5 * (wishes.lower + wishes.upper), wishes.upper)
    rests = [[plant.at_rest(level, middle) for level in levels] for plant in (train, family)]
    start, rest = rests[1]
    check_holds(family, start, rest, wishes)
    check_reached(family, rest)
    sign, wrong = sign_of(rest)
    whole = [with_rest(pair) for pair in rests]
    held, right = float(np.mean(held_by_limits(rests[1], wishes))), float(1.0 - np.mean(wrong))
    train, family = train.part(whole[0]), family.part(whole[1])
    first = [_part(r, whole[0]) for r in rests[0]]
    start, rest = (_part(r, whole[1]) for r in rests[1])
    small = reduced(rest, 0.5 * wishes.period)
    check_dead_time(small, wishes)
    course, tracking = _course(small, wishes), _tracking(small, wishes)
    rules = {n: isa for n in RULES if (isa := rule_gains(n, small, wishes.controller != "pi")) is not None}
    pid = pid_form(small, sign, wishes, rules, tracking)
    forms = [pid]
    if wishes.controller not in ("pid", "pi"):
        servo_plant = ServoPlant.of(rest, small, wishes)
        forms = [lqi_form(servo_plant, small, wishes), *forms]
        if wishes.controller == "mpc":
            forms = [mpc_form(servo_plant, small, wishes, forms[0].starts), *forms]
    judges = {form.name: Judge.of(family, start, course, wishes.quantum, form) for form in forms}
    slow, count = slowest(small), 1 + integrators(rest)
    w, fine = (frequencies(wishes.period, slow, number) for number in (COARSE, FINE))
    h, fine_h = sampled_response(first[1], wishes.period, w), sampled_response(rest, wishes.period, fine)
    alike = len(rules) + (2 if pid is forms[0] else 1)  # as many as are judged at the end, by the same program
    simc = judges[pid.name].scores(stacked_controllers([rules["SIMC"].gains()] * alike))
    step, load = (float(v[0, 0]) for v in (simc.iae, simc.load_iae))
    sizes = (step if 0 < step < np.inf else 1.0, load if 0 < load < np.inf else 1.0)
    named: list[tuple[str, Form, Any, str]] = []
    points: np.ndarray | None = None  # of the form before, which an MPC begins at: its weights are those of an LQI
    for form in reversed(forms):
        search = Search(Judge.of(train, first[0], course, wishes.quantum, form), h, w, wishes, form, sizes)
        starts = form.starts if form.plan is None or points is None else points
        nominal = search.on_best_fit().found(starts, max(200, budget // 2), seed, progress)
        robust = search.found(np.r_[starts, nominal[None]], budget, seed + 1, progress)
        points = np.stack([robust, nominal])
        best, alone = (_numbers(form.made(z)) for z in (robust, nominal))
        if form is forms[0]:
            named = [(ROBUST, form, best, "this search"), (BEST_FIT, form, alone, "the same search on one plant"), *named]
        else:
            named = [(form.name + BESIDE, form, best, f"the same search for {article(form.name)} {form.name}"), *named]
    named += [(n, pid, isa.gains(), RULES[n]) for n, isa in rules.items()]
    parts = []
    for form in forms:
        of_form = [parameters for _, other, parameters, _ in named if other is form]
        parts.append(judged_on(judges[form.name], form, of_form, fine_h, fine, wishes, count))
    order = np.argsort([k for form in forms for k, row in enumerate(named) if row[1] is form])
    found: Judged = jax.tree.map(lambda *arrays: np.concatenate(arrays)[order], *parts)
    rows = tuple(_row(i, row, found, rest, wishes, fine, count) for i, row in enumerate(named))
    used = np.flatnonzero(whole[1])
    return LoopDesign(wishes, family, rest, course, small, sign, rows, found, judges, held, right, used, tracking)


def article(name: str) -> str:
    """Before the name of a form."""
    return "an" if name[0] in "LM" else "a"


def _numbers(parameters: Any) -> Any:
    """Parameters as floats and arrays of numpy."""
    return jax.tree.map(lambda v: float(v) if np.ndim(v) == 0 else np.asarray(v), parameters)


def _part(rest: Rest, rows: np.ndarray) -> Rest:
    return Rest(*(getattr(rest, n)[rows] for n in ("x", "u", "A", "B", "C", "D", "late")))


def _tracking(small: Reduced, wishes: Wishes) -> float | None:
    """Back-calculation within the time of the reduced plant."""
    return max(slowest(small), wishes.period) if wishes.anti_windup == "back-calculation" else None


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
    ends = wishes.output_lower, wishes.output_upper
    return StepAndLoad(wishes.set_point - wishes.step, wishes.set_point, wishes.load, seconds, wishes.period, *ends)


def judged_on(
    judge: Judge, form: Form, controllers: Sequence[Any], h: np.ndarray, w: np.ndarray, wishes: Wishes, count: int
) -> Judged:  # fmt: skip
    """`Judged` of controllers of a form on the plants of a judge whose sampled responses are `h` (n, F); `count` poles of every loop lie
    at 1."""
    scores = judge.scores(stacked_controllers(list(controllers)))
    scores = LoopScores(*(np.asarray(v) for v in scores))
    ms, stable, moved = [], [], []
    weights = np.gradient(w) / np.pi * wishes.period
    for one in controllers:
        c = form.response(one, w)
        loop = c[None, :] * h
        seen = margins(loop, w, count, form.unstable(one))
        ms.append(seen.ms)
        stable.append(seen.stable)
        moved.append(wishes.noise * np.sqrt(np.sum(np.abs(c / (1.0 + loop)) ** 2 * weights, axis=-1)) / (wishes.upper - wishes.lower))
    ms, stable = np.array(ms), np.array(stable)
    with np.errstate(invalid="ignore"):
        kept = stable & (scores.overshoot <= wishes.overshoot) & (ms <= wishes.ms) & (scores.left <= wishes.settled)
        kept = kept & (scores.outside <= wishes.tolerated)
    return Judged(scores, ms, stable, np.array(moved), kept)


def _row(i: int, named: tuple[str, Form, Any, str], found: Judged, rest: Rest, wishes: Wishes, w: np.ndarray, count: int) -> Row:
    name, form, parameters, source = named
    first = LoopScores(*(float(v[i, 0]) for v in found.scores))
    h = sampled_response(_part(rest, np.array([0])), wishes.period, w)
    own = margins(form.response(parameters, w)[None, :] * h, w, count, form.unstable(parameters))
    own = Margins(*(v[0].item() for v in own))

    def high(values):
        return float(np.quantile(np.where(np.isfinite(values), values, np.inf), 0.9, method="higher"))

    worst = {"overshoot": high(found.scores.overshoot[i]), "ms": high(found.ms[i]), "iae": high(found.scores.iae[i])}
    return Row(name, form, parameters, source, first, own, float(np.mean(found.kept[i])), worst)
