"""The paper's study on the virtual rig, end to end: record, optimum, runs of every method, and why they stop where
they stop."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plantfit.cases.pendubot.sections.paper_section import (
    Section,
    errata_section,
    gap_section,
    record_section,
    results_section,
)
from plantfit.cases.pendubot.stagnation import bound_bias, causes, salps_in, stagnation, valley, with_more
from plantfit.cases.pendubot.study_runs import Floor, MethodRuns, floor_of, method_runs
from plantfit.cases.pendubot.torque import CALM, TorqueRecord, torque_record, write_record
from plantfit.problem import Problem
from plantfit.rig import PendubotRig
from plantfit.spec import load

LONGER = 5  # times the budget
METHODS = ("pso", "cga", "salp_swarm")


@dataclass(frozen=True)
class PaperStudy:
    """`sections` of the page; `tuned` runs by method, `untuned` PSO and `longer` with five times the budget,
    `least_squares`."""

    problem: Problem
    floor: Floor
    tuned: dict[str, MethodRuns]
    untuned: MethodRuns
    longer: MethodRuns
    least_squares: MethodRuns
    sections: list[Section]


def paper_study(
    file: Path, record: TorqueRecord, runs: int, others: int, calm: int, progress: Callable[[Any], None] | None = None
) -> PaperStudy:
    """`runs` of PSO, CGA and SSA with the settings of the study file, `others` of what they are compared with,
    `calm` on the harder record, which is written beside the file."""
    study = load(file)
    problem, plan = study.problem, study.plan
    floor = floor_of(problem)

    def made(
        method: str, settings: dict[str, Any], count: int, budget: int = plan.budget, timed: bool = False
    ) -> MethodRuns:
        return method_runs(problem, floor, method, settings, count, budget, plan.seed, progress, timed=timed)

    tuned = {m: made(m, dict(plan.settings.get(m, {})), runs, timed=True) for m in METHODS}
    plain = {"population": plan.settings["pso"]["population"]}
    untuned, longer = made("pso", plain, others), made("pso", plain, others, LONGER * plan.budget)
    least_squares = made("least_squares", {"agree": 3}, others)
    found = {m: stagnation(problem, floor, r, plan.budget) for m, r in tuned.items()}
    told = [*causes({tuned[m].label: s for m, s in found.items()}), with_more(untuned, longer, LONGER)]
    told.append(bound_bias([(tuned[m].label, s) for m, s in found.items()]))
    share, _ = least_squares.share_close
    told.append(
        f"Bounded least squares from random starts: {100 * share:.0f} "
        f"% of {len(least_squares.gap)} runs reach the optimum."
    )
    every = list(tuned.values())
    sections = [
        record_section(record, floor),
        results_section(record, problem, floor, every),
        gap_section([*every, least_squares], told),
        calm_section(file.with_name("calm.toml"), calm, progress),
        errata_section(),
    ]
    return PaperStudy(problem, floor, tuned, untuned, longer, least_squares, sections)


def calm_section(file: Path, runs: int, progress: Callable[[Any], None] | None = None) -> Section:
    """The same on a record with less chatter, where the same error of the parameters is a larger share of the RMSE."""
    write_record(torque_record(weights=PendubotRig().weights), file.parent, CALM)
    study = load(file)
    problem, plan = study.problem, study.plan
    floor = floor_of(problem)

    def made(method: str, settings: dict[str, Any], label: str | None = None) -> MethodRuns:
        return method_runs(problem, floor, method, settings, runs, plan.budget, plan.seed, progress, label)

    tuned = [made(m, dict(plan.settings[m])) for m in METHODS]
    printed = made(
        "salp_swarm", {"population": plan.settings["salp_swarm"]["population"], "variant": "paper"}, "SSA as printed"
    )
    exact = made("least_squares", {"agree": 3})
    told = [
        "An observer that takes the encoders' noise for what it is makes the torque "
        f"chatter less: the optimum has an RMSE of {floor.rmse:.4g} N m in place of "
        "the paper's 0.015. A relative gap of 0.1 % is then a smaller torque.",
        *floor.sentences,
        *causes({r.label: stagnation(problem, floor, r, plan.budget) for r in [*tuned, printed]}),
        salps_in(valley(problem, floor), plan.budget // plan.settings["salp_swarm"]["population"]),
        "As printed, the salp swarm's leader jumps upwards only (c3 >= 0 always holds) and alone.",
    ]
    title = "Virtual rig with a calmer controller: a harder test of the methods"
    return gap_section([*tuned, printed, exact], told, title, "calmer controller", note="")
