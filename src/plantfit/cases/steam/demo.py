"""The steam chamber on a virtual rig: dead time, 310 parameters, five methods, and what exact derivatives change."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.shared.beside import Beside
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.record import figure, record
from plantfit.cases.shared.stages import stages, within
from plantfit.cases.steam.adaptive_bdf import OWN, Descents, descents
from plantfit.cases.steam.apart import Asked, apart
from plantfit.cases.steam.dynamic_runs import (
    BOX,
    FINITE,
    METHODS,
    PAPERS,
    POLISHED,
    RANDOM,
    MethodRuns,
    finely,
    finite_runs,
    method_runs,
    opening_problems,
    opening_runs,
    order_of,
    steps_of,
)
from plantfit.cases.steam.problems import dynamic_problem, static_problem, tables_from_static, total_cost
from plantfit.cases.steam.sections.dynamic_section import (
    NEAR,
    PAPER,
    PAPER_STATIC,
    Slopes,
    answers_section,
    dynamic_section,
    empty_intervals,
    readings_section,
    truth_of,
)
from plantfit.cases.steam.sections.screening_section import not_screened, screening_section
from plantfit.cases.steam.sections.static_section import static_section
from plantfit.fitting import Answer
from plantfit.optimize import minimise
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.rig.run import RigRun
from plantfit.rig.steam_chamber import SteamChamberRig, smooth_truth
from plantfit.study.objective import objective_of
from plantfit.trust import has_salib

SEED = 1
RUNS, BUDGET = (5, 10), 10_000  # small, full; evaluations of a run, the paper's
ALONE = (1000, 10_000)  # evaluations of a search of one opening, in the full demo
PARTS = ("answers", "screening", "tables", "closed loop")
SMALL = ("CMA-ES", "DISH", "HMS", "SHADE", "L-BFGS-B, exact")  # methods of the small demo
NOMINAL = "L-BFGS-B, exact"  # for control: at the noise floor, and as smooth as the static solution it begins at
RESTARTED = "least squares, exact, random starts"
EXACT = "exact derivatives"
FINITE_BUDGET = (1600, 10_000)  # evaluations of L-BFGS-B through BDF
SLOPED = ("lbfgsb", "least_squares")  # methods that take them


def run(folder: str | Path, progress: Callable[[Any], None] | None = None, full: bool = False) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`; `full` makes the paper's 10 runs of 10 000 evaluations and tries
    both of its readings."""
    folder, rig = unpack("steam", folder), SteamChamberRig()
    file, runs = folder / "chamber.toml", rig.records(SEED)
    for made in runs.values():
        made.save(folder)
    recordings = {n: r.recording for n, r in runs.items()}
    problem = dynamic_problem(recordings, weighted=True)
    chosen = [m for m in METHODS if full or m.label in SMALL]
    exact = [m for m in chosen if m.name in SLOPED]
    searched = [m for m in chosen if m.name not in SLOPED]
    begins = stages(
        ("static task", *(m.label for m in searched), FINITE, EXACT, *PARTS[: None if full else 2]), progress
    )
    begins("static task")
    static, static_cost = static_point(problem, recordings)
    own = order_of(problem)
    asked = Asked(runs, file, static, exact, RUNS[full], BUDGET, SEED, full)
    with Beside(apart, asked) as beside:
        found = []
        for m in searched:
            begins(m.label)
            found.append(method_runs(problem, m, static, RUNS[full], BUDGET, SEED, within(m.label, progress)))
        alone = _opening_by_opening(problem, recordings, static, progress) if full else {}
        begins(FINITE)
        finite = finite_differences(problem, recordings, static, full)
        begins(EXACT)
        others = beside.result(progress)
    begins("answers")
    answer, constants = others.answer, others.constants
    found = sorted([*found, *others.methods], key=lambda r: [m.label for m in METHODS].index(r.label))
    if not full:
        found.append(MethodRuns(RESTARTED, RANDOM, tuple(answer.runs)))
    together, each = finite_runs(problem, finite, SEED)
    found.insert(1, together)
    if each is not None:
        alone[ALONE[0]].append(each)
    slopes = Slopes(
        tuple(problem.space.names[i] for i in own),
        problem.value_and_gradient(static)[1][own],
        finite.slopes,
    )
    best = {m.label: m.best.x for m in found if m.start != RANDOM}
    shown = {"static solution": static, **{n: best[n] for n in ("CMA-ES", "DISH", "HMS")}, EXACT: answer.best.x}
    floor = noise_floor(rig, len(runs))
    sections = [
        static_section(
            list(constants.tasks),
            constants.early,
            {n: r.truth["parameters"] for n, r in runs.items()},
            constants.study,
        ),
        constants.uncertainty,
        dynamic_section(found, problem, static, floor, slopes, BUDGET, not full),
        answers_section(finely(problem), shown, truth_of(runs), _intervals(answer), _untold(answer)),
        *([readings_section(found, alone, floor)] if full else []),
        *_meaning_sections(finely(problem, POLISHED), best, answer, runs, full, begins),
    ]
    return record(
        "steam",
        "Steam chamber on a virtual rig",
        [*_figures(found, floor, static_cost, runs, answer), *constants.figures()],
        [
            "Nothing here was measured on a machine: the rig's tables are made up, of the size that the paper's "
            "results suggest.",
            *(
                []
                if full
                else [f"Small demo: {RUNS[0]} runs of {BUDGET} evaluations; the paper's {RUNS[1]} with --full."]
            ),
        ],
        [answer],
        [file],
        sections,
        "310 parameters from ten steps of a valve: metaheuristics, finite differences and exact derivatives",
        found=_found(found, floor, static_cost, slopes, runs, answer),
    )


def _meaning_sections(
    problem: Problem,
    best: Mapping[str, np.ndarray],
    answer: Answer,
    runs: Mapping[str, RigRun],
    full: bool,
    begins: Callable[[str], None],
) -> list[dict[str, Any]]:
    """What the answers are worth: sensitivity around them; in the full demo tables against models with fewer
    numbers, and closed loops."""
    begins("screening")
    sections = [screening_section(problem, best, SEED) if has_salib() else not_screened()]
    if full:
        from plantfit.cases.steam.sections.closed_loop_section import closed_loop_section  # half a second
        from plantfit.cases.steam.sections.tables_section import tables_section

        begins("tables")
        sections.append(tables_section({n: r.recording for n, r in runs.items()}, truth_of(runs)))
        begins("closed loop")
        others = {n: z for n, z in best.items() if n != NOMINAL} | {EXACT: answer.best.x}
        sections.append(closed_loop_section(problem, others, best[NOMINAL], NOMINAL, smooth_truth, seed=SEED))
    return sections


def finite_differences(
    problem: Problem, recordings: Mapping[str, Recording], static: np.ndarray, full: bool
) -> Descents:
    """L-BFGS-B through BDF from the static solution (d,), on all openings at once, and on each alone in the full
    demo."""
    own = order_of(problem)
    lower, upper = problem.space.lower[own][:OWN], problem.space.upper[own][:OWN]
    return descents(steps_of(recordings), lower, upper, static[own], FINITE_BUDGET[full], ALONE[0] if full else 0)


def noise_floor(rig: SteamChamberRig, openings: int) -> float:
    """Cost C (bar^2) that noise and rounding of the rig leave on average."""
    return openings * (rig.noise**2 + (rig.span / 2**rig.bits) ** 2 / 12.0)


def static_point(problem: Problem, recordings: Mapping[str, Recording]) -> tuple[np.ndarray, float]:
    """The static solution as a cube point (d,) of the dynamic problem, and its cost C: four constants for each
    opening, fitted jointly."""
    constants = static_problem(recordings, dead_time=(0.1, 1.0))
    [found] = minimise(objective_of(constants), "least_squares", budget=3000, seed=SEED)
    values = dict(zip(constants.space.names, np.asarray(constants.space.physical(found.x)).tolist(), strict=True))
    return tables_from_static(problem, values), total_cost(constants, found.x)


def _opening_by_opening(
    problem: Problem, recordings: Mapping[str, Recording], static: np.ndarray, progress: Callable[[Any], None] | None
) -> dict[int, list[MethodRuns]]:
    """The paper's methods on each opening alone, by the evaluations of a search."""
    problems = opening_problems(recordings)
    begin = {n: static[problem.space.local(n)] for n in recordings}
    chosen = [m for m in METHODS if m.start == BOX or m.label == "CMA-ES"]
    return {
        n: [opening_runs(recordings, m, begin, RUNS[1], n, SEED, problems, progress) for m in chosen] for n in ALONE
    }


def _untold(answer: Answer) -> int:
    """Dead times whose 95 % interval is all that was searched."""
    return sum(p["parameter"] == "Td" and p["open"] == "both" for p in answer.findings["parameters"])


def _intervals(answer: Answer) -> dict[str, tuple[float, float]]:
    """95 % intervals of the dead times by recording; NaN where one was held at a bound."""
    rows = [p for p in answer.findings["parameters"] if p["parameter"] == "Td"]
    return {p["recording"]: (np.nan, np.nan) if p["low"] is None else (p["low"], p["high"]) for p in rows}


def _found(
    found: list[MethodRuns],
    floor: float,
    static_cost: float,
    slopes: Slopes,
    runs: Mapping[str, RigRun],
    answer: Answer,
) -> list[str]:
    times = {m.label: float(np.median(m.costs)) / floor for m in found}
    paper = sorted((n for n in times if n in PAPERS), key=lambda n: times[n])
    random = next(m for m in found if m.label == RESTARTED)
    hits, zero = int(np.sum(random.costs <= NEAR * floor)), int(np.sum(slopes.differences[slopes.delays] == 0.0))
    rows = {p["recording"]: p for p in answer.findings["parameters"] if p["parameter"] == "Td"}
    true = {n: r.truth["parameters"]["Td"] for n, r in runs.items()}
    worst = max(abs(rows[n]["value"] - v) for n, v in true.items())
    held = sum(rows[n]["low"] is not None and rows[n]["low"] <= v <= rows[n]["high"] for n, v in true.items())
    return [
        "Four constants for each opening, fitted in one step with dead times from 0.1 "
        f"s, leave a total cost of {static_cost:.4f} bar² (the paper {PAPER_STATIC} on "
        f"its own record); noise and rounding alone leave {floor:.4f}.",
        "With 310 numbers the paper's methods end, by their medians, at so many times this floor: "
        + ", ".join(f"{n} {times[n]:.3g}" for n in paper)
        + ".",
        f"L-BFGS-B stalls on its finite differences, which are exactly 0 for {zero} of {int(np.sum(slopes.delays))} "
        f"dead times. With exact derivatives the same method ends at {times[NOMINAL]:.3g} times the floor.",
        "Least squares with exact derivatives from random points "
        f"reaches the floor in {hits} of {len(random.costs)} runs.",
        f"Its dead times are at most {worst:.2g} s off, and {held} of {len(true)} of their 95 % intervals hold the "
        f"truth{empty_intervals(_untold(answer))}.",
    ]


def _figures(
    found: list[MethodRuns], floor: float, static_cost: float, runs: Mapping[str, RigRun], answer: Answer
) -> list[dict[str, Any]]:
    told = [
        figure(
            "static solution, delays from 0.1 s: total cost",
            static_cost,
            "bar^2",
            PAPER_STATIC,
            "the paper, on its own record",
        )
    ]
    for m in found:
        source = "the paper, on its own record" if m.label in PAPER else ""
        told.append(
            figure(
                f"{m.label}: median cost",
                float(np.median(m.costs)),
                "bar^2",
                PAPER.get(m.label, (None,) * 5)[2],
                source,
            )
        )
    exact = next(m for m in found if m.label == RESTARTED)
    hits = int(np.sum(exact.costs <= NEAR * floor))
    told.append(
        figure(
            f"{RESTARTED}: at the noise floor",
            float(hits),
            f"of {len(exact.costs)}",
            float(len(exact.costs)),
            "asked for",
        )
    )
    delays = {p["recording"]: p["value"] for p in answer.findings["parameters"] if p["parameter"] == "Td"}
    worst = max(abs(delays[n] - r.truth["parameters"]["Td"]) for n, r in runs.items())
    told.append(figure("largest error of a dead time at 0.05 bar noise", worst, "s"))
    return told
