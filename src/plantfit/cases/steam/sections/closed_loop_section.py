"""What the family of models is good for: controllers that keep to their promise on the true chamber."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from plantfit.cases.steam.closed_loop import PROFILE, Bench, Chosen, Plants, chosen_mpc, mpc_bench, pid_bench, tuned_pid
from plantfit.cases.steam.whole_plant import plants_of, true_plant
from plantfit.control import Demand, StepScores, profile_scores
from plantfit.problem.problem import Problem
from plantfit.report.figures.control.response_family import Panel, response_figure
from plantfit.report.numbers import significant
from plantfit.trust.identify.open_answers import open_answers

DEMAND = Demand(overshoot=5.0, travel=1500.0)
EDGE, PINNED = 1e-3, 0.05  # answers with more of their entries at a bound are no plants
GOOD = 3.0  # answers up to so many times the cost of the best model count as models
WORST = 2.0  # copies may have so many times that cost
DRAWN = 36  # members with their open cells drawn anew
ONE, ALL = "best model", "family"


def closed_loop_section(
    problem: Problem,
    answers: Mapping[str, Any],
    best: Any,
    name: str,
    truth: Callable[[float], Mapping[str, Any]],
    *,
    drawn: int = DRAWN,
    budget: int = 160,
    seed: int = 1,
) -> dict[str, Any]:
    """Section of the page: `answers` are cube points of a dynamic problem of all openings by name, `best`, that of
    `name`, is the nominal model.

    The family: answers of at most 3 times the cost of `best` with at most a twentieth of their entries at a bound, and
    `drawn` copies of it whose open cells are drawn anew, as far from it as twice its cost allows; every third member is
    held out from the tuning. `truth` gives the tables of an opening, as a rig's.
    """
    costs = np.asarray(problem.costs(np.stack([best, *answers.values()])))
    good = [np.asarray(z) for z, cost in zip(answers.values(), costs[1:], strict=True) if cost <= GOOD * costs[0]]
    plausible = [z for z in good if _pinned(z) <= PINNED]
    pinned, good = len(good) - len(plausible), plausible
    points = [*good, *open_answers(problem, np.asarray(best), drawn, known=1e-2, worst=WORST, seed=seed)]
    spread = np.asarray(problem.costs(np.stack(points)))
    out, kept = points[::3], [z for i, z in enumerate(points) if i % 3]
    nominal, tuning, held = (plants_of(problem, chosen) for chosen in ([best], kept, out))
    true = true_plant(truth)
    benches = {"PID": pid_bench(seed), "MPC": mpc_bench(nominal, seed)}
    alone = tuned_pid(benches["PID"], nominal, DEMAND, ONE, budget, seed)
    start = {n: float(v) for n, v in alone.parameters._asdict().items()}
    chosen = [
        alone,
        tuned_pid(benches["PID"], tuning, DEMAND, ALL, budget, seed, start),
        *chosen_mpc(benches["MPC"], nominal, tuning, DEMAND, (ONE, ALL)),
    ]
    plants = {n: np.concatenate([nominal[n], held[n]]) for n in held}
    seen = [_seen(benches[c.kind], c, plants, true) for c in chosen]
    judged = [s.scores for s in seen]
    found = f"{len(good)} answers and " if good else ""
    members = f"{found}{drawn} copies of the best with their open cells drawn anew"
    sentences = [
        f"The best model here is the answer of {name}: C = {significant(costs[0], 3)} bar², {100 * _pinned(best):.1f} "
        f"% of its entries on bounds. The least cost of the others is {significant(np.min(costs[1:]), 3)} bar², with "
        f"{100 * _pinned(list(answers.values())[int(np.argmin(costs[1:]))]):.1f} %.",
        f"Family: {members}, cost C {significant(spread.min(), 3)} to {significant(spread.max(), 3)} bar² beside "
        f"{significant(costs[0], 3)} of the best; {len(kept)} members for the tuning, {len(out)} held out."
        + (
            f" {pinned} more that fit have over {100 * PINNED:g} % of "
            "their entries on bounds and are not counted as plants."
            if pinned
            else ""
        ),
        f"Steps to {', '.join(f'{v:g}' for v in PROFILE.levels)} bar. Asked for: small mean "
        f"IAE, at most {DEMAND.overshoot:g} % overshoot and {DEMAND.travel:g} % of valve travel "
        "in a step; for a family, of its worst member. Sensor, noise and valve are the rig's.",
        *_said(chosen, judged),
    ]
    return {
        "title": "Pressure control: tuned on one model, tuned on the family",
        "sentences": sentences,
        "tables": [_table(chosen, judged)],
        "figures": [{"figure": _figure(chosen, seen), "label": "Steps on the true chamber and on members held out"}],
    }


def _pinned(z: Any) -> float:
    """Share of the coordinates of a cube point at a bound."""
    return float(np.mean((np.asarray(z) < EDGE) | (np.asarray(z) > 1.0 - EDGE)))


class _Seen(NamedTuple):
    """Responses of one controller: times, those of the held-out members and of the true chamber, scores by where."""

    t: np.ndarray
    held: np.ndarray
    true: np.ndarray
    scores: Mapping[str, StepScores]


def _seen(place: Bench, c: Chosen, plants: Plants, true: Plants) -> _Seen:
    """`plants`: the best model, then the members held out."""
    t, y, u = place.responses(c.parameters, plants)
    _, y_true, u_true = place.responses(c.parameters, true, truth=True)
    scores = {
        "best model": profile_scores(PROFILE, t, y[:1], u[:1]),
        "held-out members": profile_scores(PROFILE, t, y[1:], u[1:]),
        "true chamber": profile_scores(PROFILE, t, y_true, u_true),
    }
    return _Seen(t, y[1:], y_true[0], scores)


def _table(chosen: Sequence[Chosen], judged: Sequence[Mapping[str, StepScores]]) -> dict[str, Any]:
    rows = []
    for c, found in zip(chosen, judged, strict=True):
        for where, s in found.items():
            iae, over, travel = np.mean(s.iae, axis=1), np.max(s.overshoot, axis=1), np.max(s.travel, axis=1)
            late = np.max(s.settling, axis=1)
            rows.append([f"{c.kind} for the {c.made_for}", where, _two(iae), _two(over), _two(late), _two(travel)])
    return {
        "caption": "Steps judged: the middle of the members, and the worst in brackets",
        "columns": [
            "controller",
            "on",
            "mean IAE / step [s]",
            "overshoot [%]",
            "settling, 5 % [s]",
            "valve travel [%]",
        ],
        "rows": rows,
        "note": "; ".join(f"{c.kind} for the {c.made_for}: {c.said}" for c in chosen) + ".",
    }


def _two(values: np.ndarray) -> str:
    if len(values) == 1:
        return _number(values[0])
    return f"{_number(float(np.median(values)))} ({_number(float(np.max(values)))})"


def _number(value: float) -> str:
    return significant(value, 3) if np.isfinite(value) else "never"


def _said(chosen: Sequence[Chosen], judged: Sequence[Mapping[str, StepScores]]) -> list[str]:
    worst = {
        (c.kind, c.made_for): (float(np.max(f["held-out members"].overshoot)),
                               float(np.max(np.mean(f["held-out members"].iae, axis=1))),
                               float(np.mean(f["true chamber"].iae)))
        for c, f in zip(chosen, judged, strict=True)
    }  # fmt: skip
    told = []
    for kind in ("PID", "MPC"):
        (over1, iae1, true1), (over2, iae2, true2) = worst[kind, ONE], worst[kind, ALL]
        told.append(
            f"{kind}: tuned on the best model it overshoots by up to {over1:.3g} % on members held "
            f"out, with a mean IAE of up to {iae1:.3g} s; tuned on the family {over2:.3g} % and "
            f"{iae2:.3g} s. On the true chamber this takes {true2:.3g} s in place of {true1:.3g} s."
        )
    return told


def _figure(chosen: Sequence[Chosen], seen: Sequence[_Seen]) -> dict[str, Any]:
    panels = []
    for c, s in zip(chosen, seen, strict=True):
        panels.append(
            Panel(f"{c.kind} for the {c.made_for}", s.t, PROFILE.reference(float(s.t[1] - s.t[0])), s.held, s.true)
        )
    return response_figure(panels, "pressure [bar]", "true chamber", "held-out members")
