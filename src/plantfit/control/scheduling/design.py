"""Gains for several levels of the output: a PID searched at each, all of them as one schedule, judged at every
level."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains, Settings, checked
from plantfit.control.scheduling.law import Schedule, scheduled_pid
from plantfit.control.scheduling.together import refined
from plantfit.control.tune.forms.form import Form, change
from plantfit.control.tune.frequency import frequencies, pid_response
from plantfit.control.tune.loop_design import FINE, ROBUST, LoopDesign, course_seconds, responses_of, tuned_loop
from plantfit.control.tune.loop_scores import Judge, Limits, LoopScores, slewed
from plantfit.control.tune.one_loop import OneLoop
from plantfit.control.tune.plant_checks import check_holds
from plantfit.control.tune.reduction import open_poles, reduced, slowest
from plantfit.control.tune.searching.judged import Judged, Row, judged_on, row_of
from plantfit.control.tune.searching.parts import begins, within
from plantfit.control.tune.wishes import Wishes
from plantfit.errors import SimulationError

import jax

NAME = "scheduled PID"
THERE = "PID of this level alone"


@dataclass(frozen=True, eq=False)
class LevelReport:
    """At one level: the `gains` there, the shares of plants that keep the wishes with the `scheduled` controller and
    with each single PID `alone` (levels,), and the IAE of the step on the best fit with the schedule."""

    level: float
    step: float
    gains: Gains
    scheduled: float
    alone: np.ndarray
    iae: float


@dataclass(frozen=True, eq=False)
class ScheduleReport:
    """`levels`, the share of plants that keeps the wishes at `every` level, that share for each `single` PID of one
    level (levels,), and `across` what one step from the first level to the last does: scores (plants,)."""

    levels: tuple[LevelReport, ...]
    every: float
    single: np.ndarray
    across: LoopScores

    @property
    def best_single(self) -> int:
        """The level whose PID is the best at all levels."""
        return int(np.argmax(self.single))


def scheduled_loops(
    train: OneLoop, family: OneLoop, wishes: Wishes, levels: Sequence[float], *, budget: int = 500, seed: int = 1,
    progress: Callable[[Any], None] | None = None,
) -> tuple[LoopDesign, ScheduleReport]:  # fmt: skip
    """A schedule over `levels`, two or more, the last samples of which the step of the wishes ends at; the design is
    that of the level nearest to the set point, the scheduled controller first in it, its share that of plants which
    keep the wishes at every level.

    Each level's PID is searched on all plants as `tuned_loop` does, with the same horizon; where they miss as one
    schedule what was asked for, all levels together. Raises SimulationError as that does.
    """
    chosen = np.unique(np.asarray(levels, dtype=float))
    if len(chosen) < 2:
        raise SimulationError(
            f"A schedule needs two levels or more, and {len(chosen)} is given; give [control] levels."
        )
    plain = replace(wishes, controller="pid", horizon=wishes.horizon or _longest(family, wishes, chosen))
    asked = [replace(plain, set_point=float(v), step=_step_at(family, plain, float(v))) for v in chosen]
    for there in asked:
        _check(family.part(slice(0, 1)), there)
    designs = []
    for k, there in enumerate(asked):
        tell = within(progress, f"level {k + 1} of {len(asked)}")
        designs.append(tuned_loop(train, family, there, budget=budget, seed=seed + 10 * k, progress=tell))
    schedule = refined(designs, budget, seed + 10 * len(designs), progress)
    begins(progress, "judging the schedule")
    main = int(np.argmin(np.abs(chosen - wishes.set_point)))
    everywhere, every, singles, reports, first = (
        np.ones(family.count, bool),
        [],
        np.ones((len(chosen), family.count), bool),
        [],
        None,
    )
    for k, design in enumerate(designs):
        form = _form(design, schedule)
        judge = Judge.of(design.family, design.judge.start, design.course, wishes.quantum, form)
        w = frequencies(wishes.period, slowest(design.reduced), FINE, design.rest.A)
        h, (own, outside) = (
            responses_of(design.family, design.rest, form, wishes.period, w),
            open_poles(design.rest, w[0]),
        )
        found = judged_on(judge, form, [schedule], h, w, design.wishes, 1 + own, outside)
        alone = judged_on(
            design.judge, design.best.form, [d.best.gains for d in designs], h, w, design.wishes, 1 + own, outside
        )
        kept = np.zeros((1 + len(chosen), family.count), bool)
        kept[:, design.rows_used] = np.concatenate([found.kept, alone.kept])
        everywhere &= kept[0]
        every.append(found)
        singles &= kept[1:]
        share = [float(np.mean(v)) for v in kept]
        reports.append(LevelReport(float(chosen[k]), design.wishes.step, _gains_at(schedule, k), share[0],
                                   np.array(share[1:]),
                                   float(found.scores.iae[0, 0])))  # fmt: skip
        if k == main:
            first = (
                form,
                judge,
                found,
                row_of(0, (ROBUST, form, schedule, "this search, at every level"), found, w, h[:1], 1 + int(own[0])),
            )
    assert first is not None
    report = ScheduleReport(
        tuple(reports), float(np.mean(everywhere)), np.mean(singles, axis=1), _across(designs, schedule, wishes)
    )
    return _with_schedule(designs[main], first, everywhere, _worst(designs, every, main)), report


def _check(best: OneLoop, wishes: Wishes) -> None:
    """Whether the limits hold a level, before any is searched."""
    middle = (wishes.lower + 0.1 * (wishes.upper - wishes.lower), 0.5 * (wishes.lower + wishes.upper), wishes.upper)
    start, rest = (best.at_rest(level, middle) for level in (wishes.set_point - wishes.step, wishes.set_point))
    check_holds(best, start, rest, wishes)


def _longest(family: OneLoop, wishes: Wishes, levels: np.ndarray) -> float:
    """Seconds in which the slowest of the levels settles twice."""
    middle = (wishes.lower + 0.1 * (wishes.upper - wishes.lower), 0.5 * (wishes.lower + wishes.upper), wishes.upper)
    best, found = family.part(slice(0, 1)), []
    for level in levels:
        rest = best.at_rest(float(level), middle)
        if np.all(np.isfinite(rest.A)):
            found.append(course_seconds(reduced(rest, 0.5 * wishes.period)))
    if not found:
        raise SimulationError(
            f"No constant {family.input} was found that holds {family.output} at any of the levels "
            f"{', '.join(f'{v:.4g}' for v in levels)}; give others ([control] levels)."
        )
    return max(found)


def _step_at(family: OneLoop, wishes: Wishes, level: float) -> float:
    """The step that ends at a level: as asked for, from the other side where the limits do not hold its start."""
    middle = (wishes.lower + 0.1 * (wishes.upper - wishes.lower), 0.5 * (wishes.lower + wishes.upper), wishes.upper)
    u = float(family.part(slice(0, 1)).at_rest(level - wishes.step, middle).u[0])
    return wishes.step if wishes.lower <= u <= wishes.upper else -wishes.step


def _form(design: LoopDesign, schedule: Schedule) -> Form:
    """The schedule as a form at the level of a design; it is not searched."""
    w = design.wishes
    follow = checked(Settings(w.period, w.lower, w.upper, w.anti_windup, design.tracking_time)).follow
    level = w.set_point

    def response(parameters: Schedule, f, xp=np):
        return pid_response(jax.tree.map(float, parameters.at(level)), w.period, f, xp)

    own = design.best.form
    loop = slewed(scheduled_pid(w.period, w.anti_windup), change(w))
    return Form(
        NAME, own.space, lambda z, _: schedule, response, loop, lambda _: 0, own.starts,
        given=(Limits(w.lower, w.upper, follow),)
    )  # fmt: skip


def _across(designs: Sequence[LoopDesign], schedule: Schedule, wishes: Wishes) -> LoopScores:
    """One step from the first level to the last."""
    first, last = designs[0], designs[-1]
    form = _form(last, schedule)
    start = first.family.at_rest(
        first.wishes.set_point, (wishes.lower, 0.5 * (wishes.lower + wishes.upper), wishes.upper)
    )
    whole = np.isfinite(start.u)
    family = first.family.part(whole)
    start = type(start)(*(getattr(start, n)[whole] for n in ("x", "u", "A", "B", "C", "D", "late")))
    course = replace(last.course, start=first.wishes.set_point, level=last.wishes.set_point)
    scores = Judge.of(family, start, course, wishes.quantum, form).scores(
        jax.tree.map(lambda v: np.asarray(v)[None], schedule)
    )
    return LoopScores._make(np.asarray(v)[0] for v in scores)


def _gains_at(schedule: Schedule, k: int) -> Gains:
    """Those of level number k."""
    return Gains(*(float(g[k]) for g in schedule.gains))


def _worst(designs: Sequence[LoopDesign], every: Sequence[Judged], main: int) -> Judged:
    """What the schedule does at its worst level, on the plants that rest at level number `main`: every figure is the
    largest, what is kept is kept at all levels. A plant that does not rest at a level keeps nothing there."""
    count = max(int(np.max(d.rows_used)) for d in designs) + 1
    rows = designs[main].rows_used

    def gathered(values: Sequence[np.ndarray], fill: Any, join: Any) -> np.ndarray:
        found = np.full((len(values), count, *values[0].shape[2:]), fill, values[0].dtype)
        for k, design in enumerate(designs):
            found[k, design.rows_used] = values[k][0]
        return join.reduce(found, axis=0)[rows][None]

    scores = LoopScores(
        *(gathered([f.scores[i] for f in every], -np.inf, np.maximum) for i in range(len(every[0].scores)))
    )
    ms, noise = (gathered([getattr(f, n) for f in every], -np.inf, np.maximum) for n in ("ms", "input_noise"))
    stable, kept, meets = (
        gathered([getattr(f, n) for f in every], False, np.logical_and) for n in ("stable", "kept", "meets")
    )
    return Judged(scores, ms, stable, noise, kept, meets)


def _with_schedule(
    design: LoopDesign, first: tuple[Form, Judge, Judged, Row], everywhere: np.ndarray, found: Judged
) -> LoopDesign:
    """A level's design with the scheduled controller as its first row, judged as `found` at its worst level."""
    _, judge, _, row = first
    single, *others = design.rows
    rows = (replace(row, share=float(np.mean(everywhere))), *others[:1], replace(single, name=THERE), *others[1:])
    order = [0, 2, 1, *range(3, len(rows))]
    judged = jax.tree.map(lambda a, b: np.concatenate([a, b])[np.array(order)], found, design.judged)
    return replace(design, rows=rows, judged=judged, judges={NAME: judge, **design.judges})
