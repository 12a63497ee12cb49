"""`plantfit check`: what was understood, and one simulation."""

import dataclasses
import math
import re
import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from plantfit.cli.arguments.assignments import numbers_by_name
from plantfit.cli.terminal.out import out, print_json

if TYPE_CHECKING:
    import numpy as np

NUMBER = re.compile(r"\d[\d.]*(e[+-]?\d+)?")
FEW = 3  # recordings that are named beside the first that is odd alike


def check(spec: str, verify: bool, json: bool, at: Sequence[str] = (), tolerance: float | None = None,
          holds: bool = False,
          identify: bool = False) -> None:  # fmt: skip
    """Read a study file, simulate at the middle of the box or at the values given, optionally compare with a tight
    solver."""
    from plantfit import spec as specs

    study = specs.load(spec)  # first, since the rooms below load jax
    from plantfit.problem.accuracy.steps import choose_substeps, steps_and_error
    from plantfit.problem.accuracy.verification import point

    problem = choose_substeps(study.problem)
    z = point(problem, numbers_by_name("--at", at))
    problem, error = steps_and_error(problem, z)
    from plantfit.trust.looks import problem_looks
    from plantfit.trust.looks.misreadings import misreading_looks, misreadings, telling

    looks = [*problem_looks(problem), *misreading_looks(problem, telling(problem, misreadings(problem)))]
    record: dict[str, Any] = {
        **_understood(study, problem),
        "data": [*_of_regression(study), *(look.record for look in looks)],
        **_simulated(problem, z),
        "step_error": error,
    }
    from plantfit.trust.identify.before_fit import before_fit

    resting = {look.recording for look in looks if look.kind == "at rest"} >= set(problem.experiments)
    # sensitivities through events, friction and play compile for minutes
    told = before_fit(problem) if not resting and (identify or getattr(problem.model, "smooth", True)) else None
    record["identifiable"] = None if told is None else told.record
    from plantfit.trust.looks.reach import out_of_reach

    record["data"] += [look.record for look in (() if resting else out_of_reach(problem))]
    if study.errors:
        from plantfit.trust.stated_errors.reading_budgets import reading_budgets

        record["uncertainty"] = [b.plain() for b in reading_budgets(problem, study.errors)]
    if verify:
        record["verify"] = _verify(problem, z, tolerance)
    if holds:
        from plantfit.problem.measure.hold_check import check_holds

        record["holds"] = [{**dataclasses.asdict(h), "sentence": h.sentence} for h in check_holds(problem, z)]
    if json:
        return print_json(record)
    _say_understood(problem, record)
    _say_simulated(problem, record, at, tolerance)
    say_inexact(error, middle=not at)
    say_looks(record["data"])
    for told in (record["identifiable"] or {}).get("sentences", []):
        say_looks([{**told, "write": None}])
    if not (identify or getattr(problem.model, "smooth", True)):
        out.print(
            f"What these records can determine: plantfit check {spec} "
            "--identify (this model's sensitivities compile long).",
            markup=False,
        )
    out.print(f"ready: plantfit run {spec}", markup=False)


def _of_regression(study: Any) -> list[dict[str, Any]]:
    """What is to be said of a regression: that it needs instruments and has none, or how they fit the band."""
    looks = [study.biased] if study.biased else []
    return [dict(look) for look in (*looks, *(study.regression.sentences if study.regression else ()))]


def _understood(study: Any, problem: Any) -> dict[str, Any]:
    """What the study file says, as a plain record."""
    from plantfit.problem.linear.affine import affine_by_structure
    from plantfit.trust.finish.weights import weight_rows

    return {
        "name": study.name,
        "model": problem.model.name,
        "recordings": {
            n: {
                "samples": len(e.recording),
                "seconds": float(e.recording.t[-1] - e.recording.t[0]),
                "fitted": int(e.mask("fit").sum()),
                "unseen": int(e.mask("validation").sum()),
                "log": list(e.recording.log),
            }
            for n, e in problem.experiments.items()
        },
        "parameters": {
            c.name: {"bounds": [c.lower, c.upper], "unit": c.unit, "scale": "log" if c.log else "linear"}
            for c in problem.space.coordinates
        },
        "solved_for": [problem.space.names[i] for i in affine_by_structure(problem)]
        if problem.separable is None
        else [],
        "weights": [w.plain() for w in weight_rows(problem)],
        "evaluations": study.plan.budget * study.plan.runs * len(study.plan.methods),
    }


def say_looks(looks: Sequence[Mapping[str, Any]]) -> None:
    """What is odd about the data, with the line that treats it; of recordings that are odd alike the first in full."""
    alike: dict[Any, list[Mapping[str, Any]]] = {}
    times: Counter[Any] = Counter()  # a second look of a recording is no other recording's first
    for look in looks:
        name = str(look.get("recording") or "")
        said = NUMBER.sub("", look["sentence"].replace(name, "") if name else look["sentence"])
        same = (bool(name), look.get("kind"), look.get("signal"), look.get("other"), said)
        alike.setdefault((same, times[same, name]), []).append(look)
        times[same, name] += 1
    for look, *others in alike.values():
        mark, colour = ("!", "yellow") if look["level"] == "warning" else ("i", "cyan")
        names = [o["recording"] for o in others]
        left = f" and {len(names) - FEW} more" if len(names) > FEW else ""
        more = f" This is {look['recording']}; alike in {', '.join(names[:FEW])}{left}." if names else ""
        out.print(f"[{colour}]{mark}[/{colour}] ", end="")
        out.print(look["sentence"] + more + (f" Write: {look['write']}" if look["write"] else ""), markup=False)


def say_inexact(error: float | None, middle: bool = False) -> None:
    """That no steps made a simulation as exact as they should; `error` is a share of the spread of an output, None
    where they did. `middle`: it is one at the middle of the bounds, which nobody chose."""
    if error is None:
        return
    size = (
        f"about {100 * error:.2g} % of the spread of an output"
        if error < 1.0
        else "as large as the outputs move, or larger"
    )
    if middle:
        text = (
            f"At the middle of the bounds no steps make the simulation exact to 0.2 %: its error is {size}. A state "
            "may grow without bound there, or a part be very much quicker than the others. A run passes over such "
            "points and checks its answer. Narrow the bounds if it finds none."
        )
        return say_looks([{"level": "warning", "sentence": text, "write": None}])
    text = (
        f"No steps make this simulation exact to 0.2 %: its error is {size}, so do not use its numbers. "
        "Look for a part that is very much quicker than the others, or for a state that grows without bound."
    )
    say_looks([{"level": "warning", "sentence": text, "write": None}])


def _simulated(problem: Any, z: "np.ndarray") -> dict[str, Any]:
    """One simulation at a cube point (d,), as a plain record."""
    cost = problem.costs(z[None, :]).tolist()[0]
    started = time.perf_counter()
    problem.costs(z[None, :]).tolist()  # waits for the values
    simulator = problem.predictor.simulator
    return {
        "stepper": simulator.stepper if simulator else None,
        "substeps": problem.steps_a_sample if simulator else 0,
        "rmse_at_middle": cost**0.5 if math.isfinite(cost) else None,
        "seconds_per_evaluation": time.perf_counter() - started,
    }


def _say_understood(problem: Any, record: Mapping[str, Any]) -> None:
    from plantfit.models import describe

    out.print(describe(problem.model), markup=False)
    for n, r in record["recordings"].items():
        out.print(
            f"recording {n}: {r['samples']} samples over {r['seconds']:g} "
            f"s, {r['fitted']} fitted, {r['unseen']} unseen",
            markup=False,
        )
        for line in r["log"]:
            out.print(f"    {line}", markup=False, style="dim")
    out.print(f"free: {_shortened(record['parameters'])}", markup=False)
    if record["solved_for"]:
        solved = _shortened(record["solved_for"])
        out.print(f"linear, so that least squares solves for them: {solved}", markup=False)
    out.print(f"residuals that count as 1: {'; '.join(_weight(row) for row in record['weights'])}", markup=False)


def _say_simulated(problem: Any, record: Mapping[str, Any], at: Sequence[str], tolerance: float | None) -> None:
    from plantfit.problem.told import steps_text

    rmse = f"RMSE (scaled) {record['rmse_at_middle']:.4g}" if record["rmse_at_middle"] is not None else "not finite"
    place = f"at {', '.join(at)}" if at else "at the middle of the bounds"
    named = numbers_by_name("--at", at)
    if at and any(c.name not in named and c.parameter not in named for c in problem.space.coordinates):
        place += ", the others in the middle of their bounds"
    each = (
        f"{1e3 * record['seconds_per_evaluation']:.2g} ms an evaluation, "
        f"{steps_text(record['stepper'], record['substeps'])}"
    )
    out.print(f"{place}: {rmse}; {each}", markup=False)
    for e in record.get("verify", []):
        unit = problem.model.outputs[e["output"]] or ""
        out.print(
            f"against {e['checked_with']}: {e['recording']}, {e['output']} within {e['max_error']:.3g} {unit} (rms "
            f"{e['rms_error']:.3g}) "
            f"over {e['samples']} samples, {steps_text(e['stepper'], e['substeps'])}",
            markup=False,
        )
        if e["refused"]:
            out.print(f"    refused: {e['refused']}", style="red", markup=False)
        elif tolerance is not None and e["max_error"] >= tolerance:
            out.print(
                f"    not below {tolerance:g}: the model is too stiff or too rough here for finer steps to help",
                style="yellow",
            )
    for h in record.get("holds", []):
        out.print(h["sentence"], markup=False)
    if "uncertainty" in record:
        from plantfit.report import budgets_text

        out.print(f"\nstated errors:\n\n{budgets_text(record['uncertainty'])}\n", markup=False)


def _weight(row: Mapping[str, Any]) -> str:
    """An output, its scale and who chose it; a first guess is said to be one."""
    later = ", until the fit estimates it from the residuals" if row["chosen"] == "spread" else ""
    unit = "" if row["unit"] in (None, "", "-", "1") else f" {row['unit']}"
    return f"{row['output']} {row['scale']:.4g}{unit} ({row['who']}{later})"


def _shortened(names: Iterable[str], most: int = 12) -> str:
    names = list(names)
    return ", ".join(names) if len(names) <= most else f"{', '.join(names[:most])} and {len(names) - most} more"


def _verify(problem, z, tolerance):
    from plantfit.problem.accuracy.verification import verify

    return [dataclasses.asdict(v) for v in verify(problem, z, tolerance)]
