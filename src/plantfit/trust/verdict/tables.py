"""What the verdict says about tables: how many entries the data determine, and where no sample falls."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from plantfit.trust.intervals.parameter_rows import NOT_VISITED
from plantfit.trust.verdict.words import FEW, Sentence, number, say, some, span

Row = Mapping[str, Any]
_OPEN = {"weak": "only roughly known", "flat": "not determined", "at bound": "on a bound", NOT_VISITED: "never visited"}
LISTED = 5  # gaps in one sentence


def table_sentences(entries: Sequence[Row], tables: Sequence[Row]) -> Iterator[Sentence]:
    """One sentence for each table over `entries` of all recordings, then those on gaps; `tables` as in the findings
    record."""
    for name in dict.fromkeys(p["parameter"] for p in entries):
        yield _table([p for p in entries if p["parameter"] == name], tables)
    yield from _gaps(tables)


def smoothing_sentences(rows: Sequence[Row]) -> Iterator[Sentence]:
    """How strongly tables are smoothed and what that leaves of their entries; `rows` as in the findings record."""
    for way, said in _CHOSEN.items():
        own = [row for row in rows if row["chosen"] == way]
        if own:
            bends = [100 * b for row in own for b in row["bends"] if b is not None]
            size = (
                f" for bends of about {span([float(number(b)) for b in bends], '%')} of the box from node to node"
                if bends
                else ""
            )
            entries, effective = sum(row["entries"] for row in own), sum(row["effective"] for row in own)
            text = (
                f"{some([row['name'] for row in own])}: smoothed{size}, a strength {said}; the data then fix "
                f"{number(effective)} of "
            )
            yield say(
                "info", f"{text}{entries} entries, and smoothness the rest.", effective=effective, entries=entries
            )


_CHOSEN = {
    "given": "given by the study",
    "cross-validated": "chosen by cross-validation on left-out pieces of the recordings",
    "reml": "estimated by restricted maximum likelihood",
}


def _table(rows: Sequence[Row], tables: Sequence[Row]) -> Sentence:
    """One sentence on all entries of a table, of all recordings."""
    name, total = rows[0]["parameter"], len(rows)
    count = {s: sum(p["status"] == s for p in rows) for s in ("determined", *_OPEN)}
    good = count["determined"]
    if good == total:
        return say("good", f"All {total} entries of table {name} are determined by the data.", determined=good)
    left = [
        f"{count[s]} {'is' if count[s] == 1 else 'are'} {word} ({_entries(rows, s)})"
        for s, word in _OPEN.items()
        if count[s]
    ]
    text = (
        f"{good} of {total} entries of table {name} are determined by the data; "
        f"{', '.join(left)}.{_nowhere(name, tables)}"
    )
    beside = any(t["name"] == name and t["over"] == ["t"] for t in tables)  # a drift: nobody asks for its values
    return say("info" if beside else "bad" if 2 * good < total else "warning", text, determined=good, open=total - good)


def _entries(rows: Sequence[Row], status: str) -> str:
    """The entries of this status by name, those of several recordings by number."""
    own = [p for p in rows if p["status"] == status]
    recordings = list(dict.fromkeys(p["recording"] for p in own))
    if recordings == [None]:
        return some([p["name"] for p in own])
    if len(recordings) == 1:
        return f"in {recordings[0]}"
    return some([f"{sum(p['recording'] == r for p in own)} in {r}" for r in recordings])


def _nowhere(name: str, tables: Sequence[Row]) -> str:
    """At which operating points recordings come by but none determines the entry; nothing where these are the whole
    range."""
    own = [t for t in tables if t["name"] == name]
    if not own:
        return ""
    first, parts = own[0], []
    states = np.array([t["status"] for t in own])
    nowhere = np.all((states == "flat") | (states == NOT_VISITED), axis=0) & np.any(states == "flat", axis=0)
    at = np.nonzero(nowhere.reshape([len(nodes) for nodes in first["nodes"]]))
    for signal, unit, nodes, places in zip(first["over"], first["over_units"], first["nodes"], at, strict=True):
        points = [nodes[k] for k in places]
        if points and (min(points), max(points)) != (nodes[0], nodes[-1]):
            parts.append(f"{signal} of {span(points, unit)}")
    who = "No recording tells enough" if len(own) > 1 else "The data tell too little"
    return f" {who} at {' and '.join(parts)}." if parts else ""


def _gaps(tables: Sequence[Row]) -> Iterator[Sentence]:
    """Where no sample falls; tables and recordings with the same gaps together, many gaps in one sentence."""
    same: dict[tuple[str, ...], dict[str, list[str]]] = {}
    for row in tables:
        unseen = np.array([s == NOT_VISITED for s in row["status"]])
        if np.any(unseen):
            places, others = _places(row, unseen)
            more = (f"{others} {'more ' if places else ''}{'entry' if others == 1 else 'entries'}",) if others else ()
            same.setdefault((*places, *more), {}).setdefault(row["recording"] or "", []).append(row["name"])
    end = "their values are not measured, they are what the start or a prior left there"
    count = sum(row["status"].count(NOT_VISITED) for row in tables)
    said = [(f"{_owners(by)}: {' and '.join(place)}") for place, by in same.items()]
    if len(said) <= FEW:
        yield from (say("warning", f"{text} never visited: {end}.", unvisited=count) for text in said)
        return
    shown = "; ".join(said[:LISTED]) + (f"; and {len(said) - LISTED} more such gaps" if len(said) > LISTED else "")
    yield say("warning", f"{count} entries of tables are never visited: {end}. {shown}.", unvisited=count)


def _owners(by: Mapping[str, Sequence[str]]) -> str:
    """`k, A1 and A2 of opening10`."""
    names = list(dict.fromkeys(n for own in by.values() for n in own))
    recordings = [r for r in by if r]
    return some(names) + (f" of {some(recordings)}" if recordings else "")


def _places(table: Row, marked: np.ndarray) -> tuple[list[str], int]:
    """Nodes of each signal with all their entries marked, as `x1 of 4.44 to 20 bar`, and how many marked entries are
    elsewhere."""
    grid = marked.reshape([len(nodes) for nodes in table["nodes"]])
    covered, parts = np.zeros(grid.shape, dtype=bool), []
    for axis, (signal, unit, nodes) in enumerate(zip(table["over"], table["over_units"], table["nodes"], strict=True)):
        whole = np.all(grid, axis=tuple(k for k in range(grid.ndim) if k != axis))
        covered |= np.expand_dims(whole, [k for k in range(grid.ndim) if k != axis])
        runs = [[nodes[k] for k, _ in run] for all_, run in groupby(enumerate(whole), key=lambda pair: pair[1]) if all_]
        if runs:
            parts.append(f"{signal} of {' and '.join(span(r, unit) for r in runs)}")
    return parts, int(np.sum(grid & ~covered))
