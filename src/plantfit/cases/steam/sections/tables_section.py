"""Section of the steam chamber's page: what its tables mean, and which model of them the records support."""

from collections.abc import Mapping
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.cases.steam.sections.dynamic_figures import surfaces_figure
from plantfit.cases.steam.sections.tables_figures import visits_figure
from plantfit.cases.steam.table_models import Answer, answers, compared, opening_of
from plantfit.models.parts.tables import Table
from plantfit.recording.record import Recording, Signal
from plantfit.rig.steam_chamber import NODES, TABLES
from plantfit.trust.finish.smoothing_strength import smoothing_rows
from plantfit.trust.identify.table_visits import table_visits, unvisited
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.intervals.parameter_rows import parameter_rows, table_rows
from plantfit.trust.verdict.tables import smoothing_sentences, table_sentences
from plantfit.trust.verdict.words import number

OWN, SMOOTHED = "tables of each opening", "tables of each opening, smoothed"
TRUTH = "truth of the rig"
SURFACE = "surface over pressure and opening, smoothed"
SHORT = {OWN: "each opening", SMOOTHED: "smoothed", SURFACE: "one surface", TRUTH: TRUTH}


def tables_section(
    recordings: Mapping[str, Recording], truth: Mapping[str, np.ndarray] | None = None, every: int = 10
) -> dict[str, Any]:
    """Visits and what is known of each entry, smoothed tables and a shared surface beside them, models compared.

    `truth` has k, A1, A2 (opening, node) where they are known; `every` so many samples one is used, since seven models
    are fitted and ten openings left out in turn.
    """
    thin = {n: _thinned(r, every) for n, r in recordings.items()}
    found = answers(thin)
    comparison, blind = compared(found)
    problem, z = found[OWN]
    local = linearise(problem, z)
    visits = table_visits(problem, local.values)
    rows = parameter_rows(problem.space, local, unvisited(visits))
    tables = [t.plain() for t in table_rows(problem, rows, visits)]
    smoothed = smoothing_rows(found[SMOOTHED][0], linearise(*found[SMOOTHED]))
    samples = np.array([v.samples for v in visits if v.table.name == "k"])
    statuses = {n: [t["status"] for t in tables if t["name"] == n] for n in TABLES}
    shown = {n: _grids(*found[n]) for n in (OWN, SMOOTHED, SURFACE)} | ({} if truth is None else {TRUTH: dict(truth)})
    settled = np.array([float(np.nanmax(r["y"])) for r in thin.values()])
    openings = [opening_of(n) for n in thin]
    return {
        "title": "What the tables mean",
        "sentences": [
            f"Every {every}. sample: {comparison.samples} of them. On the way up a record passes each "
            "pressure once, and there the model asks for one sum, k u - A1 y' - A2 y'' = y: one number "
            "for three tables. What the records determine is how fast the pressure moves, (k u - y)/A1, "
            "and k where it comes to rest; the three apart rest on the straight lines between nodes.",
            *(s["sentence"] for s in table_sentences([r for r in rows if r["index"]], tables)),
            *(s["sentence"] for s in smoothing_sentences([t.plain() for t in smoothed])),
            *comparison.sentences,
            *([] if truth is None else [_apart(shown, truth, samples, openings)]),
        ],
        "tables": [
            comparison.table("bar"),
            *_left_out(blind),
            *([] if truth is None else [_errors(shown, truth, samples, openings)]),
        ],
        "figures": [
            {
                "figure": visits_figure(samples, statuses, openings),
                "label": "Samples near every node, and what is known of its entries",
            },
            {
                "figure": surfaces_figure({SHORT[n]: tables for n, tables in shown.items()}, settled),
                "label": "Tables alone, smoothed and as one surface; below the dots is measured",
            },
        ],
    }


def _thinned(r: Recording, every: int) -> Recording:
    signals = {n: Signal(s.values[::every], s.unit) for n, s in r.signals.items()}
    return Recording(r.t[::every], signals, r.name, (*r.log, f"every {every}. sample"))


def _grids(problem: Any, z: np.ndarray) -> dict[str, np.ndarray]:
    """k, A1, A2 (opening, node) of an answer whose tables are over the pressure, or over the pressure and the
    opening."""
    values, made = np.asarray(problem.space.physical(z)), {}
    axes = {t.name: t for t in problem.model.tables}
    for name in TABLES:
        tree = {n: np.asarray(problem.space.tree(values, n)[name]) for n in problem.data["drive"]}
        made[name] = np.array([_over_pressure(axes[name], v, opening_of(n)) for n, v in tree.items()])
    return made


def _over_pressure(table: Table, values: np.ndarray, opening: float) -> np.ndarray:
    at = (NODES,) if len(table.over) == 1 else (NODES, np.full(len(NODES), opening))
    return np.asarray(table(values, *at))


def _errors(
    shown: Mapping[str, Any], truth: Mapping[str, np.ndarray], samples: np.ndarray, openings: list[float]
) -> dict[str, Any]:
    """Median errors against the truth where the pressure went, of the tables and of the rate that they make
    together."""
    off = _off(shown, truth, samples, openings)
    rows = [[name, *(f"{v:.1f}" for v in values)] for name, values in off.items()]
    columns = ["Model", *(f"{n} (%)" for n in TABLES), "(k u - y)/A1 (%)"]
    note = (
        f"Median over {int(np.sum(samples > 0))} visited nodes; the "
        "last column without those at rest, where the rate is 0."
    )
    return {
        "caption": "Error of the tables against the rig's truth, visited nodes",
        "columns": columns,
        "rows": rows,
        "note": note,
    }


def _off(
    shown: Mapping[str, Any], truth: Mapping[str, np.ndarray], samples: np.ndarray, openings: list[float]
) -> dict[str, tuple[float, ...]]:
    """By model the median errors (%) of k, A1, A2 and (k u - y)/A1."""
    u, found = np.array(openings)[:, None], {}
    inside = (samples > 0) & (NODES[None, :] * 1.1 < truth["k"] * u)

    def rate(t: Mapping[str, np.ndarray]) -> np.ndarray:
        return (t["k"] * u - NODES[None, :]) / t["A1"]

    for name, tables in shown.items():
        if name != TRUTH:
            apart = (np.abs(tables[n] / truth[n] - 1.0)[samples > 0] for n in TABLES)
            errors = (*apart, np.abs(rate(tables) / rate(truth) - 1.0)[inside])
            found[name] = tuple(100.0 * float(np.median(e)) for e in errors)
    return found


def _apart(
    shown: Mapping[str, Any], truth: Mapping[str, np.ndarray], samples: np.ndarray, openings: list[float]
) -> str:
    """How far the tables and what they make together are off in the model that predicts best."""
    k, a1, _, rate = _off(shown, truth, samples, openings)[SURFACE]
    return (
        f"Against the rig's truth the smoothed surface has (k u - y)/A1 right to {number(rate)} % in the median, "
        f"k to {number(k)} % and A1 to {number(a1)} %: smoothing makes the prediction better and the three tables "
        "apart no truer. Records in which the opening changes while the pressure is high would tell k from A1."
    )


def _left_out(blind: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    if not blind:
        return []
    names = list(next(iter(blind.values())))
    rows = [[model, *(number(errors[n]) for n in names)] for model, errors in blind.items()]
    columns = ["Model", *(f"{opening_of(n):g} %" for n in names)]
    return [{"caption": "RMS error (bar) on each opening, fitted to the others", "columns": columns, "rows": rows,
             "note": "Dead times of the opening left out lie on the line through its neighbours'."}]  # fmt: skip


__all__ = ["Answer", "tables_section"]
