"""What the verdict says about parameters: one sentence each for a few, one for all entries of a table."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from plantfit.trust.verdict_tables import smoothing_sentences, table_sentences
from plantfit.trust.words import FEW, Sentence, estimate, number, say, some, span, with_unit

Row = Mapping[str, Any]
LISTED = 8  # estimates in one sentence


def parameter_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """Which parameters the data determine, and which not."""
    free = [p for p in findings["parameters"] if p["status"] != "fixed"]
    single, entries = [p for p in free if not p.get("index")], [p for p in free if p.get("index")]
    yield from _determined(single, free)
    yield from table_sentences(entries, findings.get("tables", ()))
    yield from smoothing_sentences(findings.get("smoothing", ()))
    for status, one, many in (("weak", _weak, _weaks), ("flat", _flat, _flats), ("at bound", _bound, _bounds)):
        rows = [p for p in single if p["status"] == status]
        for name in dict.fromkeys(p.get("parameter", p["name"]) for p in rows):
            own = [p for p in rows if p.get("parameter", p["name"]) == name]
            yield from (one(p) for p in own) if len(own) <= FEW else (many(name, own),)


def _determined(single: Sequence[Row], free: Sequence[Row]) -> Iterator[Sentence]:
    good, total = [p for p in free if p["status"] == "determined"], len(free)
    if not good:
        return
    named = [p for p in single if p["status"] == "determined"]
    listed = ", ".join(_told(p) for p in named[:LISTED]) + (f" and {len(named) - LISTED} more" if len(named) > LISTED else "")
    what = ", ± with the stated errors" if any(p.get("uncertainty") for p in named) else ""
    text = f"The data determine {len(good)} of {total} parameters" + (f"{what}: {listed}." if listed else ".")
    yield say("good" if len(good) == total else "info", text, determined=len(good))


def _told(p: Row) -> str:
    """A value with its standard error, or with all its uncertainty where errors were stated."""
    return estimate({**p, "standard_error": p["uncertainty"]["combined"]} if p.get("uncertainty") else dict(p))


def _weak(p: Row) -> Sentence:
    text = f"{p['name']} is only roughly known: {_told(p)}."
    return say("warning", text, value=p["value"], standard_error=p["standard_error"])


def _weaks(name: str, rows: Sequence[Row]) -> Sentence:
    values = span([p["value"] for p in rows], rows[0]["unit"])
    text = f"{name} is only roughly known in {len(rows)} recordings ({_recordings(rows)}): {values}."
    return say("warning", text, recordings=len(rows))


def _flat(p: Row) -> Sentence:
    if p.get("equal_answers"):
        low, high = p["equal_answers"]
        text = f"{p['name']} is not determined: runs of the same cost found it from {number(low)} to {with_unit(high, p['unit'])}."
        return say("bad", text, low=low, high=high)
    text = (
        f"{p['name']} is not determined: the data allow nearly the whole range from {number(p['lower_bound'])} "
        f"to {with_unit(p['upper_bound'], p['unit'])}."
    )
    return say("bad", text, value=p["value"])


def _flats(name: str, rows: Sequence[Row]) -> Sentence:
    text = f"{name} is not determined in {len(rows)} recordings ({_recordings(rows)}): the data allow nearly the whole range."
    return say("bad", text, recordings=len(rows))


def _bound(p: Row) -> Sentence:
    if p["at_bound"] == "lower" and p["lower_bound"] == 0.0:  # a dead time, a friction: usually nothing lies below
        text = (
            f"{p['name']} ended on its lower bound, {with_unit(0.0, p['unit'])}, and cannot be told from zero: take it out of the model, "
            "or widen the bound where it may be negative."
        )
        return say("warning", text, value=p["value"])
    text = (
        f"{p['name']} ended on its {p['at_bound']} bound, {with_unit(p['value'], p['unit'])}: the data pull it further. "
        "Widen the bound if physics allows, else take it out of the model."
    )
    return say("warning", text, value=p["value"])


def _bounds(name: str, rows: Sequence[Row]) -> Sentence:
    text = (
        f"{name} ended on a bound in {len(rows)} recordings ({_recordings(rows)}): the data pull it further. "
        "Widen the bounds if physics allows, else take it out of the model."
    )
    return say("warning", text, recordings=len(rows))


def _recordings(rows: Sequence[Row]) -> str:
    return some([str(p["recording"]) for p in rows])
