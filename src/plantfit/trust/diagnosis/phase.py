"""The diagnosis of an answer that was judged: whether its findings ask for one, how much work it may be, and what
they say then."""

import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.findings.diagnosis import Diagnosis as Section
from plantfit.findings.diagnosis import ResidualChange
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Model
from plantfit.optimize.contract import RunResult
from plantfit.problem.problem import Problem
from plantfit.recording.clean.outliers import inline
from plantfit.trust.diagnosis.diagnose import Diagnosis, diagnose, treatable
from plantfit.trust.diagnosis.meter import Meter, Stopped
from plantfit.trust.diagnosis.plant.timeless.regression import Regression
from plantfit.trust.diagnosis.sentences import Linear, diagnosis_record, likelihood, of_columns, with_linear
from plantfit.trust.diagnosis.treatment import changed
from plantfit.trust.finish.other_columns import Change, OtherColumns, other_columns, shares
from plantfit.trust.finish.other_starts import OtherStarts, other_starts
from plantfit.trust.intervals.first_values import states_begun_at
from plantfit.trust.intervals.robust_or_classical import has_times
from plantfit.trust.verdict.all_sentences import sentences
from plantfit.trust.verdict.outputs import FLOOR as AT_NOISE
from plantfit.trust.verdict.outputs import GOOD, at_rest, disagree, forgotten, noise_rows
from plantfit.trust.verdict.words import Sentence, number, say, some, study_file, with_unit

Findings = dict[str, Any]

TIMES = 2.0  # the evaluations of the search
FLOOR_SAMPLES = 2e6  # simulated samples that are allowed after the shortest search, a second or two
MOST, LONGEST = 60, 100_000  # coordinates and residuals beyond which one evaluation is not what it costs
HARDLY = 90.0  # percent: below that columns may be wrong
DRAWN = 0.05  # of the mean square: what explains less is not drawn


def asked_for(findings: Mapping[str, Any]) -> bool:
    """Whether the residual of some output is above its noise, not white, also in recordings of few samples taken
    together, or follows a curve in the inputs."""
    tests = (*findings["residual_tests"], *findings.get("short_recordings", ()))
    return any(not r["white"] or r.get("curved") for r in tests) or any(
        r["ratio"] >= AT_NOISE for r in noise_rows(findings)
    )


def with_diagnosis(
    problem: Problem,
    runs: Sequence[RunResult],
    findings: Findings,
    *,
    whole: bool = False,
    progress: Callable[[str], None] | None = None,
    stop: Callable[[], bool] | None = None,
    linear: Linear | None = None,
    regression: Regression | None = None,
) -> Findings:
    """The findings of an answer with section "diagnosis" and the verdict that goes with it.

    They are given back as they are where they do not ask for a diagnosis and where the model cannot be treated. The
    work is about twice the evaluations that `runs` spent, or those that simulate two million samples if that is more,
    and none for problems of over 60 coordinates or 100000 residuals; with `whole` all is tried, whatever the findings
    say. `stop` ends it, and the findings then say so. `linear` as in `with_linear`, `regression` as in `diagnose`.
    Raises ModelError only with `whole`, for recordings over time beside others at rest.
    """
    if not whole and not (asked_for(findings) and (isinstance(problem.model, LinearModel) or treatable(problem))):
        return findings
    best = min(runs, key=lambda r: r.cost)
    if not whole and _lost(findings) and (starts := other_starts(problem, best.x)) is not None:
        # a simulation that begins wrongly tells nothing of the model, nor of whether it forgets its start
        findings = {**findings, "simulation": {**findings["simulation"], "forgets": []}}
        return _said(findings, best, {"state": "left", "verdict": [_begun_wrongly(problem, starts)]})
    ask = not whole and _lost(findings, HARDLY)
    if ask and (columns := other_columns(problem, best.x, progress, stop)) is not None:
        findings = {**findings, "simulation": {**findings["simulation"], "forgets": []}}
        told = _otherwise_recorded(problem, columns)
        told = {**told, "sentence": f"{told['sentence']} Nothing else was tried."}
        return _said(findings, best, {"state": "left", "verdict": [told]})
    if not whole and forgotten(findings):
        text = (
            "What may be missing was not tried, as the simulation forgets "
            f"its start; {_command(findings)} tries it all the same."
        )
        return _said(findings, best, {"state": "left", "verdict": [say("info", text)]})
    if not whole and at_rest(findings):
        text = "What may be missing was not tried, as the model stays where it begins."
        return _said(findings, best, {"state": "left", "verdict": [say("info", text)]})
    count = sum(len(e.recording) for e in problem.experiments.values()) * len(problem.outputs)
    command = _command(findings)
    if not whole and _at_noise(straight := _held(findings)):
        names = some([look["signal"] for look in straight])
        text = (
            f"What may be missing was not tried, as straight lines between the samples of {names} leave "
            f"hardly more than noise; {command} tries it all the same."
        )
        return _said(findings, best, {"state": "left", "verdict": [say("info", text)]})
    if not whole and (problem.space.dimension > MOST or count > LONGEST):
        size = f"{problem.space.dimension} parameters on {count} samples"
        text = f"What may be missing was not tried, as {size} take long; {command} does it."
        return _said(findings, best, {"state": "left", "verdict": [say("info", text)]})
    allowed = max(TIMES * sum(float(r.evaluations) for r in runs), FLOOR_SAMPLES / max(count, 1))
    meter = Meter(float("inf") if whole else allowed, stop)
    try:
        found = diagnose(problem, best.x, progress, meter=meter, regression=regression)
    except Stopped:
        text = f"The search for what may be missing was stopped; {command} does it."
        return _said(findings, best, {"state": "stopped", "verdict": [say("info", text)]})
    except ModelError as error:
        if whole:
            raise
        return _said(
            findings, best, {"state": "left", "verdict": [say("info", f"What may be missing was not tried: {error}")]}
        )
    found = with_linear(found, linear)
    record = diagnosis_record(found, alone=False)
    record["verdict"] += _cut(found, command)
    more = {"state": "whole" if found.whole else "part", "allowed": None if whole else meter.limit, **_after(found)}
    record["verdict"] += _first_values(problem, best.x, found)
    first = list(_data_first(found, findings))
    otherwise = bool(first) or found.surpassed  # what was found may stand for something else, which the verdict names
    return _said(
        findings,
        best,
        {**record, "verdict": record["verdict"] + first, **more, "next": "" if otherwise else _next(found, findings)},
    )


def misrecorded(
    problem: Problem,
    z: np.ndarray,
    progress: Callable[[str], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> list[Sentence]:
    """What a record that the answer z (d,) does not follow may be told wrongly, before anything is added to the model:
    the first measured value that states begin at, else a column; empty where neither explains it."""
    if not isinstance(problem.model, Model):
        return []
    least = 100.0 * (1.0 - max(shares(problem, z).values()))
    if least < GOOD and (starts := other_starts(problem, z)) is not None:
        return [_begun_wrongly(problem, starts)]
    if least < HARDLY and (columns := other_columns(problem, z, progress, stop)) is not None:
        return [_otherwise_recorded(problem, columns)]
    return []


def _lost(findings: Mapping[str, Any], least: float = GOOD) -> bool:
    """Whether some record is followed to less than this percentage."""
    fits = [s["fit_percent"] for s in findings["scores"] if s["part"] == "fit"]
    return any(f is not None and f < least for f in fits)


def _held(findings: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Looks at inputs that were held and go straight between their samples."""
    return [look for look in findings.get("data", ()) if look["kind"] == "hold" and look["write"]]


def _at_noise(straight: Sequence[Mapping[str, Any]]) -> bool:
    """Whether straight lines of all these inputs leave hardly more than noise, by the look that left the least."""
    return any(look["figures"]["noise"] is not None and look["figures"]["noise"] < AT_NOISE for look in straight)


def _begun_wrongly(problem: Problem, found: OtherStarts) -> Sentence:
    """That states cannot begin at first measured values, and the lines that free them."""
    outputs = list(dict.fromkeys(o for _, o in found.measured))
    units = {o: problem.model.outputs[o] for o in problem.outputs}
    several = len(problem.data["drive"]) > 1
    where = some([f"{with_unit(v, units[o])} of {o} in {n}" for (n, o), v in found.measured.items()], most=3)
    instead = some([f"{with_unit(v, units[o])} of {o} in {n}" for (n, o), v in found.instead.items()], most=3)
    better = some([f"{o} {with_unit(found.after[o], units[o])} (now {number(found.before[o])})" for o in units])
    one = len(found.measured) == 1
    lines = []
    for o in outputs:
        own = [v for (_, name), v in found.instead.items() if name == o]
        room = max(max(map(abs, own)), 3 * found.noise[o] if found.noise[o] > 0 else 0.0)
        low, high = min(own) - room, max(own) + room
        row: dict[str, Any] = {"bounds": [float(f"{low:.2g}"), float(f"{high:.2g}")]}
        row |= {"unit": str(units[o])} if units[o] else {}
        row |= {"per_recording": True} if several else {}
        lines.append(f"{o}_first = {inline(row)}")
    names = " and ".join(f"{o}_first in place of {o}" for o in outputs)
    text = (
        f"States begin at {'the first measured value' if one else 'first measured values'} ({where}), from which the "
        f"model does not follow the record. From {instead} it does, with an RMSE of {better}: "
        f"{'that sample is' if one else 'those samples are'} wrong, or too noisy to begin at. Make the start a "
        f"parameter: write {names} in the initial values, and under [parameters] {', '.join(lines)}."
    )
    return say("bad", text, **{f"rmse_{o}": v for o, v in found.after.items()})


def _otherwise_recorded(problem: Problem, found: OtherColumns) -> Sentence:
    """With which change of a column the model follows the record, or with which several, and the line that makes the
    first."""
    units = {o: problem.model.outputs[o] for o in problem.outputs}
    reached = some([f"{with_unit(v, units[o])} of {o} (now {number(found.before[o])})" for o, v in found.after.items()])
    best = found.changes[0]
    if len(best.signals) == 2:
        names = " and ".join(best.signals)
        cause = f"the columns of {names} may be exchanged"
        write = f"exchange {names} under signals"
    else:
        [name] = best.signals
        cause = f"the {'sign' if best.factor < 0 else 'unit'} of {name} may be wrong, in the recording or in the model"
        step = {"step": "scale", "signal": name, "factor": float(f"{best.factor:.10g}")}
        recordings = list(problem.experiments)
        where = f"[recording.{recordings[0]}]" if len(recordings) == 1 else "every recording"
        write = (
            f"write clean = [{inline(step)}] under {where} (after its other steps, if it has any), or mend the equation"
        )
    them, look = _as_change(best), f"Look at it, and {write}"
    if len(found.changes) > 1:
        *others, last = (_as_change(c) for c in found.changes)
        them = f"{', '.join(others)} or {last}"
        cause, look = "the record does not tell which of them is wrong", f"Look at them, and for the first {write}"
    text = f"With {them} the model follows the record, with an RMSE of {reached}: {cause}. {look}."
    return say("bad", text, **{f"rmse_{o}": v for o, v in found.after.items()})


def _as_change(change: Change) -> str:
    if len(change.signals) == 2:
        return f"{' and '.join(change.signals)} exchanged"
    [name] = change.signals
    if change.units is None:
        return f"the other sign of {name}"
    return f"{name} taken as {change.units[0]} in place of {change.units[1]}"


def _first_values(problem: Problem, z: np.ndarray, found: Diagnosis) -> Iterator[Sentence]:
    """That initial values which are off are measured ones: the sample may be to blame, and not the model. Nothing of a
    sample at which other states begin than those that are off."""
    off = {t.extension.signal for t in found.found if t.extension.kind == "start"}
    if not off:
        return
    for output, states in states_begun_at(problem, z).items():
        if not off & set(states):
            continue
        seen = {n: e.recording[output] for n, e in problem.experiments.items() if n in problem.data["drive"]}
        first = {n: float(y[np.isfinite(y)][0]) for n, y in seen.items() if np.isfinite(y).any()}
        unit = problem.model.outputs[output]
        values = some([f"{with_unit(v, unit)} in {n}" for n, v in first.items()], most=3)
        text = (
            f"States begin at the first measured value of {output} ({values}), and a start beside it follows the "
            "record better: that sample may be wrong, or too noisy to begin at. The added start takes its place."
        )
        yield say("warning", text)


def _said(findings: Findings, best: RunResult, diagnosis: dict[str, Any]) -> Findings:
    made = {**findings, "diagnosis": Section.model_validate({**_EMPTY, **diagnosis}).plain()}
    return {**made, "verdict": sentences(made, best)}


_EMPTY = {
    "rounds": [], "dropped": [], "exchanged": {},
    "outliers": None, "write": [], "evaluations": 0.0, "allowed": None, "with": [], "residuals": [],
    "next": "",
}  # fmt: skip


def _command(findings: Mapping[str, Any]) -> str:
    """What makes a whole diagnosis of this study."""
    file = study_file(findings)
    return f"`plantfit diagnose {shlex.quote(file)}`" if file else "`answer.diagnose(whole=True)`"


def _next(found: Diagnosis, findings: Mapping[str, Any]) -> str:
    """The command that fits the model with what was found, or, where that is hardly sure and recordings disagree, the
    one that fits each alone; "" without a study file."""
    file, changes = study_file(findings), changed(found)
    if not file or not changes:
        return ""
    if findings.get("differentiated") and all(of_columns(found, one) for one in found.rounds if one.found):
        return ""
    if disagree(findings) and all(likelihood(found, one) in ("possibly", None) for one in found.rounds):
        return f"plantfit compare-records {shlex.quote(file)}"
    return " ".join(["plantfit run", shlex.quote(file), *(f'--try "{c.name}"' for c in changes)])


def _cut(found: Diagnosis, command: str) -> Iterator[Sentence]:
    """What the work allowed was not enough for."""
    if found.whole:
        return
    first, limit = found.rounds[0], f"within the {found.carrier.meter.limit:.0f} evaluations that it may take"
    tried, untried = len(first.trials), len(first.untried)
    if untried:
        yield say(
            "info",
            f"{tried} of {tried + untried} additions to the model were tried {limit}; {command} tries the rest.",
            tried=tried,
        )
    else:
        beside = " beside that" if found.found else ""
        yield say("info", f"What may be missing{beside} was not tried in full {limit}; {command} does it.", tried=tried)


def _data_first(found: Diagnosis, findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """That what a diagnosis finds beside a sensor that seems stuck, or is read seldom, beside a wrong hold, or beside a
    parameter on a bound of the search, may stand for that; nothing where it finds none."""
    if not (found.found or found.disturbed or found.drifting or found.repeating or found.stepping or found.mode):
        return
    seldom = some(
        list(dict.fromkeys(k["signal"] for k in findings.get("data", ()) if k["kind"] in ("held", "filled"))) or [""]
    )
    if seldom:
        text = (
            f"{seldom} was read more seldom than it was recorded, and what "
            "is said of what may be missing may stand for that: keep the "
        )
        yield say("warning", f"{text}fresh samples alone, as the look at {seldom} says, and run again.")
    if held := [look["signal"] for look in _held(findings)]:
        straight, its = some(held), "its hold" if len(held) == 1 else "their holds"
        text = (
            f"Straight lines between the samples of {straight} fit better, and what is said of what may be missing may "
            f"stand for that: state {its} first, "
        )
        yield say("warning", f"{text}as the sentence on {held[-1]} says, and run again.")
    if pressed := _pressed(findings):
        one, command = len(pressed) == 1, _next(found, findings)
        text = (
            f"{some(pressed)} ended on {'a bound' if one else 'bounds'} of the search, and what is said of what may be "
            f"missing may stand for that: widen {'it' if one else 'them'} first if physics allows, and run again"
        )
        yield say("warning", f"{text}{f'; else run `{command}`' if command else ''}.")
    outputs = some(
        list(dict.fromkeys(look["signal"] for look in findings.get("data", ()) if look["kind"] == "stuck")) or [""]
    )
    if outputs:
        text = (
            f"{outputs} may have been stuck, and what is said of what may "
            "be missing may stand for that: take those samples out first, "
        )
        yield say("warning", f"{text}as the look at {outputs} says, and run again.")


def _pressed(findings: Mapping[str, Any]) -> list[str]:
    """Parameters that the data pull beyond a bound which is no physical limit; those that end at 0 may be none."""
    found = []
    for p in findings.get("parameters", ()):
        if p["status"] != "at bound" or not p.get("at_bound"):
            continue
        lower = p["at_bound"] == "lower"
        bound, limit = p[f"{p['at_bound']}_bound"], (p.get("limits") or (None, None))[0 if lower else 1]
        if bound != limit and not (lower and bound == 0.0):
            found.append(p["name"])
    return found


def _after(found: Diagnosis) -> dict[str, Any]:
    """Residuals (measured minus simulated) of the model as it is and with what was found, else with what explains
    most, if that is worth a drawing."""
    if found.repeating is not None:
        return {"with": [found.repeating.places[0].name], "residuals": list(_series(found, found.repeating.left))}
    if found.stepping is not None:
        return {"with": [found.stepped[0].name], "residuals": list(_series(found, found.stepping.left))}
    if found.mode is not None:
        name = f"slow mode of {found.mode.output} that {found.mode.input} drives"
        return {"with": [name], "residuals": list(_series(found, found.mode.residuals))}
    trials = found.rounds[0].trials
    best = found.found[-1] if found.found else trials[0] if trials and trials[0].explained >= DRAWN else None
    if best is None or best.at is None:
        return {"with": [], "residuals": []}
    return {"with": [a.name for a in best.at.additions], "residuals": list(_series(found, best.at.residuals))}


def _series(found: Diagnosis, after: np.ndarray) -> Iterator[ResidualChange]:
    given, rows = found.carrier.given, found.carrier.rows
    for name, e in given.experiments.items():
        for output in given.outputs:
            at = rows.part(name, output)
            with np.errstate(all="ignore"):
                size = -given.scales[output] / rows.weight[at]
                both = found.base.residuals[at] * size, after[at] * size
            before, now = ([float(v) if np.isfinite(v) else None for v in one] for one in both)
            unit = given.model.outputs[output]
            yield ResidualChange(
                recording=name, output=output, unit=unit, t=e.recording.t.tolist(), before=before, after=now,
                timed=given.in_time or has_times(e.recording),
            )  # fmt: skip


__all__ = ["asked_for", "with_diagnosis"]
