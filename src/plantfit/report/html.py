"""One self-contained HTML file: styles, script, plotly and data inside, nothing loaded from elsewhere."""

import os
import re
import tempfile
from base64 import b64encode
from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from plantfit.errors import StoreError
from plantfit.findings import Findings, OperatingTable, Recording, ResidualTest, array, read_findings
from plantfit.problem.problem import GENERALISED
from plantfit.report import figures
from plantfit.report.drawings import Drawings, embedded
from plantfit.report.figures.fit import MOST_ZONES, zone_count
from plantfit.report.figures.parameters import drawable
from plantfit.report.numbers import seconds, significant, with_unit
from plantfit.report.sections import comparison as comparison_section
from plantfit.report.sections import missing, sentences, tables, uncertainty_tables
from plantfit.trust.verdict.estimators.correlated import may_be_noise
from plantfit.trust.verdict.estimators.filtered import moved_by_noise
from plantfit.trust.verdict.estimators.filtered import named as estimator_in_words

_UNUSED_BUTTONS = ["select2d", "lasso2d", "zoomIn2d", "zoomOut2d", "autoScale2d"]
CONFIG = {
    "showSendToCloud": False,
    "displaylogo": False,
    "responsive": True,
    "toImageButtonOptions": {"format": "svg"},
    "modeBarButtonsToRemove": _UNUSED_BUTTONS,
}
POINTS_IN_FILE, MOST_POINTS, FEWEST_POINTS = 45_000, 4000, 300  # samples drawn: in all (0.6 MB), per signal
MOST_INTERVALS = 60  # rows of the figure of intervals
MOST_DIRECTIONS = 6  # along which parameters move together, with a figure each; more are one table


def write_report(findings: Mapping[str, Any], path: str | Path) -> Path:
    """Write the report of the findings of an answer to `path` and return it.

    The file appears whole or not at all. PlantfitError for a record that does not fit the schema;
    StoreError when the folder is missing or cannot be written to.
    """
    return write_page(path, render_html(findings))


def write_page(path: str | Path, text: str) -> Path:
    """Write a report whole or not at all; StoreError as `check_place` raises it, or when the disk is full."""
    path = Path(path)
    check_place(path)
    try:
        _replace(path, text)
    except OSError as error:
        raise StoreError(
            f"The report could not be written to {path} ({error.strerror}); free space or choose another folder."
        ) from None
    return path


def check_place(path: Path) -> None:
    """Raise StoreError where a report could not be written, or would be written over something that is none."""
    try:
        _check_place(path)
    except (OSError, ValueError) as error:  # a name too long, a NUL in it, no right to look
        reason = getattr(error, "strerror", None) or error
        raise StoreError(
            f"The report cannot be written to {str(path)!r:.300} ({reason}); choose another name or folder."
        ) from None


def _check_place(path: Path) -> None:
    with suppress(FileNotFoundError):
        path.lstat()  # raises for what can be no name
    if path.is_dir():
        raise StoreError(
            f"The report cannot be written to {path}: it is a folder; give a file name such as {path / 'report.html'}."
        )
    if not path.parent.is_dir():
        raise StoreError(
            f"The report cannot be written to {path}: the folder {path.parent} does not exist; create it first."
        )
    if not os.access(path.parent, os.W_OK):
        raise StoreError(
            f"The report cannot be written to {path}: you may not "
            f"write to the folder {path.parent}; choose another folder."
        )
    if (path.exists() or path.is_symlink()) and not is_report(path):
        raise StoreError(
            f"The report is not written to {path}, which is not a report "
            "of plantfit; move that file, or choose another name."
        )


def is_report(path: Path) -> bool:
    """Whether a file is a page that plantfit wrote."""
    if not path.is_file() or path.is_symlink():
        return False
    with path.open("rb") as file:
        start = file.read(4096).decode(errors="replace").split("<style>")[0]
    return _MARK in start or re.search(_TITLE_BEFORE_THE_MARK, start) is not None


_MARK = '<meta name="generator" content="plantfit">'  # in templates/frame.html
_TITLE_BEFORE_THE_MARK = r"^<!doctype html>[^\0]*<title>[^<]* \u00b7 plantfit (?:report|case|comparison)</title>"


def render_html(findings: Mapping[str, Any]) -> str:
    """The report as text; PlantfitError for a record that does not fit the schema."""
    return render_page("report.html", _context(read_findings(findings)))


def render_page(template: str, context: Mapping[str, Any]) -> str:
    """A template with everything that its page needs inside."""
    return (
        environment()
        .get_template(template)
        .render(
            context,
            style=Markup(template_text("style.css")),
            plotly=Markup(_plotly()),
            draw=Markup(template_text("draw.js")),
            config=embedded(CONFIG),
        )
    )


def environment() -> jinja2.Environment:
    """What all templates are read with."""
    found = jinja2.Environment(
        loader=jinja2.FunctionLoader(template_text), autoescape=True, undefined=jinja2.StrictUndefined
    )
    found.trim_blocks = found.lstrip_blocks = True
    found.filters["coded"] = coded
    return found


def coded(sentence: str) -> Markup:
    """A sentence for a page, with what stands between backticks in the type of commands."""
    parts = re.split(r"`([^`]+)`", sentence)
    return Markup("").join(Markup("<code>{}</code>").format(part) if k % 2 else part for k, part in enumerate(parts))


def _plotly() -> str:
    """plotly.js with the kinds of figures that pages use, compressed, as base64; draw.js unpacks it."""
    return b64encode(
        resources.files("plantfit.report").joinpath("templates", "plotly-cartesian.min.js.gz").read_bytes()
    ).decode()


def template_text(name: str) -> str:
    """A file of the folder templates."""
    return resources.files("plantfit.report").joinpath("templates", name).read_text(encoding="utf-8")


def _replace(path: Path, text: str) -> None:
    """Write beside the target, then rename: a reader never sees half a file."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=".plantfit-", suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())  # on the disk before it takes the place of an older page
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _context(record: Findings) -> dict[str, Any]:
    """Everything that the template shows."""
    drawings = Drawings()
    named = record.diagnosis is not None and record.diagnosis.named
    noisy = _left_by_noise(record)
    shown = {
        "record": record,
        "title": record.name,
        "subtitle": sentences.subtitle(record),
        "tally": sentences.tally(record),
        "verdict": _verdict(record),
        "fits": _fits(record, drawings),
        "cleaning": _cleaning([r for r in record.recordings if r.outputs and r.t]),
        "scores": tables.scores_table(record.scores),
        "weights": tables.weights_table(record.weights) if record.weights else None,
        "no_validation": sentences.no_validation(record),
        "missing": missing.of_findings(record, drawings),
        "looks": missing.looks(record, drawings),
        "noise": tables.noise_table(record.filtered) if record.filtered else None,
        "ahead": tables.ahead_table(record.filtered.ahead) if record.filtered and record.filtered.ahead else None,
        "tests": [
            _test(test, record, drawings, named, noisy.get((test.recording, test.output), ""))
            for test in record.residual_tests
        ],
        "parameters": _parameters(record, drawings),
        "uncertainty": uncertainty_tables.of_findings(record),
        "combinations": _combinations(record, drawings),
        "directions": tables.combinations_table(record.combinations)
        if len(record.combinations) > MOST_DIRECTIONS
        else None,
        "search": _search(record, drawings),
        "comparison": comparison_section.of_findings(record, drawings),
        "simulation": _simulation(record),
        "reproduction": _reproduction(record),
    }
    return shown | {"figures": drawings.json}


def _verdict(record: Findings) -> list[dict[str, Any]]:
    return [
        {
            "level": v.level,
            "word": sentences.LEVELS[v.level][0],
            "mark": sentences.LEVELS[v.level][1],
            "sentence": v.sentence,
            "figures": [(name.replace("_", " "), significant(value)) for name, value in v.figures.items()],
        }
        for v in record.verdict
    ]


def _fits(record: Findings, drawings: Drawings) -> list[dict[str, Any]]:
    signals = sum(3 * len(r.outputs) + len(r.inputs) for r in record.recordings)
    points = min(MOST_POINTS, max(FEWEST_POINTS, POINTS_IN_FILE // max(signals, 1)))
    shown = [r for r in record.recordings if r.outputs and r.t]
    found = [_fit(recording, drawings, points) for recording in shown]
    for key in ("note", "parts"):  # a caption says what that of the figure above does not say yet
        told = [fit[key] for fit in found]
        for fit, before in zip(found[1:], told[:-1], strict=True):
            if fit[key] == before:
                fit[key] = type(before)()
    if found:
        found[0]["note"] = " ".join(
            filter(None, (sentences.decimated([len(r.t) for r in shown], points), found[0]["note"]))
        )
    return found


def _cleaning(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """(number, line) of each recording's way to its signals; beside one of as many lines, only those that differ
    from the first's."""
    found = []
    for recording in recordings:
        first = recordings[0]
        lines, alike = (
            list(enumerate(recording.log, start=1)),
            len(recordings) > 1 and len(recording.log) == len(first.log),
        )
        other = recording is not first and alike and bool(set(recording.log) & set(first.log))
        if other:
            lines = [(k, line) for (k, line), before in zip(lines, first.log, strict=True) if line != before]
        found.append({"name": recording.name, "lines": lines, "as": first.name if other else ""})
    return found


def _fit(recording: Recording, drawings: Drawings, points: int) -> dict[str, Any]:
    parts, note = {part for output in recording.outputs.values() for part in output.part}, ""
    if any(zone_count(output) > MOST_ZONES for output in recording.outputs.values()):
        parts, note = set(), "Fit and validation samples alternate too finely to be shaded."
    outputs = sentences.listed(with_unit(name, output.unit) for name, output in recording.outputs.items())
    label = f"Recording {recording.name}: {outputs} measured and simulated over time, residuals below, then the inputs."
    figure = drawings.add(figures.fit_figure(recording, points), label)
    return {
        "recording": recording,
        "figure": figure,
        "parts": [p for p in ("fit", "validation") if p in parts],
        "note": note,
    }


def _left_by_noise(record: Findings) -> dict[tuple[str, str], str]:
    """Recordings and outputs whose residuals noise has left, as the verdict says: that is correlated, or that moves
    the plant."""
    if record.correlated is None and record.filtered is None:
        return {}
    findings = record.plain()
    found = dict.fromkeys(moved_by_noise(findings), "moves")
    for n in record.correlated.noise if record.correlated else ():
        if may_be_noise(findings, n.output):
            found |= {(t.recording, t.output): "correlated" for t in record.residual_tests if t.output == n.output}
    return found


def _test(test: ResidualTest, record: Findings, drawings: Drawings, named: bool, noise: str) -> dict[str, Any]:
    where = f"residual of {test.output} in {test.recording}"
    lags, bound = array(test.lags_s), test.bound
    later = lags > 0  # lag 0 is always 1
    timed = all(r.timed for r in record.recordings if r.name == test.recording)
    over = "seconds" if timed else "rows"
    auto = figures.stem_figure(lags[later], array(test.autocorrelation)[later], bound, "autocorrelation", timed)
    items = [drawings.add(auto, f"Autocorrelation of the {where} over lag in {over}, with 95 % bounds.")]
    for name, cross in test.cross.items():
        figure = figures.stem_figure(
            array(cross.lags_s), array(cross.values), cross.bound, f"cross-correlation with {name}", timed
        )
        items.append(
            drawings.add(figure, f"Cross-correlation of the {where} with {name} over lag in {over}, with 95 % bounds.")
        )
    named = named or test.stretch is not None or test.turned is not None or noise == "moves"
    said = [
        sentences.whiteness(test, noise),
        *(sentences.independence(name, cross, named) for name, cross in test.cross.items()),
    ]
    if test.first:
        units = [
            r.outputs[test.output].unit
            for r in record.recordings
            if r.name == test.recording and test.output in r.outputs
        ]
        said.append(sentences.begins(test.first, next(iter(units), None)))
    good = (
        test.white
        and test.curved is None
        and test.sizes is None
        and all(cross.independent for cross in test.cross.values())
    )
    return {"title": f"{test.recording}: {test.output}", "sentences": said, "figures": items, "good": good}


def _parameters(record: Findings, drawings: Drawings) -> dict[str, Any]:
    figure, single = None, [p for p in record.parameters if not p.index]
    shown = drawable(single)[:MOST_INTERVALS]
    if shown:
        label = "Value, 95 % interval and the values of all runs of each parameter, between its lower and upper bound."
        figure = drawings.add(figures.interval_figure(shown, record.runs), label)
    return {
        "table": tables.parameters_table(single) if single else None,
        "figure": figure,
        "left": len(drawable(single)) - len(shown),
        "curves": [_curve(group, drawings) for group in _groups(record.tables)],
        "entries": tables.entries_tables(record.parameters),
    }


def _groups(found: list[OperatingTable]) -> list[list[OperatingTable]]:
    """What is drawn together: a table over one signal in all recordings, one over two signals alone."""
    groups: dict[tuple[str, str], list[OperatingTable]] = {}
    for table in found:
        groups.setdefault((table.name, "" if len(table.nodes) == 1 else str(table.recording)), []).append(table)
    return list(groups.values())


def _curve(group: list[OperatingTable], drawings: Drawings) -> dict[str, Any]:
    first = group[0]
    where = f" of {first.recording}" if first.recording and len(first.nodes) > 1 else ""
    label = f"Table {first.name}{where} over {sentences.listed(first.over)}: value and 95 % interval at every node."
    figure = drawings.add(figures.table_figure(group), label)
    return {
        "title": f"{first.name}{where} over {sentences.listed(first.over)}",
        "figure": figure,
        "many": len(group) > 1,
    }


def _combinations(record: Findings, drawings: Drawings) -> list[dict[str, Any]]:
    if len(record.combinations) > MOST_DIRECTIONS:
        return []
    return [
        {
            "sentence": c.sentence,
            "spread": "" if c.relative_sd is None else f"Relative standard deviation {significant(c.relative_sd, 2)}.",
            "figure": drawings.add(figures.weight_figure(c), f"Weights of the parameters in combination {k}.")
            if c.weights
            else None,
        }
        for k, c in enumerate(record.combinations, start=1)
    ]


def _search(record: Findings, drawings: Drawings) -> dict[str, Any]:
    convergence = waterfall = None
    if any(r.history.cost for r in record.runs):
        convergence = drawings.add(
            figures.convergence_figure(record.runs), "Best cost so far against evaluations for every run."
        )
    if len([r for r in record.runs if r.cost is not None]) > 1:
        waterfall = drawings.add(
            figures.waterfall_figure(record.runs), "Final cost of every run, sorted from the lowest."
        )
    return {
        "convergence": convergence,
        "waterfall": waterfall,
        "runs": tables.runs_table(record.runs),
        "basins": tables.basins_table(record.basins),
        "estimator": _other_estimator(record),
    }


def _other_estimator(record: Findings) -> str:
    """The estimator that the values are of, where it is not least squares."""
    if record.filtered is not None:
        return estimator_in_words(record.filtered.estimator)
    return GENERALISED if record.correlated is not None and record.correlated.least_squares is not None else ""


def _simulation(record: Findings) -> dict[str, Any] | None:
    if record.simulation is None:
        return None
    simulation = record.simulation
    return {
        "stepper": simulation.stepper,
        "substeps": tables.substeps(simulation.substeps),
        "table": tables.simulation_table(simulation),
    }


def _reproduction(record: Findings) -> dict[str, Any] | None:
    made = record.reproduction
    if made is None:
        return None
    facts = [
        ("command", made.command),
        ("seed", "" if made.seed is None else str(made.seed)),
        ("processor", made.cpu),
        ("time", ", ".join(f"{phase} {seconds(value)}" for phase, value in made.seconds.items())),
        ("versions", ", ".join(f"{name} {version}" for name, version in made.versions.items())),
    ]
    return {"facts": [(name, value) for name, value in facts if value], "spec": made.spec}
