"""The gains of all levels of a schedule searched together, in the loops that have all of them.

Between two levels gains lie on straight lines, and a step ends at gains of one level and begins at those of another:
what each level keeps with gains of its own, the schedule may miss.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.control.pid import Gains
from plantfit.control.scheduling.law import Schedule, scheduled_pid
from plantfit.control.tune.forms.form import Form, change
from plantfit.control.tune.forms.pid_form import gains_built
from plantfit.control.tune.frequency import pid_response
from plantfit.control.tune.loop_design import ALONE_LEAST, NEAR, PAIR, LoopDesign
from plantfit.control.tune.loop_scores import Judge, slewed
from plantfit.control.tune.searching.parts import Searches
from plantfit.control.tune.searching.search import Search, descent
from plantfit.optimize.contract import CostOfData
from plantfit.simulate.loop.controller import Controller

import jax
import jax.numpy as jnp


class Placed(NamedTuple):
    """A schedule, and the level near which its loop is judged."""

    schedule: Schedule
    level: Any


def refined(
    designs: Sequence[LoopDesign], budget: int, seed: int, progress: Callable[[Any], None] | None
) -> Schedule:  # fmt: skip
    """The schedule of the gains of these designs, one for each level in ascending order. Where it misses what was
    asked for on more plants of the search than may, all gains are searched together: first on the best fit, then on
    all plants, with a penalty that no speed pays for. The schedule that misses less is taken."""
    searches = _searches(designs)
    first = np.concatenate([_point(d) for d in designs])
    before = _missed(searches, first)
    if before <= 1.0 - designs[0].wishes.share:
        return _schedule(searches, first)
    tell = Searches(progress, 2)
    alone = _together([s.on_best_fit() for s in searches])
    best = descent(alone, first, max(ALONE_LEAST, PAIR * budget), seed, tell.next("all levels, best fit alone"), NEAR)
    every = _together(searches)
    begin = min((first, np.asarray(best.x)), key=lambda z: float(every(jnp.asarray(z[None]))[0]))
    found = np.asarray(descent(every, begin, PAIR * budget, seed + 1, tell.next("all levels, all plants"), NEAR).x)
    points = (first, begin, found)
    return _schedule(searches, min(reversed(points), key=lambda z: _missed(searches, z)))


def _searches(designs: Sequence[LoopDesign]) -> list[Search]:
    """Of every level, for the gains of all of them (levels * d,)."""
    spaces, levels = [d.best.form.space for d in designs], np.array([d.wishes.set_point for d in designs])
    lower, upper = (np.stack([getattr(s, end) for s in spaces]) for end in ("lower", "upper"))
    signs, built = (
        np.array([float(d.sign) for d in designs]),
        _placed_gains(tuple(spaces[0].names), tuple(spaces[0].log)),
    )
    found = []
    for design, level in zip(designs, levels, strict=True):
        own, w = _search(design), design.wishes
        form = Form(
            own.form.name, own.form.space, built, _placed_answer(w.period),
            slewed(placed_pid(w.period, w.anti_windup), change(w)), lambda _: 0, own.form.starts, settled=True,
            data=(lower, upper, signs, levels, float(level)), given=own.form.given,
        )  # fmt: skip
        judge = Judge.of(own.judge.plant, own.judge.start, own.judge.course, w.quantum, form)
        found.append(replace(own, judge=judge, form=form))
    return found


def _search(design: LoopDesign) -> Search:
    assert design.search is not None
    return design.search


def _point(design: LoopDesign) -> np.ndarray:
    assert design.point is not None
    return design.point


def _missed(searches: Sequence[Search], z: np.ndarray) -> float:
    """At most this share of the plants misses something at one of the levels."""
    return sum(s.missed(z) for s in searches)


def _schedule(searches: Sequence[Search], z: np.ndarray) -> Schedule:
    made = searches[0].form.made(jnp.asarray(z)).schedule
    count = len(made.levels)
    return Schedule(np.asarray(made.levels), Gains(*(np.broadcast_to(np.asarray(g), count).copy() for g in made.gains)))


def _together(searches: Sequence[Search]) -> CostOfData:
    """The mean over the levels of the cost that no speed pays limits with."""
    costs = [s.strict() for s in searches]
    return CostOfData(_mean(tuple(c.function for c in costs)), tuple(c.data for c in costs))


@lru_cache(maxsize=32)  # one identity for a choice, so that it is compiled once
def _mean(functions: tuple[Callable[[Any, Any], Any], ...]) -> Callable[[Any, Any], Any]:
    @jax.jit
    def costs(zs, data):
        return sum(f(zs, d) for f, d in zip(functions, data, strict=True)) / len(functions)

    return costs


@lru_cache(maxsize=32)
def placed_pid(period: float, anti_windup: str) -> Controller:
    """`scheduled_pid` whose parameters are (`Placed`, input at rest, `Limits`)."""
    law = scheduled_pid(period, anti_windup)

    def init(measurement, parameters):
        placed, *others = parameters
        return law.init(measurement, (placed.schedule, *others))

    def update(state, measurement, reference, parameters):
        placed, *others = parameters
        return law.update(state, measurement, reference, (placed.schedule, *others))

    return Controller(init, update)


@lru_cache(maxsize=32)
def _placed_gains(names: tuple[str, ...], log: tuple[bool, ...]) -> Callable[[Any, Any], Placed]:
    one = gains_built(names, log)

    def built(z, data):
        lower, upper, signs, levels, level = data
        gains = jax.vmap(one)(z.reshape(len(levels), len(names)), (lower, upper, signs))
        return Placed(Schedule(jnp.asarray(levels), gains), jnp.asarray(level))

    return built


@lru_cache(maxsize=32)
def _placed_answer(period: float) -> Callable[..., Any]:
    def response(placed, w, xp=np):
        return pid_response(placed.schedule.at(placed.level), period, w, xp)

    return response
