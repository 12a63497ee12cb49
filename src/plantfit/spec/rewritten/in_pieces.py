"""A study file whose recordings are cut into pieces with starts of their own, for plants that forget their start."""

from typing import Any

import numpy as np
import tomlkit

import plantfit.runtime  # noqa: F401
from plantfit.errors import PlantfitError, SpecError
from plantfit.models.extensions import parameter_name
from plantfit.models.model import Model
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.shooting.piece_starts import half_waves, piece_starts
from plantfit.spec.error_place import errors_at
from plantfit.spec.reading import parse
from plantfit.spec.rewritten.document import text_of
from plantfit.spec.study import Study

SEGMENTS = 5  # of each piece at least, joined to find a start
OF_WHOLE_RECORDS = ("methods", "settings", "runs")  # keys of [search] that the search in pieces does not take over


def in_pieces(study: Study, seconds: float) -> str:
    """The text of the study file with `pieces` of so many seconds, a `start` of each state in each of them, and
    `shooting`.

    Recordings that are no longer than a piece stay whole. Of those that are cut the unseen part is left out: a
    simulation of it in one go would forget its start, too. Bounds of the starts are those in which the states were
    found by loosely joined segments of the records. Raises SpecError for models that have no such starts and where the
    new file could not be read, SearchError and SimulationError where no segments can be simulated.
    """
    path, model, experiments = study.path, study.problem.model, study.problem.experiments
    if not isinstance(model, Model) or not model.states:
        raise SpecError(
            f"{path.name}: its model has no states that could begin anew; --pieces is for models that are simulated."
        )
    if not (np.isfinite(seconds) and seconds > 0):
        raise SpecError(f"--pieces {seconds:g} cannot be used; give seconds above 0.")
    document = tomlkit.parse(study.text.removeprefix("\ufeff"))
    tables: Any = document["recording"]
    begun = (document["model"].get("extensions") or {}).get("start")
    whole = [n for n, r in tables.items() if "pieces" not in r and n in experiments]
    if begun or len(whole) < len(tables):
        raise SpecError(f"{path.name} is in pieces or has starts already; change `pieces` or `start` there.")
    long = [n for n in whole if not experiments[n].steady and np.ptp(experiments[n].recording.t) > seconds]
    if not long:
        longest = max(float(np.ptp(e.recording.t)) for e in experiments.values())
        raise SpecError(
            f"{path.name}: no recording lasts longer than {seconds:g} "
            f"s, the longest {longest:.4g} s; give a shorter time."
        )
    for name in long:
        tables[name]["pieces"] = int(seconds) if seconds == int(seconds) else seconds
        if experiments[name].fit is not None and experiments[name].validate is not None:
            _only_fitted(tables[name], experiments[name])
    cut = _read(document, study, seconds).problem.experiments
    shortest = min(len(e.recording) for e in cut.values())
    waves = max(half_waves(e.recording[o]) for e in cut.values() for o in study.problem.outputs)
    segments = max(1, min(max(SEGMENTS, waves), shortest // 2))
    with errors_at(path.name):
        starts = piece_starts(study.problem, seconds / segments)
    own: Any = document["model"].setdefault("extensions", tomlkit.table())
    own["start"] = tomlkit.inline_table()
    parameters: Any = document.setdefault("parameters", tomlkit.table())
    for state, (low, high) in starts.items():
        own["start"][state] = [low, high]
        parameters[parameter_name("start", state)] = {"per_recording": True}
    search: Any = document.setdefault("search", tomlkit.table())
    for key in OF_WHOLE_RECORDS:
        search.pop(key, None)
    search["shooting"] = segments
    document["name"] = f"{study.name} in pieces"
    return _read(document, study, seconds).text


def _only_fitted(table: Any, experiment: Experiment) -> None:
    assert experiment.fit is not None
    begin, end = experiment.fit
    t = experiment.recording.t
    t = t[(t >= begin) & (t < end)]
    for key in ("split", "validate"):
        table.pop(key, None)
    table["fit"] = [float(f"{at:.9g}") for at in (t[0], t[-1])]
    table["fit"].comment("of the unseen part no simulation in one go tells anything")


def _read(document: tomlkit.TOMLDocument, study: Study, seconds: float) -> Study:
    try:
        return parse(text_of(document), study.path)
    except PlantfitError as error:
        raise SpecError(f"{study.path.name} cannot be cut into pieces of {seconds:g} s: {error}") from None
