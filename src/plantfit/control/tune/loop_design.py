"""A controller searched on all plants that the data allow, beside classical rules and beside the same search on the
best fit alone."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.steps.robust import stacked_controllers
from plantfit.control.tune.forms.cascade_form import cascade_form
from plantfit.control.tune.forms.form import Form
from plantfit.control.tune.forms.pid_form import pid_form
from plantfit.control.tune.forms.servo_forms import lqi_form, mpc_form
from plantfit.control.tune.forms.smith_form import smith_form
from plantfit.control.tune.frequency import frequencies, noise_in_moves, open_loop, sampled_response
from plantfit.control.tune.loop_scores import Judge, LoopScores, StepAndLoad
from plantfit.control.tune.one_loop import OneLoop, Rest
from plantfit.control.tune.plant_checks import (
    check_dead_time,
    check_holds,
    check_inner,
    check_reached,
    held_by_limits,
    sign_of,
    with_rest,
)
from plantfit.control.tune.reduction import Reduced, behind, gain_of, integrators, open_poles, reduced, slowest
from plantfit.control.tune.rules import RULES, Isa, rule_gains
from plantfit.control.tune.searching.figures import figure, known_figures, sizes_of, weights_of
from plantfit.control.tune.searching.front import Front, check_front, directions, front_of
from plantfit.control.tune.searching.judged import Judged, Row, judged_on, row_of
from plantfit.control.tune.searching.parts import Searches, begins
from plantfit.control.tune.searching.search import Search, noises
from plantfit.control.tune.weights.servo_weights import ServoPlant
from plantfit.control.tune.wishes import Wishes, check_wishes
from plantfit.errors import SimulationError, SpecError

import jax

COARSE, FINE = 200, 1200  # frequencies in the search and in the figures
MOST_SAMPLES = 4000
MOVES = 6.0  # times that of several integrators under a full input, in which a loop settles
PAIR = 2  # candidates for each that a budget names: a generation is twice as large as usual in the same time
# searches on the best fit alone, whose seeds are apart from all others, and evaluations of each, at least and for each
# that a budget names: they take a hundredth of the time
ALONE_SEARCHES, APART = 4, 1000
ALONE_LEAST, ALONE_TIMES = 800, 3
NEAR = 0.06  # first step of the search on all plants, from what is best on the best fit: their best is not far from it
STARTED = 8  # starts of a form that a front is begun at too
ROBUST, BEST_FIT = "all plants", "best fit alone"  # names of the two that are searched
BESIDE = ", all plants"  # after the names of other forms that are searched on the same plants


@dataclass(frozen=True, eq=False)
class JudgedFront:
    """A front of controllers: the `names` of its figures, their values (k, m) on the best fit, in units, the share
    of plants (k,) that keep the wishes, and which was `picked`, from 1 on."""

    names: tuple[str, ...]
    controllers: tuple[Any, ...]
    figures: np.ndarray
    shares: np.ndarray
    picked: int | None


@dataclass(frozen=True, eq=False)
class LoopDesign:
    """The tuned controller: `rows` of the table, the first tuned on all plants, the second on the best fit alone, then
    on all plants the forms that are simpler, then the rules.

    `reduced` is what the rules saw, `sign` that of the plant's gain, `judged` all controllers on the fresh plants of
    `family` (its first is the best fit), `course` what they were judged by, `rest` the plants at the set point;
    `judges` by the name of a form. `held` is the share of plants that the input's limits can hold at both levels.
    The first row was found by `search` at the `point` (d,) of its cube.
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
    search: Search | None = None
    point: np.ndarray | None = None

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
    """Search the controller of `wishes` on the `train` plants; judge it on those of `family`. Both begin with the best
    fit. `budget` counts pairs of controllers that are tried on all plants; on the best fit alone, where they take
    little time, more are.

    The cost on a plant is the mean of the IAE of set-point step and load, each over that of SIMC on the best fit (C.
    Grimholt, S. Skogestad, IFAC PID 2012, eq. 3), times 1 + 10 times every excess over a limit as a share of it; over
    plants `Demand.over_plants`: the mean of all and of the worst 1 - `share`. `Wishes.minimise` may weigh other figures
    in place of both IAE. With `front`, two or three figures, `points` controllers none of which is better in all of
    them are searched besides; number `pick` of them is the one tuned. Raises SimulationError for a plant that is
    unstable, that has no gain, or that the limits cannot hold at the set point.
    """
    _check_asked(wishes, front, points, pick)
    begins(progress, "bringing the plants to rest")
    plants = _plants(train, family, wishes)
    small = plants.small
    rules, forms = _forms(plants, wishes)
    judges = {form.name: plants.judge(form, wishes) for form in forms}
    swing = [rest.A for rest in plants.rests]
    w, fine = (frequencies(wishes.period, slowest(small), number, *swing) for number in (COARSE, FINE))
    begins(progress, "judging a classical rule")
    sizes = sizes_of(_by_rule(plants, wishes, judges, forms, rules, fine), wishes, 0.5 * plants.course.seconds)
    asked = _Asked(front, points, pick)
    named, line, search, point = _searched(plants, wishes, forms, sizes, w, budget, seed, progress, asked)
    named += [_Named(n, forms[-1], isa.gains(), RULES[n]) for n, isa in rules.items()]
    begins(progress, "judging the controllers on fresh plants")
    rows, found = _rows(plants, wishes, forms, judges, named, fine)
    drawn = None if line is None else _judged_front(
        line, judges[forms[0].name], forms[0], responses_of(plants.family, plants.rest, forms[0], wishes.period, fine),
        fine, wishes,
        open_poles(plants.rest, fine[0]), pick,
    )  # fmt: skip
    return LoopDesign(
        wishes, plants.family, plants.rest, plants.course, small, plants.sign, rows, found, judges, plants.held,
        plants.right_sign,
        plants.used, plants.tracking, drawn, search, point,
    )  # fmt: skip


def _forms(plants: "_Plants", wishes: Wishes) -> tuple[dict[str, Isa], list[Form]]:
    """The form that was asked for, simpler ones and a PID last, with the rules for it. A plant that only an inner loop
    leaves one integrator of has no rules, and no PID beside its cascade."""
    small = plants.small
    ahead = _ahead_of_pid(plants.family, plants.rest, small, plants.sign, wishes, plants.tracking)
    if integrators(plants.rest) > 1:
        return {}, ahead
    rules = {n: isa for n in RULES if (isa := rule_gains(n, small, wishes.controller != "pi")) is not None}
    at_once = float(np.max(np.abs(plants.rest.D), initial=0.0, where=np.isfinite(plants.rest.D)))
    return rules, [*ahead, pid_form(small, plants.sign, wishes, rules, plants.tracking, at_once)]


def _by_rule(
    plants: "_Plants", wishes: Wishes, judges: Mapping[str, Judge], forms: Sequence[Form], rules: Mapping[str, Isa],
    w: np.ndarray,
) -> LoopScores:  # fmt: skip
    """What SIMC makes of the plants, whose figures others are counted in; without rules, the first start that keeps
    the best fit from swinging up."""
    last = forms[-1]
    if rules:
        alike = len(rules) + (2 if last is forms[0] else 1)  # as many as are judged at the end, by the same program
        simc = rules["SIMC"].gains()
        moves = _moves_of(plants, last, simc, wishes, w)
        return judges[last.name].scores(stacked_controllers([simc] * alike), moves)
    starts = [last.made(z) for z in last.starts[:STARTED]]
    moved = np.array([[_moves_of(plants, last, one, wishes, w)] for one in starts])
    scores = judges[last.name].scores(stacked_controllers(starts), moved)
    first = int(np.nanargmin(np.where(np.isfinite(scores.iae[:, 0]), scores.iae[:, 0], np.inf)))
    return LoopScores._make(np.asarray(v)[first : first + 1] for v in scores)


class _Asked(NamedTuple):
    """Figures of a front (none: no front), how many points, and which of them is to be the controller."""

    figures: tuple[str, ...]
    points: int
    pick: int | None


class _Named(NamedTuple):
    """A controller that is to stand in the table."""

    name: str
    form: Form
    parameters: Any
    source: str


def _check_asked(wishes: Wishes, front: tuple[str, ...], points: int, pick: int | None) -> None:
    """Raise SpecError for wishes and fronts that cannot be."""
    check_wishes(wishes)
    known_figures(tuple(wishes.minimise), "minimise")
    known_figures(front, "front")
    if front:
        check_front(front, points)
    elif pick is not None:
        raise SpecError("pick chooses a point of a front; give front too, as in iae,input_noise.")


@dataclass(frozen=True, eq=False)
class _Plants:
    """Plants that rest at the set point and come from `starts` below it: those of the search first, then the fresh
    ones.

    `used` are the rows of the fresh ones that rest at both levels, `held` and `right_sign` shares of all fresh ones.
    """

    loops: tuple[OneLoop, OneLoop]
    starts: tuple[Rest, Rest]
    rests: tuple[Rest, Rest]
    used: np.ndarray
    held: float
    right_sign: float
    sign: int
    small: Reduced
    course: StepAndLoad
    tracking: float | None

    @property
    def family(self) -> OneLoop:
        return self.loops[1]

    @property
    def rest(self) -> Rest:
        return self.rests[1]

    def judge(self, form: Form, wishes: Wishes, which: int = 1) -> Judge:
        """Of controllers of a form on the fresh plants, or on those of the search (`which` 0)."""
        return Judge.of(self.loops[which], self.starts[which], self.course, wishes.quantum, form, wishes.inner_quantum)


def _plants(train: OneLoop, family: OneLoop, wishes: Wishes) -> _Plants:
    """The plants at rest at both levels. Raises SimulationError for plants that no controller of a loop can be
    searched for."""
    levels = (wishes.set_point - wishes.step, wishes.set_point)
    middle = (wishes.lower + 0.1 * (wishes.upper - wishes.lower), 0.5 * (wishes.lower + wishes.upper), wishes.upper)
    both = [(plant.at_rest(levels[0], middle), plant.at_rest(levels[1], middle)) for plant in (train, family)]
    check_holds(family, *both[1], wishes)
    check_reached(family, both[1][1])
    sign, wrong = sign_of(both[1][1])
    whole = [with_rest(pair) for pair in both]
    starts, rests = ((_part(both[0][k], whole[0]), _part(both[1][k], whole[1])) for k in (0, 1))
    small = reduced_for(family, rests[1], wishes.controller, 0.5 * wishes.period)
    check_dead_time(small, wishes)
    return _Plants(
        (train.part(whole[0]), family.part(whole[1])), starts, rests, np.flatnonzero(whole[1]),
        float(np.mean(held_by_limits(both[1], wishes))), float(1.0 - np.mean(wrong)), sign, small,
        _course(small, wishes, _moving(rests, wishes)),
        _tracking(small, wishes),
    )  # fmt: skip


def reduced_for(family: OneLoop, rest: Rest, controller: str, half: float) -> Reduced:
    """The best fit reduced, with `half` a sample (s) added to its dead time. With several integrators, of which the
    inner loop of a cascade closes all but one, what the outer loop sees, in output per input: the set point of the
    inner one counts as the input that makes it."""
    if controller != "cascade" or family.inner is None or integrators(rest) < 2:
        return reduced(rest, half)
    own = family.of_inner(rest)
    check_inner(family, own)
    inner = reduced(own, half)
    fast = rule_gains("SIMC", inner, derivative=False)
    assert fast is not None
    seen = reduced(behind(rest, own, (fast.K, fast.Ti), family.inner_row(rest)[0]), half)
    k = inner.first_order[0]
    return replace(
        seen, first_order=(k * seen.first_order[0], *seen.first_order[1:]),
        second_order=(k * seen.second_order[0], *seen.second_order[1:]),
    )  # fmt: skip


def _searched(
    plants: _Plants, wishes: Wishes, forms: Sequence[Form], sizes: Any, w: np.ndarray, budget: int, seed: int,
    progress: Callable[[Any], None] | None, asked: _Asked,
) -> tuple[list[_Named], Front | None, Search, np.ndarray]:  # fmt: skip
    """Controllers of every form on all plants and on the best fit alone, the form that was asked for first; the
    front, if asked for; the search of that form and the point of its cube."""
    named: list[_Named] = []
    line: Front | None = None
    found: tuple[Search, np.ndarray] | None = None
    at_last: np.ndarray | None = (
        None  # points of the form before, which an MPC begins at: its weights are those of an LQI
    )
    drawn = len(asked.figures) + len(directions(len(asked.figures), asked.points)) if asked.figures else 0
    searches = Searches(progress, 2 * len(forms) + drawn)
    for form in reversed(forms):
        h = responses_of(plants.loops[0], plants.rests[0], form, wishes.period, w)
        own = open_poles(plants.rests[0], w[0])
        search = Search(plants.judge(form, wishes, 0), h, w, wishes, form, sizes, weights_of(wishes.minimise), own)
        starts = form.starts if form.plan is None or at_last is None else at_last
        single = search.on_best_fit()
        nominal = on_one_plant(single, starts, budget, seed, searches.next(f"{form.name}, {BEST_FIT}"))
        tell = searches.next(f"{form.name}, {ROBUST}")
        robust = search.found(np.r_[starts, nominal[None]], PAIR * budget, seed + 1, tell, NEAR)
        # what was found for all plants is a controller for the best fit too, and may be the better one
        nominal = single.best_of(np.stack([nominal, robust]))
        at_last = np.stack([robust, nominal])
        source = "this search"
        if asked.figures and form is forms[0]:
            begins(progress, "judging where the front begins")
            known = np.concatenate([at_last, starts[:STARTED]])
            line = front_of(search, asked.figures, known, asked.points, PAIR * max(300, budget), seed + 2, searches)
            robust, source = _picked(line, asked.pick, robust)
        best, alone = (_numbers(form.made(z)) for z in (robust, nominal))
        if form is forms[0]:
            found = search, robust
            named = [
                _Named(ROBUST, form, best, source),
                _Named(BEST_FIT, form, alone, "the same search on one plant"),
                *named,
            ]
        else:
            named = [
                _Named(form.name + BESIDE, form, best, f"the same search for {article(form.name)} {form.name}"),
                *named,
            ]
    assert found is not None
    return named, line, *found


def on_one_plant(
    single: Search, starts: np.ndarray, budget: int, seed: int, progress: Callable[[Any], None] | None
) -> np.ndarray:
    """The point (d,) of the best controller for one plant, from points (k, d). Limits leave several optima (a lag of 50
    s with a dead time of 1 s: every second search ends 6 % above the best), so the best of a few searches is refined.
    An MPC is searched once and less: its plans take the time, and not the plants."""
    if single.form.plan is not None:
        return single.found(starts, PAIR * max(200, budget // 2), seed, progress)
    each = max(ALONE_LEAST, ALONE_TIMES * budget)
    found = [single.found(starts, each, seed + APART * k, progress) for k in range(ALONE_SEARCHES)]
    return single.found(single.best_of(np.stack(found))[None], each, seed, progress, NEAR)


def _moves_of(plants: _Plants, form: Form, parameters: Any, wishes: Wishes, w: np.ndarray) -> float:
    """Standard deviation of what noise adds to every move of the input on the best fit."""
    alone = plants.family.part(np.array([0])), _part(plants.rest, np.array([0]))
    c = form.response(parameters, w)
    s = 1.0 / (1.0 + open_loop(c, responses_of(*alone, form, wishes.period, w)))
    weights = np.gradient(w) / np.pi * wishes.period
    share = noise_in_moves(c, s, w, wishes.period, weights, noises(wishes, form.inner))
    return float((wishes.upper - wishes.lower) * share[0])


def _rows(
    plants: _Plants,
    wishes: Wishes,
    forms: Sequence[Form],
    judges: Mapping[str, Judge],
    named: Sequence[_Named],
    w: np.ndarray,
) -> tuple[tuple[Row, ...], Judged]:
    """The table of all controllers on the fresh plants."""
    parts, (count, outside) = [], open_poles(plants.rest, w[0])
    for form in forms:
        of_form = [one.parameters for one in named if one.form is form]
        h = responses_of(plants.family, plants.rest, form, wishes.period, w)
        parts.append(judged_on(judges[form.name], form, of_form, h, w, wishes, count + form.integrators, outside))
    order = np.argsort([k for form in forms for k, one in enumerate(named) if one.form is form])
    found: Judged = jax.tree.map(lambda *arrays: np.concatenate(arrays)[order], *parts)
    alone = plants.family.part(np.array([0])), _part(plants.rest, np.array([0]))
    rows = tuple(
        row_of(i, one, found, w, responses_of(*alone, one.form, wishes.period, w), int(count[0]) + one.form.integrators)
        for i, one in enumerate(named)
    )  # fmt: skip
    return rows, found


def _picked(line: Front, pick: int | None, robust: np.ndarray) -> tuple[np.ndarray, str]:
    """The point of the front that was chosen, from 1 on, and where it is from. Raises SpecError for a number that
    there is not."""
    if pick is None:
        return robust, "this search"
    if not 1 <= pick <= len(line.points):
        raise SpecError(
            f"The front has {len(line.points)} points, and pick = {pick} is none of them; give 1 to {len(line.points)}."
        )
    return line.points[pick - 1], f"point {pick} of {len(line.points)} of the front"


def _judged_front(
    line: Front, judge: Judge, form: Form, h: np.ndarray, w: np.ndarray, wishes: Wishes,
    own: tuple[np.ndarray, np.ndarray],
    pick: int | None,
) -> JudgedFront:  # fmt: skip
    """The points of a front on the fresh plants, which have poles of their `own`: their figures on the best fit, in
    units, and the share of plants that keep the wishes."""
    controllers = [_numbers(form.made(z)) for z in line.points]
    found = judged_on(judge, form, controllers, h, w, wishes, own[0] + form.integrators, own[1])
    half = 0.5 * judge.course.seconds
    first = [np.asarray(figure(n, found.scores, found.input_noise, half))[:, 0] for n in line.names]
    return JudgedFront(line.names, tuple(controllers), np.stack(first, axis=1), np.mean(found.kept, axis=1), pick)


def _ahead_of_pid(
    family: OneLoop, rest: Rest, small: Reduced, sign: int, wishes: Wishes, tracking: float | None
) -> list[Form]:
    """The form that was asked for, then simpler ones of its kind; none where that is a PID, which stands beside all
    of them."""
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


def _moving(rests: Sequence[Rest], wishes: Wishes) -> float:
    """Seconds in which the limits of the input let several integrators make the step, from standing and on; 0 for
    plants with one at most, whose own time is known."""
    n = integrators(rests[1])
    if n < 2:
        return 0.0
    held = [float(rests[0].u[0]), float(rests[1].u[0]), float(rests[1].u[0]) - wishes.load]
    room = min(min(u - wishes.lower, wishes.upper - u) for u in held)
    pull = max(abs(gain_of(rests[1], 0)) * room, 1e-300)
    return float((math.factorial(n) * abs(wishes.step) / pull) ** (1.0 / n))


def _course(small: Reduced, wishes: Wishes, moving: float = 0.0) -> StepAndLoad:
    seconds = wishes.horizon if wishes.horizon is not None else max(course_seconds(small), 2.0 * MOVES * moving)
    if seconds / wishes.period > 20 * MOST_SAMPLES:
        raise SimulationError(
            f"The loop takes {seconds:.4g} s to settle twice, {seconds / wishes.period:.0f} "
            f"samples of {wishes.period:g} s; give a longer period ([control] period, or "
            f"--period), such as {seconds / MOST_SAMPLES:.2g} s, or a shorter horizon."
        )
    ends = wishes.output_lower, wishes.output_upper
    return StepAndLoad(wishes.set_point - wishes.step, wishes.set_point, wishes.load, seconds, wishes.period, *ends)
