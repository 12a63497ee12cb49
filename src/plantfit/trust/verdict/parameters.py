"""What the verdict says about parameters: one sentence each for a few, one for all entries of a table."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from plantfit import units
from plantfit.trust.finish.unknown_noise import LEAST_FREE
from plantfit.trust.verdict.outputs import forgotten, found_beside
from plantfit.trust.verdict.residuals import lacking
from plantfit.trust.verdict.tables import smoothing_sentences, table_sentences
from plantfit.trust.verdict.unseen import failing
from plantfit.trust.verdict.words import FEW, Sentence, estimate, interval, number, say, some, span, with_unit

Row = Mapping[str, Any]
LISTED = 8  # estimates in one sentence
APART = 3  # parameters of one kind that have a sentence each; more share one
HARDLY = 100.0  # times its lower end, from which on the upper end of a range leaves little known
PULLED = 0.1  # share of what is left that a value beyond its bound would explain, from which on it is told
UNEVEN = 1.5  # times as far as 1.96 standard errors, from which on an interval is told beside them


def parameter_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """Which parameters the data determine, and which not."""
    free = [p for p in findings["parameters"] if p["status"] != "fixed"]
    single, entries = [p for p in free if not p.get("index")], [p for p in free if p.get("index")]
    yield from _determined(
        single,
        free,
        _denied(findings),
        failing(findings),
        lacking(findings),
        forgotten(findings),
        found_beside(findings),
        any(r.get("curved") for r in findings.get("residual_tests", ())),
        list(dict.fromkeys(r["output"] for r in findings.get("residual_tests", ()) if r.get("sizes"))),
    )
    if not (findings.get("determined") or {}).get("sound", True):
        fitted = sum(s.get("n", 0) for s in findings.get("scores", ()) if s["part"] == "fit")
        weak, shown = [p for p in single if p["status"] == "weak"], findings["determined"].get("shown", ())
        # what residuals leave without an end is not what the samples leave open
        endless = [p for p in single if p["status"] == "flat" and p["name"] in shown and not p.get("equal_answers")]
        yield _unsound(findings["determined"], fitted, weak, endless, bool(forgotten(findings)))
        single = [_without_ends(p) for p in single if p not in weak and p not in endless]
    yield from _together(findings.get("determined"))
    yield from _first_values(findings)
    yield from table_sentences(entries, findings.get("tables", ()))
    yield from smoothing_sentences(findings.get("smoothing", ()))
    needs = (findings.get("determined") or {}).get("only_if", {})
    if failing(findings) or lacking(findings):
        single = [dict[str, Any](p, lacking=True) for p in single]
    single = [dict[str, Any](p, clock=_clock(findings, p)) if p.get("delays") else p for p in single]
    single = [{**p, "part_of": part} if (part := _part_of(p, findings)) else p for p in single]
    for status, one, many, all_of in (
        ("weak", _weak, _weaks, _all_weak), ("flat", _flat, _flats, _all_flat), ("at bound", _bound, _bounds, None),
    ):  # fmt: skip
        rows = [p for p in single if p["status"] == status]
        by_name = {
            n: [p for p in rows if p.get("parameter", p["name"]) == n]
            for n in dict.fromkeys(p.get("parameter", p["name"]) for p in rows)
        }
        for name, own in by_name.items():
            if len(own) > FEW:
                yield many(name, own)
        few = [p for own in by_name.values() if len(own) <= FEW for p in own]
        yield from all_of(few, needs) if all_of and len(few) > APART else (one(p, needs) for p in few)


def _part_of(p: Row, findings: Mapping[str, Any]) -> str:
    """The determined product that a parameter is part of and that is not zero, so that it is not zero either."""
    for c in (findings.get("determined") or {}).get("combinations", ()):
        low, high = c.get("low"), c.get("high")
        if c["product"] and c["weights"].get(p["name"]) and low is not None and high is not None and low * high > 0:
            return c["formula"]
    return ""


def _denied(findings: Mapping[str, Any]) -> str:
    """Outputs whose residuals are correlated while standard errors take them as independent."""
    if findings.get("standard_errors", {}).get("kind") != "classical":
        return ""
    found = dict.fromkeys(r["output"] for r in findings.get("residual_tests", ()) if not r["white"])
    return some(list(found)) if found else ""


def _determined(
    single: Sequence[Row],
    free: Sequence[Row],
    denied: str,
    fails: Sequence[str],
    lacks: Sequence[str],
    forgets: Sequence[str] = (),
    found: str = "",
    along: bool = False,
    sized: Sequence[str] = (),
) -> Iterator[Sentence]:
    good, total = [p for p in free if p["status"] == "determined"], len(free)
    if not good:
        return
    named = [p for p in single if p["status"] == "determined"]
    listed = ", ".join(_told(p) + _uneven(p) for p in named[:LISTED]) + (
        f" and {len(named) - LISTED} more" if len(named) > LISTED else ""
    )
    what = ", ± with the stated errors" if any(p.get("uncertainty") for p in named) else ""
    listed = "; ".join(t for t in (listed, _counted(good)) if t)
    text = f"The data determine {len(good)} of {total} parameters" + (f"{what}: {listed}." if listed else ".")
    if denied:
        text += f" The intervals take residuals as independent, and those of {denied} are not."
    if sized:
        text += f" The intervals take residuals as of one size, and those of {some(list(sized))} are not."
    if forgets:
        text += (
            f" The simulation does not follow {some(list(forgets))}: "
            "these are its values, and the plant's may be others."
        )
    elif fails:
        text += (
            f" The model does not hold for unseen samples of {some(list(fails))}: "
            "these are its values, and the plant's may be others."
        )
    if found:
        text += f" {found}, and these are values without it: the plant's may be others, by more than ± tells."
    elif lacks and not denied and not forgets and not fails:
        left = "follow the inputs" if along else "are not white"
        text += (
            f" The residuals of {some(list(lacks))} {left}: if the "
            "model lacks something, the plant's values may be others, "
        )
        text += "by more than ± tells."
    yield say(
        "warning"
        if denied or sized or fails or forgets or found
        else "good"
        if len(good) == total and not lacks
        else "info",
        text,
        determined=len(good),
    )


def _counted(good: Sequence[Row]) -> str:
    """How many entries of each table are among them; sentences of their own tell which are not."""
    entries = [p.get("parameter", p["name"]) for p in good if p.get("index")]
    told = [
        f"{entries.count(n)} {'entry' if entries.count(n) == 1 else 'entries'} of {n}" for n in dict.fromkeys(entries)
    ]
    return some(told, 9) if told else ""


def _uneven(p: Row) -> str:
    """The interval where it goes much farther to one side than the standard error says."""
    if not _between(p) or p.get("uncertainty") or not p["standard_error"]:
        return ""
    reach = max(p["high"] - p["value"], p["value"] - p["low"])
    return f" ({_between(p)})" if reach > UNEVEN * 1.96 * p["standard_error"] else ""


def _combined(c: Mapping[str, Any]) -> str:
    """A combination with its standard error, and its interval where its parts move it farther than that says."""
    own = {**c, "name": c["formula"], "unit": None, "limits": True}
    return estimate(own) + _uneven(own)


def _told(p: Row) -> str:
    """A value with its standard error, or with all its uncertainty where errors were stated."""
    return estimate({**p, "standard_error": p["uncertainty"]["combined"]} if p.get("uncertainty") else dict(p))


def _unsound(
    found: Mapping[str, Any], fitted: int, weak: Sequence[Row], endless: Sequence[Row] = (), forgets: bool = False
) -> Sentence:
    """That residuals are too slow, or `fitted` samples too few, for intervals that surely hold, the ranges of the
    `weak` rows, and that the `endless` ones have none."""
    told = "; ".join(_at_least(p) for p in weak[:LISTED]) + (
        f" and {len(weak) - LISTED} more" if len(weak) > LISTED else ""
    )
    more = f" The data allow these at least: {told}." if told else ""
    if endless:
        names = some([p["name"] for p in endless], LISTED)
        more += f" {names} {'move' if len(endless) > 1 else 'moves'} the simulation clearly, but with such residuals "
        more += f"no range can be given for {'them' if len(endless) > 1 else 'it'}."
    parameters = f"{found['of']} parameter{'s' * (found['of'] != 1)}"
    if 0 < fitted < found["of"] + LEAST_FREE:
        why = f"{fitted} fitted samples are too few for {parameters}, and intervals may be too short"
        do = "Give more samples, or free fewer parameters."
        return say("warning", f"No parameter is called determined: {why}.{more} {do}", samples=fitted)
    why = (
        "the residuals move so slowly that they are worth about "
        f"{number(found['samples'])} independent samples for {parameters}, and intervals may be too short"
    )
    do = (
        "Pieces with starts of their own may tell them."
        if forgets
        else "Take a longer record, or first add what the model lacks."
    )
    return say("warning", f"No parameter is called determined: {why}.{more} {do}", samples=found["samples"])


def _at_least(p: Row) -> str:
    """A parameter with an interval that may be too short."""
    between = _between(p)
    return f"{p['name']} {between}" if between else _told(p)


def _without_ends(p: Row) -> Row:
    """The row of a parameter as one says it where intervals may be too short: without ends that the data set."""
    least, most = p.get("limits") or (None, None)
    if p["status"] == "flat" and p.get("limits"):
        return {**p, "low": least, "high": most}
    return {**p, "high": None} if p["status"] == "at bound" else p


def _together(found: Mapping[str, Any] | None) -> Iterator[Sentence]:
    """Combinations that are determined where their parameters are not, all of them."""
    if not found or not found["combinations"]:
        return
    own = found["combinations"]
    listed = ", ".join(_combined(c) for c in own)
    whose = "the others" if found["count"] > len(own) else "the parameters"
    many = f"combinations of {whose} are determined" if len(own) > 1 else f"combination of {whose} is determined"
    text = f"{len(own)} {many}: {listed} (in the units of the parameters). "
    if found.get("directions", 0) > found["count"]:
        text += (
            f"Near the answer the data fix {found['directions']} of "
            f"{found['of']} numbers in all; the rest are neither products of "
        )
        text += "powers nor weighted sums of up to four parameters. "
    else:
        text += f"In all, the data fix {found['count']} of {found['of']} numbers. "
    text += "`plantfit combine` writes the study file in these combinations."
    yield say("info", text, combinations=len(own), fixed=found["count"])


def _first_values(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """That noise in the first measured values reaches the parameters, and what to write against it."""
    if own := (findings.get("determined") or {}).get("first_values"):
        if own.get("option"):
            how = f"Write options = {{ {own['option']} }} in [model], and they are parameters"
            how += (
                ", which several recordings need with per_recording = true."
                if len(findings.get("recordings", ())) > 1
                else "."
            )
        else:
            how = "Make the state's initial value a parameter, and it is estimated."
        text = (
            f"The states begin at the first measured values, whose noise makes the interval of {own['parameter']} "
            f"{number(own['factor'])} times as wide. {how}"
        )
        yield say("info", text, factor=own["factor"])


def _weak(p: Row, needs: Mapping[str, Any]) -> Sentence:
    kind = _kind(p)
    if kind == "zero":
        text = f"{p['name']} cannot be told from zero: {_roughly(p)}.{_condition(p, needs)}"
    elif kind == "hardly":
        beside = f" It is not zero, as {p['part_of']} is not." if _holds_zero(p) else ""
        text = f"{p['name']} is hardly known: {_roughly(p)}.{beside}{_condition(p, needs)}"
    else:
        text = f"{p['name']} is only roughly known: {_roughly(p)}.{_condition(p, needs)}"
    if p.get("moved_with"):
        text += (
            f" The fit is about the same with {p['name']} and the table {p['moved_with']} moved by whole nodes: give "
            f"{p['name']} a value, or hold the table."
        )
    if _by_range_alone(p):
        ends = {k: p[k] for k in ("low", "high") if p[k] is not None and np.isfinite(p[k])}
        return say("warning", text, value=p["value"], **ends)
    return say("warning", text, value=p["value"], standard_error=p["standard_error"])


def _kind(p: Row) -> str:
    """How little is known: the range holds zero, spans powers of ten, or is wide beside the value."""
    if not _between(p) or _point(p):
        return "roughly"
    if _holds_zero(p):
        return "hardly" if p.get("part_of") else "zero"
    low, high = sorted((abs(p["low"]), abs(p["high"])))
    return "hardly" if high > HARDLY * low else "roughly"


def _holds_zero(p: Row) -> bool:
    return p["low"] is not None and p["high"] is not None and p["low"] <= 0.0 <= p["high"]


def _point(p: Row) -> bool:
    """Whether zero is a value like others, as 0 degC is."""
    unit = p.get("unit")
    return bool(unit and units.known(unit) and units.is_point(unit))


def _roughly(p: Row) -> str:
    """The value with its standard error where that says something, and the range."""
    between = _between(p)
    if _by_range_alone(p):
        return f"the data allow {between}"
    return f"{_told(p)}{f', {between}' if between else ''}"


def _by_range_alone(p: Row) -> bool:
    """Whether the range goes so far beyond what the standard error at the answer says that this says nothing."""
    return bool(_between(p)) and (_kind(p) != "roughly" or not (p["standard_error"] or 0.0) < abs(p["value"]))


def _all_weak(rows: Sequence[Row], needs: Mapping[str, Any]) -> Iterator[Sentence]:
    """One sentence for each kind of many that are known a little."""
    for kind in ("zero", "hardly", "roughly"):
        own = [p for p in rows if _kind(p) == kind]
        if len(own) < 2:
            yield from (_weak(p, needs) for p in own)
            continue
        told = "; ".join(f"{_briefly(p)}{_if_known(p, needs)}" for p in own)
        if kind == "zero":
            text = f"{len(own)} parameters cannot be told from zero: {told}."
        elif kind == "hardly":
            text = f"{len(own)} parameters are hardly known: {told}."
        else:
            text = f"{len(own)} parameters are only roughly known: {told}."
        yield say("warning", text, parameters=len(own))


def _briefly(p: Row) -> str:
    told = _roughly(p)
    return told.replace("the data allow", f"{p['name']}", 1) if told.startswith("the data allow") else told


def _if_known(p: Row, needs: Mapping[str, Any]) -> str:
    return f" (determined if {needs[p['name']]['known']} is known)" if p["name"] in needs else ""


def _all_flat(rows: Sequence[Row], needs: Mapping[str, Any]) -> Iterator[Sentence]:
    """One sentence for each way in which many are left open."""
    own = [p for p in rows if not p.get("equal_answers")]
    yield from (_flat(p, needs) for p in rows if p.get("equal_answers"))
    ways = {p["name"]: _allowed(p) for p in own}
    for way in dict.fromkeys(ways.values()):
        alike = [p for p in own if ways[p["name"]] == way]
        if len(alike) == 1:
            yield _flat(alike[0], needs)
            continue
        text = (
            f"{len(alike)} parameters are not determined, "
            f"{some([p['name'] for p in alike], len(alike))}: of each {way}."
        )
        if told := [_condition(p, needs).strip() for p in alike if p["name"] in needs]:
            first = next(p["name"] for p in alike if p["name"] in needs)
            text += f" {told[0].replace('It is', f'{first} is', 1)}"
            text += f" The same holds for {len(told) - 1} more." if len(told) > 1 else ""
        yield say("bad", text, parameters=len(alike))


def _between(p: Row) -> str:
    """The range, empty for rows without one."""
    return "" if not p.get("limits") or p.get("low") is None else interval(p["low"], p["high"], p["unit"])


def _condition(p: Row, needs: Mapping[str, Any]) -> str:
    """What else has to be known for this one to be determined."""
    if p["name"] not in needs:
        return ""
    n = needs[p["name"]]
    then = estimate({"name": p["name"], "unit": p["unit"], "value": n["value"], "standard_error": n["standard_error"]})
    return (
        f" It is determined only if {n['known']} is known: with {n['known']} = {with_unit(n['at'], n['unit'])}, {then}."
    )


def _weaks(name: str, rows: Sequence[Row]) -> Sentence:
    values = span([p["value"] for p in rows], rows[0]["unit"])
    text = f"{name} is only roughly known in {len(rows)} recordings ({_recordings(rows)}): {values}."
    return say("warning", text, recordings=len(rows))


def _flat(p: Row, needs: Mapping[str, Any]) -> Sentence:
    if p.get("equal_answers"):
        low, high = p["equal_answers"]
        text = (
            f"{p['name']} is not determined: runs of the same cost found it from {number(low)} to "
            f"{with_unit(high, p['unit'])}."
        )
        return say("bad", text, low=low, high=high)
    text = f"{p['name']} is not determined: {_allowed(p)}.{_condition(p, needs)}"
    return say("bad", text, value=p["value"])


def _allowed(p: Row) -> str:
    """What the data leave open, in words."""
    least, most = p.get("limits") or (None, None)
    ends = p.get("open")
    if ends is None:
        if not p.get("limits"):
            searched = f"{number(p['lower_bound'])} to {with_unit(p['upper_bound'], p['unit'])}"
            return f"the data allow {interval(p['low'], p['high'], p['unit'])}, of {searched} that was searched"
        return f"the data allow all that is possible, {number(p['low'])} to {with_unit(p['high'], p['unit'])}"
    low = ends == "upper" and p["low"] != least  # the data set a lower end
    high = ends == "lower" and p["high"] != most
    if low:
        return f"it is at least {with_unit(p['low'], p['unit'])}, and the data set no upper end"
    if high:
        return f"it is at most {with_unit(p['high'], p['unit'])}, and the data set no lower end"
    word, end = ("above", least) if least is not None else ("below", most)
    # zero is zero in every unit but those of temperature
    told = (
        "" if end is None else f" {word} 0" if end == 0.0 and not _point(p) else f" {word} {with_unit(end, p['unit'])}"
    )
    return f"the data allow any value{told}"


def _flats(name: str, rows: Sequence[Row]) -> Sentence:
    text = (
        f"{name} is not determined in {len(rows)} recordings ({_recordings(rows)}): "
        "the data allow much of the range that was searched."
    )
    return say("bad", text, recordings=len(rows))


def _bound(p: Row, needs: Mapping[str, Any]) -> Sentence:
    limited = (p.get("limits") or (None,))[0] == 0.0
    if _on_zero(p) and (limited or not _is_pulled(p)):  # a dead time, a friction: usually nothing lies below
        text = f"{p['name']} ended on its lower bound, {with_unit(0.0, p['unit'])}, and "
        if _is_pulled(p):
            return say("warning", text + _below_zero(p), value=p["value"], pulled=p["pulled"])
        text += f"cannot be told from zero{_at_most(p)}"
        if p.get("recording"):  # of one recording it cannot be taken out
            text += ": there it may be zero."
        elif p.get("lacking"):
            text += ". The model lacks something: find that before you take it out."
        else:
            text += f": take it out of the model{'' if limited else ', or widen the bound where it may be negative'}."
        return say("warning", text, value=p["value"])
    text = (
        f"{p['name']} ended on its {p['at_bound']} bound, {with_unit(p['value'], p['unit'])}: the "
        "data pull it further. Widen the bound if physics allows, else "
    )
    text += "find what the model lacks." if p.get("lacking") else "take it out of the model."
    return say("warning", text, value=p["value"])


def _on_zero(p: Row) -> bool:
    return bool(p["at_bound"] == "lower" and p["lower_bound"] == 0.0 and not _point(p))


def _is_pulled(p: Row) -> bool:
    """Whether the data take a value beyond its bound by more than chance does."""
    return (p.get("pulled") or 0.0) >= PULLED


def _below_zero(p: Row) -> str:
    """What the data say that pull a value to where physics has none."""
    text = f"the data pull it below zero, where {100 * p['pulled']:.0f} % less would be left"
    if p.get("delays"):
        u = p["delays"]
        return (
            f"{text}: the plant moves before {u} does, as it is recorded. The clock of {u} may be another one, in one "
            f"recording or in all: {p.get('clock') or f'clock_shift = {{ {u} = [-T, T] }}'} under [model], in place of "
            f"{p['parameter'] if p.get('parameter') else p['name']}, tells by how much (s)."
        )
    return f"{text} and it means nothing: something else in the model is missing or wrong. Find that, and keep it."


def _clock(findings: Mapping[str, Any], p: Row) -> str:
    """The line that a look at the record writes for the clock of the input that a dead time delays; "" without one."""
    looks = findings.get("data") or ()
    lines = (k["write"] for k in looks if k["kind"] == "feedback" and k["signal"] == p["delays"])
    return next((line for line in lines if line.startswith("clock_shift")), "")


def _at_most(p: Row) -> str:
    """How large a value on its lower bound may be all the same."""
    known = (
        p.get("limits") and p.get("high") is not None and p.get("open") in (None, "lower") and p["high"] > p["value"]
    )
    return f" (it is at most {with_unit(p['high'], p['unit'])})" if known else ""


def _bounds(name: str, rows: Sequence[Row]) -> Sentence:
    if all(_on_zero(p) and not _is_pulled(p) for p in rows):
        where = f"in {len(rows)} recordings ({_recordings(rows)})"
        text = f"{name} ended on its lower bound, {with_unit(0.0, rows[0]['unit'])}, {where}, and there it may be zero."
        return say("warning", text, recordings=len(rows))
    text = (
        f"{name} ended on a bound in {len(rows)} recordings ({_recordings(rows)}): the data pull it further. "
        "Widen the bounds if physics allows, else take it out of the model."
    )
    return say("warning", text, recordings=len(rows))


def _recordings(rows: Sequence[Row]) -> str:
    return some([str(p["recording"]) for p in rows])
