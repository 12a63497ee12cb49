"""What the template shows of the methods on one problem: a part of a comparison, or a section of a study's report."""

from collections.abc import Callable, Mapping, Sequence
from math import isfinite, log
from typing import Any

import numpy as np

from plantfit.errors import Status
from plantfit.findings import Findings, Number, Parameter, Run, SameModel, array
from plantfit.findings.results.methods_compared import BestRuns, MethodRuns, ProblemComparison, RunsSummary
from plantfit.report.drawings import Drawings
from plantfit.report.figures.comparison import answers, costs, curves
from plantfit.report.sections import comparison_tables as tables
from plantfit.report.sections.sentences import listed
from plantfit.study.comparing.problem_runs import ProblemRuns
from plantfit.study.comparing.record import compared
from plantfit.study.store.records import RunRecord

MEANS: dict[str, Callable[[MethodRuns], RunsSummary]] = {
    "mean final cost": lambda m: m.cost,
    "mean evaluations": lambda m: m.evaluations,
    "mean time of a run [s]": lambda m: m.seconds,
}
MEANS_NOTE = (
    "Over the finite final costs of the runs; CI by Student's t; evaluations and time "
    "are means, time as measured with whatever ran beside it. The lowest mean stands out."
)
LEVELS = {"good": ("Shown", "✓"), "info": ("Note", "i"), "warning": ("Caution", "!")}
FULL_TARGETS = 2  # target tables that stand open
MOST_IMAGES = 24  # ways to write one answer that are looked at
FEWEST_RUNS = 3  # runs from which the report of a study has a section on them


def of_findings(record: Findings, drawings: Drawings) -> dict[str, Any] | None:
    """The section of a study's report; None for fewer than three runs, which tell nothing about a method.

    Costs and parameters are those that the search ended with, before the runs were brought to the final problem.
    """
    if len(record.runs) < FEWEST_RUNS:
        return None
    coordinates = [p for p in record.parameters if _placed(p)]
    symmetries = record.agreement.symmetries if record.agreement else []
    best = min(record.runs, key=lambda r: float("inf") if r.cost is None else r.cost).parameters
    own = [_folded(r.searched or r.parameters, best, symmetries, coordinates) for r in record.runs]
    shown = [r.model_copy(update={"parameters": values}) for r, values in zip(record.runs, own, strict=True)]
    runs = tuple(_run_record(r, coordinates) for r in shown)
    problem = ProblemRuns(record.name, runs, tuple(p.name for p in coordinates))
    found = section(compared([problem]).problems[0], drawings, whole=False)
    many_methods = len({r.method for r in runs}) > 1
    return found | {"title": "Methods" if many_methods else "Runs"}


def section(problem: ProblemComparison, drawings: Drawings, whole: bool = True) -> dict[str, Any]:
    """What the template shows of one problem; `whole` also draws what a study's report has elsewhere."""
    methods = problem.methods
    targets = [tables.targets_table(t) for t in problem.targets]
    shown = _first_targets(problem)
    return {
        "title": problem.name,
        "about": _about(problem),
        "says": [said(s.level, s.sentence) for s in problem.sentences],
        "costs": tables.costs_table(methods),
        "intervals": tables.intervals_table(methods),
        "means_note": MEANS_NOTE,
        "pairs": tables.pairs_table(problem.pairs) if problem.pairs else None,
        "hitting": _hitting(problem),
        "targets": [targets[k] for k in shown],
        "more_targets": [t for k, t in enumerate(targets) if k not in shown],
        "targets_note": _targets_note(problem),
        **_cost_figures(problem, drawings, whole),
        **_curve_figures(problem, drawings, whole),
        **_answer_figures(problem, drawings),
    }


def _cost_figures(problem: ProblemComparison, drawings: Drawings, whole: bool) -> dict[str, Any]:
    methods = problem.methods
    final = {m.name: m.sorted.cost for m in methods if m.sorted and m.sorted.cost}
    ended = [m for m in methods if m.name in final]
    named = {
        name: v for name, v in (("noise floor", problem.floor), ("known optimum", problem.optimum)) if v is not None
    }
    distribution = means = ordered = None
    if ended:
        label = "Distribution of the final costs of each method, with runs as points."
        distribution = drawings.add(costs.distribution_figure(final, named), label)
        if whole:
            ordered = drawings.add(
                costs.sorted_figure(ended), "Final costs of each method over the share of its runs, sorted."
            )
    if len(ended) > 1:
        means = [_means(of, title, ended, drawings) for title, of in MEANS.items()]
    most = max((m.runs for m in methods), default=0)
    drawn = len(final[ended[0].name]) if ended else 0
    note = f" Of more than {drawn} runs every k-th in order of cost is drawn." if ended and most > 400 else ""
    return {
        "distribution": distribution,
        "distribution_note": f"Points: single runs, box: quartiles and median.{note}",
        "means": means,
        "sorted": ordered,
    }


def _means(
    of: Callable[[MethodRuns], RunsSummary], title: str, methods: Sequence[MethodRuns], drawings: Drawings
) -> dict[str, Any]:
    found = {m.name: of(m) for m in methods}
    figure = costs.means_figure(title, {name: (s.mean, s.t_interval) for name, s in found.items()})
    return drawings.add(figure, f"{title} of each method with its interval.")


def _curve_figures(problem: ProblemComparison, drawings: Drawings, whole: bool) -> dict[str, Any]:
    runs = {m.name: m.runs for m in problem.methods}
    evaluations = seconds = ecdf = None
    if whole and any(c.at for c in problem.convergence.values()):
        figure = curves.quartiles_figure(problem.convergence, runs, "evaluations", "evaluations")
        evaluations = drawings.add(figure, "Median best cost of each method against evaluations, with quartiles.")
        figure = curves.quartiles_figure(problem.convergence_seconds, runs, "seconds", "s")
        seconds = drawings.add(figure, "Median best cost of each method against seconds, with quartiles.")
    if problem.ecdf and problem.ecdf.targets:
        figure = curves.ecdf_figure(problem.ecdf, "evaluations")
        ecdf = drawings.add(figure, "Share of targets reached by each method against evaluations.")
    scale, count = problem.scale, (problem.ecdf and problem.ecdf.targets) or 0
    note = (
        f"Share of all pairs of a run and a target that were reached; {count} targets from {scale.reference:.4g} "
        f"({scale.source}) down towards {scale.best:.6g} "
        f"({'the known optimum' if scale.known else 'the best cost found'}), "
        "five to a decade of the gap."
        if scale
        else ""
    )
    return {"evaluations": evaluations, "seconds": seconds, "ecdf": ecdf, "ecdf_note": note}


def _answer_figures(problem: ProblemComparison, drawings: Drawings) -> dict[str, Any]:
    parallel, optima = problem.parallel or BestRuns(names=[], runs=[], left_out=0), problem.optima
    drawn = grouped = table = None
    if len(parallel.names) > 1 and parallel.runs:
        figure = answers.parallel_figure(parallel, [m.name for m in problem.methods])
        drawn = drawings.add(figure, "Parameters of the best runs, each at its place between its bounds.")
    if optima.count > 1:
        table = tables.optima_table(optima)
        if len(optima.names) > 1:
            grouped = drawings.add(answers.optima_figure(optima), "Parameters of distinct answers of the same cost.")
    left = f" {parallel.left_out} parameters that differ less are left out." if parallel.left_out else ""
    note = f"The {len(parallel.runs)} best runs, as many of each method, between the bounds of each parameter.{left}"
    return {"parallel": drawn, "parallel_note": note, "optima": grouped, "optima_table": table}


def _first_targets(problem: ProblemComparison) -> list[int]:
    """The targets asked for and the main one, else the first ones."""
    asked = [k for k, t in enumerate(problem.targets) if t.label[:2] != "10"]
    main = [] if problem.main_target is None else [problem.main_target]
    return list(dict.fromkeys([*asked, *main])) or list(range(min(FULL_TARGETS, len(problem.targets))))


def _targets_note(problem: ProblemComparison) -> str:
    scale = problem.scale
    restarts = "Expected evaluations count restarts after every miss (ERT); intervals from simulated restarts."
    if not scale:
        return restarts
    goal = "the known optimum" if scale.known else "the best cost found"
    return (
        f"10^-k: {goal} {scale.best:.6g} plus 10^-k of the gap to {scale.reference:.4g}, the {scale.source}. {restarts}"
    )


def _hitting(problem: ProblemComparison) -> tables.Table | None:
    if not problem.hitting or problem.main_target is None:
        return None
    return tables.hitting_table(problem.hitting, problem.targets[problem.main_target].cost)


def _about(problem: ProblemComparison) -> str:
    numbers = problem.studies
    return f"{'Study' if len(numbers) == 1 else 'Studies'} {listed(str(n) for n in numbers)}." if numbers else ""


def said(level: str, sentence: str) -> dict[str, str]:
    return {"level": level, "word": LEVELS[level][0], "mark": LEVELS[level][1], "sentence": sentence}


# findings to runs


def _placed(p: Parameter) -> bool:
    """Whether a parameter has a place between finite bounds."""
    low, high = p.lower_bound, p.upper_bound
    if p.status == "fixed" or low is None or high is None or not high > low:
        return False
    return p.scale == "linear" or low > 0


def _folded(
    values: Mapping[str, Number],
    best: Mapping[str, Number],
    symmetries: Sequence[SameModel],
    coordinates: Sequence[Parameter],
) -> Mapping[str, Number]:
    """The values written as the best run's are: of all that exchanges and signs make the same model, those nearest
    to it."""

    def distance(own: Mapping[str, Number]) -> float:
        return max((abs(_place(p, own.get(p.name)) - _place(p, best.get(p.name))) for p in coordinates), default=0.0)

    images = [values]
    for _ in range(MOST_IMAGES):
        fresh = [m for v in images for s in symmetries if (m := _image(v, s)) is not None and m not in images]
        if not fresh or len(images) > MOST_IMAGES:
            break
        images += fresh
    return min(images, key=distance)


def _image(values: Mapping[str, Number], symmetry: SameModel) -> Mapping[str, Number] | None:
    moved = dict(values)
    wholes = symmetry.whole or [0.0] * len(symmetry.sign)
    for (name, source), sign, whole in zip(symmetry.source.items(), symmetry.sign, wholes, strict=True):
        value = values.get(source)
        if value is None:
            return None
        moved[name] = whole + sign * value
    return moved


def _run_record(run: Run, coordinates: Sequence[Parameter]) -> RunRecord:
    history = array(run.history.cost)
    finite = history[np.isfinite(history)]
    cost = float(finite[-1]) if len(finite) else float("nan") if run.cost is None else run.cost
    values = {name: float("nan") if v is None else v for name, v in run.parameters.items()}
    return RunRecord(
        run.method, run.run, run.seed or 0, np.array([_place(p, values.get(p.name)) for p in coordinates]), cost,
        values,
        run.evaluations or 0.0, run.seconds or 0.0, Status.budget, run.failures, array(run.history.evaluations),
        history, {},
    )  # fmt: skip


def _place(p: Parameter, value: float | None) -> float:
    """Where a value lies between its bounds, 0 to 1; the middle if it is not known."""
    if value is None or not isfinite(value):
        return 0.5
    low, high = float(p.lower_bound or 0.0), float(p.upper_bound or 0.0)
    if p.scale == "log" and value > 0:
        return log(value / low) / log(high / low)
    return (value - low) / (high - low)
