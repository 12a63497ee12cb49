"""A controller searched on all plants that the data allow, beside classical rules and beside the same search on the best fit alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.control.steps.robust import stacked_controllers
from plantfit.control.tune.forms.cascade_form import cascade_form
from plantfit.control.tune.forms.form import Form
from plantfit.control.tune.forms.pid_form import pid_form
from plantfit.control.tune.forms.servo_forms import lqi_form, mpc_form
from plantfit.control.tune.forms.smith_form import smith_form
from plantfit.control.tune.frequency import Margins, frequencies, loop_margins, noise_at_input, open_loop, sampled_response
from plantfit.control.tune.loop_scores import Judge, LoopScores, StepAndLoad
from plantfit.control.tune.one_loop import OneLoop, Rest
from plantfit.control.tune.plant_checks import check_dead_time, check_holds, check_inner, check_reached, held_by_limits, sign_of, with_rest
from plantfit.control.tune.reduction import Reduced, integrators, reduced, slowest
from plantfit.control.tune.rules import RULES, rule_gains
from plantfit.control.tune.searching.figures import figure, known_figures, sizes_of, weights_of
from plantfit.control.tune.searching.front import Front, check_front, front_of
from plantfit.control.tune.searching.search import Search, noises
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.control.tune.wishes import Wishes, check_wishes
from plantfit.errors import SimulationError, SpecError

import jax

COARSE, FINE = 200, 1200  # frequencies in the search and in the figures
MOST_SAMPLES = 4000
STARTED = 8  # starts of a form that a front is begun at too
ROBUST, BEST_FIT = "all plants", "best fit alone"  # names of the two that are searched
BESIDE = ", all plants"  # after the names of other forms that are searched on the same plants


class Judged(NamedTuple):
    """Controllers on plants, arrays (controllers, plants): `scores`, `ms`, `stable`, standard deviation `input_noise` of the input by the
    noise (share of its range), `kept` whether all wishes are, `meets` (controllers, plants, k) which `specifications` are, each alone."""

    scores: LoopScores
    ms: np.ndarray
    stable: np.ndarray
    input_noise: np.ndarray
    kept: np.ndarray
    meets: np.ndarray


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
class JudgedFront:
    """A front of controllers: the `names` of its figures, their values (k, m) on the best fit, in units, the share of plants (k,) that
    keep the wishes, and which was `picked`, from 1 on."""

    names: tuple[str, ...]
    controllers: tuple[Any, ...]
    figures: np.ndarray
    shares: np.ndarray
    picked: int | None


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
    front: JudgedFront | None = None

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

    @property
    def alike(self) -> bool:
        """Whether IAE is all that was made small, so that IAE tells what not knowing the plant costs."""
        return set(self.wishes.minimise) <= {"iae", "load_iae"} and (self.front is None or self.front.picked is None)

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
    front: tuple[str, ...] = (),
    points: int = 9,
    pick: int | None = None,
) -> LoopDesign:
    """Search the controller of `wishes` on the `train` plants; judge it on those of `family`. Both begin with the best fit.

    The cost on a plant is the mean of the IAE of set-point step and load, each over that of SIMC on the best fit (C. Grimholt, S.
    Skogestad, IFAC PID 2012, eq. 3), times 1 + 10 times every excess over a limit as a share of it; over plants `Demand.over_plants`:
    the mean of all and of the worst 1 - `share`. `Wishes.minimise` may weigh other figures in place of both IAE. With `front`, two or three
    figures, `points` controllers none of which is better in all of them are searched besides; number `pick` of them is the one tuned.
    Raises SimulationError for a plant that is unstable, that has no gain, or that the limits cannot hold at the set point.
    """
    check_wishes(wishes)
    known_figures(tuple(wishes.minimise), "minimise")
    known_figures(front, "front")
    if front:
        check_front(front, points)
    elif pick is not None:
        raise SpecError("pick chooses a point of a front; give front too, as in iae,input_noise.")
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
    forms = [*_ahead_of_pid(family, rest, small, sign, wishes, tracking), pid]
    judges = {form.name: Judge.of(family, start, course, wishes.quantum, form, wishes.inner_quantum) for form in forms}
    slow, count = slowest(small), integrators(rest)
    w, fine = (frequencies(wishes.period, slow, number) for number in (COARSE, FINE))
    alike = len(rules) + (2 if pid is forms[0] else 1)  # as many as are judged at the end, by the same program
    simc = judges[pid.name].scores(stacked_controllers([rules["SIMC"].gains()] * alike))
    sizes = sizes_of(simc, wishes, 0.5 * course.seconds)
    named: list[tuple[str, Form, Any, str]] = []
    line: Front | None = None
    at_last: np.ndarray | None = None  # points of the form before, which an MPC begins at: its weights are those of an LQI
    for form in reversed(forms):
        h = responses_of(train, first[1], form, wishes.period, w)
        judge = Judge.of(train, first[0], course, wishes.quantum, form, wishes.inner_quantum)
        search = Search(judge, h, w, wishes, form, sizes, weights_of(wishes.minimise))
        starts = form.starts if form.plan is None or at_last is None else at_last
        nominal = search.on_best_fit().found(starts, max(200, budget // 2), seed, progress)
        robust = search.found(np.r_[starts, nominal[None]], budget, seed + 1, progress)
        at_last = np.stack([robust, nominal])
        source = "this search"
        if front and form is forms[0]:
            known = np.concatenate([at_last, starts[:STARTED]])
            line = front_of(search, front, known, points, max(300, budget), seed + 2, progress)
            robust, source = _picked(line, pick, robust)
        best, alone = (_numbers(form.made(z)) for z in (robust, nominal))
        if form is forms[0]:
            named = [(ROBUST, form, best, source), (BEST_FIT, form, alone, "the same search on one plant"), *named]
        else:
            named = [(form.name + BESIDE, form, best, f"the same search for {article(form.name)} {form.name}"), *named]
    named += [(n, pid, isa.gains(), RULES[n]) for n, isa in rules.items()]
    parts = []
    for form in forms:
        of_form = [parameters for _, other, parameters, _ in named if other is form]
        h = responses_of(family, rest, form, wishes.period, fine)
        parts.append(judged_on(judges[form.name], form, of_form, h, fine, wishes, count + form.integrators))
    order = np.argsort([k for form in forms for k, row in enumerate(named) if row[1] is form])
    found: Judged = jax.tree.map(lambda *arrays: np.concatenate(arrays)[order], *parts)
    alone = family.part(np.array([0])), _part(rest, np.array([0]))
    rows = tuple(
        row_of(i, row, found, fine, responses_of(*alone, row[1], wishes.period, fine), count + row[1].integrators)
        for i, row in enumerate(named)
    )  # fmt: skip
    used = np.flatnonzero(whole[1])
    drawn = None if line is None else _judged_front(
        line, judges[forms[0].name], forms[0], responses_of(family, rest, forms[0], wishes.period, fine), fine, wishes,
        count + forms[0].integrators, pick,
    )  # fmt: skip
    return LoopDesign(wishes, family, rest, course, small, sign, rows, found, judges, held, right, used, tracking, drawn)


def _picked(line: Front, pick: int | None, robust: np.ndarray) -> tuple[np.ndarray, str]:
    """The point of the front that was chosen, from 1 on, and where it is from. Raises SpecError for a number that there is not."""
    if pick is None:
        return robust, "this search"
    if not 1 <= pick <= len(line.points):
        raise SpecError(f"The front has {len(line.points)} points, and pick = {pick} is none of them; give 1 to {len(line.points)}.")
    return line.points[pick - 1], f"point {pick} of {len(line.points)} of the front"


def _judged_front(
    line: Front, judge: Judge, form: Form, h: np.ndarray, w: np.ndarray, wishes: Wishes, count: int, pick: int | None
) -> JudgedFront:  # fmt: skip
    """The points of a front on the fresh plants: their figures on the best fit, in units, and the share of plants that keep the wishes."""
    controllers = [_numbers(form.made(z)) for z in line.points]
    found = judged_on(judge, form, controllers, h, w, wishes, count)
    half = 0.5 * judge.course.seconds
    first = [np.asarray(figure(n, found.scores, found.input_noise, half))[:, 0] for n in line.names]
    return JudgedFront(line.names, tuple(controllers), np.stack(first, axis=1), np.mean(found.kept, axis=1), pick)


def _ahead_of_pid(family: OneLoop, rest: Rest, small: Reduced, sign: int, wishes: Wishes, tracking: float | None) -> list[Form]:
    """The form that was asked for, then simpler ones of its kind; none where that is a PID, which stands beside all of them."""
    if wishes.controller in ("pid", "pi"):
        return []
    if wishes.controller == "cascade":
        if family.inner is None:
            raise SimulationError("A cascade measures two outputs; name the inner one ([control] inner, or --inner).")
        inner = family.of_inner(rest)
        check_inner(family, inner)
        names = family.output, family.inner
        return [cascade_form(small, reduced(inner, 0.5 * wishes.period), names, wishes, tracking)]
    plant = ServoPlant.of(rest, small, wishes)
    if wishes.controller == "smith":
        return [smith_form(plant, small, sign, wishes, tracking)]
    lqi = lqi_form(plant, small, wishes)
    return [mpc_form(plant, small, wishes, lqi.starts), lqi] if wishes.controller == "mpc" else [lqi]


def responses_of(plant: OneLoop, rest: Rest, form: Form, period: float, w: np.ndarray) -> np.ndarray:
    """The sampled responses (n, F) of plants that a form takes, (n, 2, F) of both outputs that a cascade measures."""
    outer = sampled_response(rest, period, w)
    return np.stack([outer, sampled_response(plant.of_inner(rest), period, w)], axis=1) if form.inner else outer


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
    """`Judged` of controllers of a form on the plants of a judge whose sampled responses are `h` (n, F), or (n, 2, F); `count` poles of
    every loop lie at 1."""
    scores = judge.scores(stacked_controllers(list(controllers)))
    scores = LoopScores(*(np.asarray(v) for v in scores))
    ms, stable, moved, wide = [], [], [], []
    weights = np.gradient(w) / np.pi * wishes.period
    for one in controllers:
        c = form.response(one, w)
        s = 1.0 / (1.0 + open_loop(c, h))
        seen = loop_margins(c, h, w, count, form.unstable(one))
        ms.append(seen.ms)
        stable.append(seen.stable)
        wide.append(np.stack([seen.gain >= wishes.gain_margin, seen.phase >= wishes.phase_margin], axis=-1))
        moved.append(noise_at_input(c, s, weights, noises(wishes, form.inner)))
    ms, stable = np.array(ms), np.array(stable)
    with np.errstate(invalid="ignore"):
        met = [
            stable, scores.overshoot <= wishes.overshoot, ms <= wishes.ms, scores.left <= wishes.settled,
            scores.outside <= wishes.tolerated, np.array(wide)[..., 0], np.array(wide)[..., 1], scores.settling <= wishes.settling,
            scores.travel <= wishes.travel,
        ]  # fmt: skip
    meets = np.stack(met, axis=-1)
    return Judged(scores, ms, stable, np.array(moved), np.all(meets, axis=-1), meets)


def specifications(wishes: Wishes) -> dict[str, int]:
    """What is asked for by name, with its place in `Judged.meets`; the last ones only where they are given."""
    asked = {"stable": 0, f"overshoot {wishes.overshoot:g} %": 1, f"Ms {wishes.ms:g}": 2, "at the set point": 3}
    ends = np.isfinite(wishes.output_lower) or np.isfinite(wishes.output_upper)
    more = {
        "within the limits": (4, ends), f"gain margin {wishes.gain_margin:g}": (5, wishes.gain_margin > 1),
        f"phase margin {wishes.phase_margin:g} deg": (6, wishes.phase_margin > 0),
        f"settling {wishes.settling:.4g} s": (7, np.isfinite(wishes.settling)),
        f"travel {wishes.travel:.4g}": (8, np.isfinite(wishes.travel)),
    }  # fmt: skip
    return asked | {name: k for name, (k, given) in more.items() if given}


def row_of(i: int, named: tuple[str, Form, Any, str], found: Judged, w: np.ndarray, h: np.ndarray, poles: int) -> Row:
    """A row of the table: name, form, parameters and source of controller number `i` of `found`; `h` is the sampled response of the best
    fit, `poles` count those of its loop at 1."""
    name, form, parameters, source = named
    first = LoopScores(*(float(v[i, 0]) for v in found.scores))
    own = loop_margins(form.response(parameters, w), h, w, poles, form.unstable(parameters))
    own = Margins(*(v[0].item() for v in own))

    def high(values):
        return float(np.quantile(np.where(np.isfinite(values), values, np.inf), 0.9, method="higher"))

    worst = {"overshoot": high(found.scores.overshoot[i]), "ms": high(found.ms[i]), "iae": high(found.scores.iae[i])}
    return Row(name, form, parameters, source, first, own, float(np.mean(found.kept[i])), worst)
