"""`plantfit diagnose`: what is missing in a model, by evidence, and the study file with it."""

import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from plantfit.cli.arguments.file_names import file_name
from plantfit.cli.arguments.written_beside import shown, write, written_beside
from plantfit.cli.commands.begin.check import say_looks
from plantfit.cli.terminal.interrupts import stoppable
from plantfit.cli.terminal.out import out, print_json, progress_line, said_line, verdict
from plantfit.errors import SpecError

if TYPE_CHECKING:
    from plantfit.problem.problem import Problem
    from plantfit.spec.study import Study
    from plantfit.trust.diagnosis import Change, Diagnosis
    from plantfit.trust.verdict.words import Sentence

SHOWN = 12  # rows of the table of what was tried
WORSE = 1.05  # times the RMSE of unseen data without what was found, from which on it does not hold there


def diagnose(path: str, place: str | None, only: Sequence[str], force: bool, json: bool) -> None:
    """Fit, diagnose, say it, write the changed study file and fit that one from there."""
    from plantfit import spec

    study = spec.load(path)
    from plantfit.first_look import linear_beside
    from plantfit.recording.clean.outliers import inline
    from plantfit.trust.diagnosis import diagnosis_record, with_linear
    from plantfit.trust.looks import not_followed, problem_looks

    found, wrong = _tried(study, only, json)
    given = found.carrier.given
    looks = [look.record for look in not_followed(problem_looks(given), given, found.carrier.z)]
    record = diagnosis_record(with_linear(found, linear_beside))
    record |= {"verdict": [*wrong, *record["verdict"]], "data": looks}
    if json:
        return print_json({**record, **_written(study, found, place, force, only)})
    say_looks(looks)
    verdict(record)
    _table(record)
    written = _written(study, found, place, force, only)  # where that fails, what was found has been said
    if not written:
        return
    out.print("\nWhat to write into the study file:\n", markup=False)
    for line in written["write"]:
        out.print(f"    {line}", markup=False)
    for name, steps in written["clean"].items():
        out.print(f"    [recording.{name}]\n    clean = [{', '.join(map(inline, steps))}]", markup=False)
    unseen, without = written["unseen_rmse"], written["unseen_rmse_without"]
    told = "" if unseen is None else f", {unseen:.4g} on unseen data"
    values = "".join(f"{', ' if k else '; '}{n} = {v:.4g}" for k, (n, v) in enumerate(written["values"].items()))
    out.print(f"\nFitted with that: RMSE {written['rmse']:.4g}{told}{values}", markup=False)
    worse = unseen is not None and without is not None and unseen > WORSE * without
    if worse:
        text = f"Without it the unseen data are followed to {without:.4g}: it does not hold there, and may stand for"
        out.print(f"[yellow]![/yellow] {text} something else.")
    out.print(f"Written: {written['file']}", markup=False)
    if not worse:
        out.print(f"Next: plantfit run {shlex.quote(written['file'])}", markup=False)


def added(path: str, names: Sequence[str], json: bool) -> str:
    """The study file with these additions, named from here, written beside `path` as `plantfit diagnose --try` does;
    one that is there is kept if it says the same. Raises ModelError for a name that is none, before anything is
    fitted, and SpecError for another file there."""
    from plantfit import spec
    from plantfit.trust.diagnosis import asked_changes, clean_steps

    study = spec.load(path)
    found, _ = _tried(study, names, json)
    if not all(r.trials for r in found.rounds):
        raise SpecError(f"{study.path.name} cannot be simulated with {' and '.join(names)}; try something else.")
    changes, clean = asked_changes(found), clean_steps(found)
    return written_beside(_target(study, changes, bool(clean)), _text(study, changes, clean))


def _tried(study: "Study", only: Sequence[str], json: bool) -> "tuple[Diagnosis, list[Sentence]]":
    """Fit a study and try additions: those asked for, which are looked up before the fit, else all, and then also what
    the record may be told wrongly, which comes as sentences."""
    from plantfit.fitting import fit
    from plantfit.spec import before_filter
    from plantfit.trust.diagnosis import Meter, misrecorded
    from plantfit.trust.diagnosis.diagnose import additions, chosen, demand_treatable
    from plantfit.trust.diagnosis.diagnose import diagnose as tried

    search, regression = study.plan, before_filter(study)
    demand_treatable(study.problem)
    if only:
        chosen(study.problem, additions(study.problem, regression), only)
    with progress_line(json) as tell:
        answer = fit(
            study.problem, search.methods[0], runs=search.runs, budget=search.budget, seed=search.seed,
            settings=search.settings.get(search.methods[0]), shooting=study.table.search.shooting, progress=tell,
        )  # fmt: skip
    with (
        said_line(json) as say,
        stoppable("Stopping; what was tried until now is told. Ctrl-C again stops at once.") as stop,
    ):
        wrong = [] if only else misrecorded(answer.problem, answer.best.x, say, stop)
        meter = Meter(stop=stop, winds_up=True)
        found = tried(
            answer.problem, answer.best.x, progress=say, only=only or None, regression=regression, meter=meter
        )
        return found, wrong


def _written(study: "Study", found: "Diagnosis", place: str | None, force: bool, only: Sequence[str]) -> dict[str, Any]:
    """Write the study file with what was found, or with what was asked for; what was written and how it fits."""
    from plantfit.spec import parse
    from plantfit.trust.diagnosis import asked_changes, changed, clean_steps
    from plantfit.trust.diagnosis.treatment import addition_lines

    changes, clean = asked_changes(found) if only else changed(found), clean_steps(found)
    if not changes and not clean:
        return {}
    target = Path(place) if place else _target(study, changes, bool(clean))
    if target.exists() and not force:
        raise SpecError(f"{str(target)!r} exists already; give another name with --out, or --force to overwrite it.")
    text = _text(study, changes, clean)
    write(target, text, "give another place with --out")
    return {
        "write": addition_lines(changes),
        "file": shown(target),
        "clean": dict(clean),
        **_fitted(parse(text, study.path), found),
    }


def _text(study: "Study", changes: "Sequence[Change]", clean: Mapping[str, Any]) -> str:
    """The changed study file; its name says what was added, so that its report and its study do not take the place
    of the first."""
    from plantfit.spec import with_additions

    return with_additions(
        study.text, study.path, changes, clean, f"{study.name} with {' and '.join(_parts(changes, bool(clean)))}"
    )


def _target(study: "Study", changes: "Sequence[Change]", clean: bool) -> Path:
    parts = "-and-".join(re.sub(r"\W+", "-", part) for part in _parts(changes, clean))
    return study.path.with_name(f"{Path(file_name(study.name, 'toml')).stem}-with-{parts}.toml")


def _parts(changes: "Sequence[Change]", clean: bool) -> list[str]:
    return [c.name for c in changes] + (["outliers dropped"] if clean else [])


def _fitted(study: "Study", found: "Diagnosis") -> dict[str, Any]:
    """The changed study fitted from what the diagnosis found: RMSE of its fitted and unseen samples and the new
    parameters."""
    import numpy as np

    from plantfit.problem.accuracy.steps import choose_substeps
    from plantfit.trust.finish.refit import refit
    from plantfit.trust.finish.smoothing_strength import choose_strengths

    # of several outputs those that the fit estimated, or figures could not be compared
    scales = found.carrier.given.scales
    problem, known = choose_substeps(study.problem).with_scales(scales), found.answer_values()
    values = np.array([known.get(n, c) for n, c in zip(problem.space.names, _middle(problem), strict=True)])
    start = np.clip(np.asarray(problem.space.cube(values)), 0.0, 1.0)
    z, _ = refit(problem, start, np.ones(len(start), dtype=bool))
    if problem.smoothing is not None:
        chosen = choose_strengths(problem, z)
        problem, z = chosen.problem, chosen.z
    at = np.asarray(problem.space.physical(z))
    rmse, given = _rmse(problem, at), found.carrier.given
    without = _rmse(given, np.asarray(given.space.physical(np.asarray(found.carrier.z))))
    old = set(found.carrier.given.space.names)
    own = zip(problem.space.coordinates, at, strict=True)
    new = {c.name: float(v) for c, v in own if c.name not in old and not c.index}  # of a curve in time there are many
    return {
        "rmse": rmse["fit"],
        "unseen_rmse": rmse["validation"],
        "unseen_rmse_without": without["validation"],
        "values": new,
    }


def _rmse(problem: "Problem", values: Any) -> dict[str, float | None]:
    """RMSE of fitted and unseen samples of all outputs at physical values (d,), of several in their scales; None where
    there are none."""
    import numpy as np

    squares: dict[str, list[np.ndarray]] = {"fit": [], "validation": []}
    one = len(problem.outputs) == 1
    for name, e in problem.experiments.items():
        predicted = problem.predict(values, name)
        for o in problem.outputs:
            error = (predicted[o] - e.recording[o]) / (1.0 if one else problem.scales[o])
            for part, own in squares.items():
                own.append(error[e.mask(part) & np.isfinite(error)] ** 2)
    return {
        part: float(np.sqrt(np.mean(np.concatenate(own)))) if sum(map(len, own)) else None
        for part, own in squares.items()
    }


def _middle(problem: Any) -> Any:
    """Starts of the parameters where given, else the middle of their bounds (d,)."""
    import numpy as np

    middle = np.array(problem.space.physical(np.full(problem.space.dimension, 0.5)))
    for i, c in enumerate(problem.space.coordinates):
        start = problem.space.parameters[c.parameter].start
        if start is not None and np.ndim(start) == 0:
            middle[i] = float(start)
    return middle


def _table(record: Mapping[str, Any]) -> None:
    """What was tried in the first round, the best first; a star marks what was found."""
    from plantfit.report.text import columns
    from plantfit.trust.diagnosis.sentences import plain_unit

    if not record["rounds"]:  # a curve in time alone was asked for
        return
    first, rows = record["rounds"][0], []
    for row in first["tried"][:SHOWN]:
        unseen = "" if row["unseen_rmse"] is None else f"{row['unseen_rmse']:.4g} to {row['unseen_rmse_with']:.4g}"
        mark = " *" if row["name"] in first["found"] else ""
        value = "" if row["value"] is None else f"{row['value']:.3g} {plain_unit(row['unit'])}"
        rows.append((row["name"] + mark, f"{100 * row['explained']:.1f} %", f"{row['rmse_with']:.4g}", unseen, value))
    out.print("\n" + columns(("tried", "explains", "RMSE with it", "unseen", "value"), rows), markup=False)
    more = len(first["tried"]) - SHOWN
    if more > 0:
        out.print(f"and {more} more that explain less", markup=False)


__all__ = ["added", "diagnose"]
