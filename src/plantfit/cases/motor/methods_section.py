"""Section of the motor's page on the search: the paper's objective and who minimises it."""

from typing import Any

import numpy as np

from plantfit.cases.motor.bench import PUBLISHED, TRUTH
from plantfit.cases.motor.methods import GA, GUARDED, Methods, errors_at, parts_at
from plantfit.cases.shared.panels import signals_figure
from plantfit.findings.results.methods_compared import ProblemComparison
from plantfit.optimize import RunResult
from plantfit.report.figures import style
from plantfit.report.figures.comparison.answers import parallel_figure
from plantfit.report.figures.comparison.costs import distribution_figure
from plantfit.report.figures.comparison.curves import quartiles_figure
from plantfit.report.figures.style import Figure
from plantfit.study.comparing.sentences import p_value
from plantfit.trust.verdict.words import number

SHOWN = 60.0  # s of the errors that are drawn
COLUMNS = ["method", "best", "median", "worst", "evaluations", "seconds a run"]


def methods_section(found: Methods, guard: RunResult) -> dict[str, Any]:
    """Costs of every method, constants of their best runs, and what both errors are worth there."""
    record, names = found.record, found.problem.space.names
    methods = record.methods
    rows = [[m.name, *(f"{v:.4g}" for v in (m.cost.minimum, m.cost.median, m.cost.maximum)),
             f"{m.evaluations.mean:.0f}",
             f"{m.seconds.mean:.2f}"] for m in methods]  # fmt: skip
    constants = [
        _row("truth of the bench", TRUTH, found),
        *(_row(f"{label}, best run", found.best(label), found) for label in found.results),
    ]
    scales = found.problem.scales
    counts = {m.name: m.runs for m in methods}
    final = {m.name: m.sorted.cost for m in methods if m.sorted}
    ends = [record.parallel] if record.parallel else []
    order, *said = record.sentences
    told = [order.sentence, *_pairs(record), *(s.sentence for s in said if s.level == "warning")]
    return {
        "title": "The paper's objective and the genetic algorithm",
        "sentences": [
            f"J is the mean of (e1/{scales['w']:.3g} rad/s)^2 and (e2/{scales['Ve']:.3g} V)^2, each "
            "signal weighed by its standard deviation: e1 is the surrogate's speed less the model's, "
            "e2 the voltage less Rm/Kt torque + Kb w with the model's torque and the surrogate's speed.",
            f"The paper's binary GA, 200 generations of 70 ({found.budget} evaluations), in "
            "two readings of its rates 0.6 and 0.4, and other methods with the same budget. "
            "The third reading, 0.4 for each bit, is random search and is not offered.",
            "e2 measures nothing: along any solution of the model it is Lm di/dt + Kb (w of the model - w "
            f"of the surrogate). At the truth J is {found.truth:.4g}; {_below(found)}, which makes e2 small.",
            "By least squares the model's speed of the genetic algorithm's best run "
            f"is {_lag(_late(found))} the surrogate's (the paper: slightly delayed).",
            f"The paper's answer too has a small Kb ({PUBLISHED['Kb']}) beside its Kt ({PUBLISHED['Kt']}).",
            f"Overflow: with a fixed step of 10 ms (RK4), {guard.failures} of the {GUARDED} candidates of a run "
            "of 30 generations diverge; each is counted, costs infinity, and the run goes on. With the stepper "
            f"of all other runs {sum(r.failures for rs in found.results.values() for r in rs)} candidates do.",
            *told,
        ],
        "tables": [
            {"caption": "J after the same budget", "columns": COLUMNS, "rows": rows},
            {"caption": "Where the best runs end", "columns": ["run", "J", "rms e1 [rad/s]", "rms e2 [V]", *names],
             "rows": constants, "note": "Constants in ohm, H, V s/rad, kg m², N m s/rad and N m."},
        ],
        "figures": [
            {"figure": _over_time(found), "label": f"The first {SHOWN:g} s: speed of the surrogate and of the model, "
                                                   f"voltage applied and "
                                                   "calculated, and their differences e1 and e2 (the paper's figures "
                                                   "15 and 16)"},
            {"figure": distribution_figure(final, {"J at the truth": found.truth}),
             "label": "J at the end of every run"},
            {"figure": quartiles_figure(record.convergence, counts, "evaluations", "evaluations"),
             "label": "J against evaluations"},
            *({"figure": parallel_figure(p, list(found.results)),
               "label": "Where the runs ended between the bounds"} for p in ends),
        ],
    }  # fmt: skip


def _pairs(record: ProblemComparison) -> list[str]:
    """Whom the method with the lowest median beats, in one sentence, and the sentences of pairs that it does not."""
    best = min(record.methods, key=lambda m: m.cost.median).name
    own = [p for p in record.pairs if best in (p.better, p.worse)]
    won = [p for p in own if p.differs and p.better == best]
    if not won:
        return [p.sentence for p in own]
    shares = ", ".join(f"{p.worse} {p.a12:.2f}" for p in won)
    return [
        f"{best} beats, with the share of pairs of runs that it wins (A12): {shares}; largest "
        f"{p_value(max(p.p_holm for p in won))} "
        f"after Holm for {won[0].pairs} pairs of methods, {won[0].runs[0]} runs each.",
        *(p.sentence for p in own if p not in won),
    ]


def _over_time(found: Methods) -> Figure:
    """Both signals and both errors of the genetic algorithm's best run and of the truth."""
    label = _best_ga(found)
    [experiment] = found.problem.experiments.values()
    t = experiment.recording.t
    shown = t <= SHOWN
    panels: dict[str, dict[str, tuple[np.ndarray, str, float]]] = {}
    signals = (("w", "speed [rad/s]", "e1 [rad/s]", "surrogate"), ("Ve", "voltage [V]", "e2 [V]", "applied"))
    runs = {"truth": (errors_at(found.problem, TRUTH), style.MEASURED, 2.4)}
    runs[f"{label}, best run"] = (errors_at(found.problem, found.best(label)), style.SIMULATED, 1.2)
    for k, (signal, axis, error, seen) in enumerate(signals, start=1):
        own = experiment.recording[signal]
        (_, *best), colour, width = runs[f"{label}, best run"]
        made = f"{'model' if signal == 'w' else 'calculated'}, {label}"
        panels[axis] = {seen: (own[shown], style.INK, 2.4), made: ((own - best[k - 1])[shown], colour, width)}
        panels[error] = {f"{n}, e{k}": (both[k][shown], c, w) for n, (both, c, w) in runs.items()}
    return signals_figure(t[shown], list(panels.items()))


def _best_ga(found: Methods) -> str:
    """The reading of the genetic algorithm's rates with the lowest J."""
    return min(GA, key=lambda k: min(r.cost for r in found.results[k]))


def _late(found: Methods) -> float:
    """By how much the model's speed of the best run is behind the surrogate's, in ms: w_model(t) = w(t - d) to first
    order."""
    t, e1, _ = errors_at(found.problem, found.best(_best_ga(found)))
    [experiment] = found.problem.experiments.values()
    slope = np.gradient(experiment.recording["w"], t)
    return float(1e3 * np.sum(e1 * slope) / np.sum(slope**2))


def _lag(late: float) -> str:
    return f"{abs(late):.2g} ms {'behind' if late > 0 else 'ahead of'}"


def _below(found: Methods) -> str:
    """How many runs end below the cost of the truth, and at which Kb."""
    at = found.problem.space.names.index("Kb")
    ends = [
        (r.cost, kb)
        for label, rs in found.results.items()
        for r, kb in zip(rs, found.answers(label)[:, at], strict=True)
    ]
    low = [kb for cost, kb in ends if cost < found.truth]
    smaller = sum(kb < TRUTH["Kb"] for kb in low)
    return f"{len(low)} of {len(ends)} runs end below it, {smaller} of them with a smaller Kb"


def _row(label: str, constants: dict[str, float], found: Methods) -> list[str]:
    e1, e2 = parts_at(found.problem, constants)
    cost = 0.5 * ((e1 / found.problem.scales["w"]) ** 2 + (e2 / found.problem.scales["Ve"]) ** 2)
    return [label, f"{cost:.4g}", f"{e1:.4f}", f"{e2:.4f}", *(number(constants[n]) for n in found.problem.space.names)]


def spread(found: Methods, label: str, name: str) -> tuple[float, float]:
    """Smallest and largest value of a constant among the runs of a method."""
    own = found.answers(label)[:, found.problem.space.names.index(name)]
    return float(np.min(own)), float(np.max(own))
