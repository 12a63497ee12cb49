"""What a comparison of recordings says."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.trust.verdict.words import Sentence, estimate, interval, number, say, some, study_file, with_unit

Record = Mapping[str, Any]
LOST = 5.0  # times the residual of the others: a recording that the model does not follow even with its own values
MOVED = 3  # parameters that are named with their figures
CAUSES = (
    "The plant changed between them, or the model lacks something that they excite differently (`plantfit diagnose`)."
)


def sentences(record: Record) -> list[Sentence]:
    """The verdict: whether the recordings agree, which one does not and what moved, what could not be tested."""
    return [*_first(record), *_spread(record), *_untested(record)]


def answer_sentences(findings: Record) -> list[Sentence]:
    """What the verdict of an answer says: which recordings disagree, and how intervals allow for it; nothing where
    they agree."""
    section = findings.get("heterogeneity")
    if not section:
        return []
    file = study_file(findings)
    command = f"`plantfit compare-records {shlex.quote(file)}`" if file else "`pf.compare_records(answer)`"
    if section["state"] == "left":
        text = (
            f"Whether the {len(section['recordings'])} recordings agree "
            f"was not tested, as it takes long; {command} does it."
        )
        return [say("info", text)]
    count, rows = len(section["recordings"]), findings["parameters"]
    if section["agree"] is False:
        return [*_first(section), _allowed_for(count, rows, command)]
    sound = (findings.get("determined") or {}).get("sound", True)  # else the verdict says that no interval holds
    return [*_doubted(section, rows, count, sound), *(_unseen(section, rows, count) if sound else ())]


def _allowed_for(count: int, rows: Sequence[Record], command: str) -> Sentence:
    """The intervals that are wider, and what is not called determined any more."""
    wider = [r for r in rows if r["by_noise"]]
    if not wider:
        return say("info", f"{command} fits each of them alone.")
    text = f"Intervals allow for the scatter between the {count} recordings: {_wider(wider)}.{_withdrawn(wider)}"
    text += f"{_two(count)} {command} fits each of them alone."
    return say("warning", text, widened=len(wider), withdrawn=len(_lost(wider)))


def _doubted(section: Record, rows: Sequence[Record], count: int, sound: bool) -> list[Sentence]:
    """Intervals that are wider though recordings agree, and what may scatter."""
    wider = [r for r in rows if r["by_noise"]]
    if not wider:
        return []
    p = {t["name"]: t["p"] for t in section["parameters"]}
    doubted = [r for r in wider if r["scatter"]]
    names = [f"{r['name']} (p {number(p[r['name']])})" for r in doubted[:MOVED]] + [r["name"] for r in doubted[MOVED:]]
    chance = (
        f"but {some(names)} may scatter between them"
        if names
        else "as so few often do where a plant scatters between them"
    )
    agree = (
        f"The {count} recordings agree within chance, {chance}"
        if sound
        else f"Whether the {count} recordings agree cannot be told by intervals that do not hold, and a plant may "
        "scatter between them"
    )
    text = f"{agree}. Intervals allow for that: {_wider(wider)}.{_withdrawn(wider)}"
    text += " A third one makes them shorter." if count == 2 else ""
    return [say("info", text, widened=len(wider), withdrawn=len(_lost(wider)))]


def _unseen(section: Record, rows: Sequence[Record], count: int) -> list[Sentence]:
    """What the other intervals hold for where recordings agree, and how large a scatter they would have told."""
    others = [r["name"] for r in rows if not r["by_noise"] and r["name"] in {t["name"] for t in section["parameters"]}]

    def size(t: Record) -> float:
        return t["seen_from"] / max(abs(t["joint"]["value"]), 1e-300)

    tested = sorted(
        [t for t in section["parameters"] if t["seen_from"] is not None and size(t) < 1], key=size, reverse=True
    )
    if not tested:
        return []
    shown = [f"{100 * size(t):.2g} % of {t['name']}" for t in tested[:MOVED]]
    left = len(tested) - MOVED
    more = f", less in the other{f' {left}' if left > 1 else ''}" if left > 0 else ""
    told = f"is told in 8 of 10 such studies from a standard deviation of {some(shown)} on{more}"
    if others:
        all_of_them = len(others) == len(section["parameters"])
        which = "Intervals are those" if all_of_them else f"Intervals of {some(others)} are those"
        text = f"{which} of one plant in all {count} recordings. A scatter between them {told}; "
        text += "a smaller one may stay unseen, and intervals are then too short for another one."
    else:
        text = f"A scatter between recordings {told}; a smaller one may stay unseen."
    return [say("info", text, seen_from=tested[0]["seen_from"])]


def _wider(rows: Sequence[Record]) -> str:
    """The intervals that grew most, beside those by the noise alone."""
    grown = sorted(
        rows, key=lambda r: -(r["high"] - r["low"]) / max(r["by_noise"]["high"] - r["by_noise"]["low"], 1e-300)
    )
    shown = []
    for r in grown[:MOVED]:
        (low, high), width = (r["by_noise"][end] for end in ("low", "high")), r["high"] - r["low"]
        own = interval(r["low"], r["high"], r["unit"], beside=high - low)
        shown.append(f"that of {r['name']} is {own} instead of {interval(low, high, beside=width)}")
    return "; ".join(shown) + (f"; {some([r['name'] for r in grown[MOVED:]])} likewise" if len(grown) > MOVED else "")


def _lost(rows: Sequence[Record]) -> list[str]:
    return [r["name"] for r in rows if r["by_noise"]["status"] == "determined" and r["status"] != "determined"]


def _withdrawn(rows: Sequence[Record]) -> str:
    lost = _lost(rows)
    return f" {some(lost, 9)} {'is' if len(lost) == 1 else 'are'} not called determined for that." if lost else ""


def _two(count: int) -> str:
    return (
        " Two recordings say little of a scatter; a third one makes such intervals over three times shorter."
        if count == 2
        else ""
    )


def _first(record: Record) -> list[Sentence]:
    tested = [p["name"] for p in record["parameters"] if p["p"] is not None]
    names = [r["name"] for r in record["recordings"]]
    if not tested:
        text = "Whether the recordings agree cannot be told: no parameter is determined by two recordings alone."
        slow = any(not r["sound"] for r in record["recordings"])
        more = (
            "Record longer, or see what the model lacks (`plantfit diagnose`)."
            if slow
            else ("Record longer, or with inputs that move more.")
        )
        return [say("warning", f"{text} {more}")]
    differ = [p for p in record["parameters"] if p["differs"]]
    if record["agree"]:
        least = min([p["p_adjusted"] for p in record["parameters"] if p["p"] is not None], default=1.0)
        whole = len(tested) == len(record["parameters"]) and all(
            a["tested"] for p in record["parameters"] for a in p["alone"]
        )
        what = "all parameters" if len(tested) == len(record["parameters"]) else some(tested)
        compared = {a["recording"] for p in record["parameters"] for a in p["alone"] if a["tested"]}
        count = (
            f"{len(names)} recordings"
            if len(compared) == len(names)
            else f"{len(compared)} of {len(names)} recordings compared"
        )
        tail = f"least p {number(least)}, corrected for {len(tested) + (record['together'] is not None)} tests"
        who = "The recordings" if len(compared) == len(names) else some([n for n in names if n in compared], 9)
        return [say("good" if whole else "info", f"{who} agree on {what} ({count}; {tail}).", p=least)]
    if record["either"]:
        who = f"one of {some(record['either'], 9)}, without which the others agree: these recordings do not tell which"
        return [say("warning", f"{_differ(differ, record)}. It is {who}. {CAUSES}")]
    if len(names) == 2 or not record["apart"]:
        return [say("warning", f"{_differ(differ, record)}. {CAUSES}", **_p(differ, record))]
    return [_apart(a, record) for a in record["apart"]] + [say("info", _same(record))]


def _differ(differ: Sequence[Record], record: Record) -> str:
    """Each parameter that differs, with its values."""
    if not differ:
        p = chance(record["together"]["p_adjusted"])
        return (
            "The recordings disagree on the parameters together "
            f"({p}), though on none of them by more than its intervals"
        )
    told = []
    for p in sorted(differ, key=lambda p: p["p_adjusted"])[:MOVED]:
        known = [a for a in p["alone"] if a["tested"]]
        known.sort(key=lambda a: a["value"])
        shown = known if len(known) <= 4 else [known[0], known[-1]]
        values = some([f"{_value(a['value'], a['standard_error'], p['unit'])} in {a['recording']}" for a in shown], 9)
        told.append(
            f"{p['name']} differs between recordings by more than its intervals: {values} ({chance(p['p_adjusted'])})"
        )
    more = f"; so {_do(len(differ) - MOVED)} {some([p['name'] for p in differ[MOVED:]])}" if len(differ) > MOVED else ""
    return "; ".join(told) + more


def chance(p: float) -> str:
    """A p-value in words of a sentence; below 1e-9 its size means nothing."""
    return f"p {number(p)}" if p >= 1e-9 else "p below 1e-9"


def _do(count: int) -> str:
    return "does" if count == 1 else "do"


def _apart(a: Record, record: Record) -> Sentence:
    moved = [m for m in a["moved"] if m["told"]]
    shown = [
        f"{m['name']} is {_value(m['value'], m['standard_error'], m['unit'])} there and "
        f"{_value(m['others'], m['others_error'], m['unit'])} in {_others(a)}{_share(m)}"
        for m in moved[:MOVED]
    ]
    own = next(r for r in record["recordings"] if r["name"] == a["recording"])
    unit = record["unit"]
    what = "; ".join(shown) if shown else "the parameters differ together, none of them by more than its intervals"
    more = f"; {some([m['name'] for m in moved[MOVED:]])} moved as well" if len(moved) > MOVED else ""
    rmse = (
        f"its RMSE is {number(own['rmse_joint'])} with the joint "
        f"values and {with_unit(own['rmse_alone'], unit)} with its own"
    )
    figures = {"rmse_joint": own["rmse_joint"], "rmse_alone": own["rmse_alone"]}
    if moved:
        figures |= {"by": moved[0]["by"], "p": moved[0]["p_adjusted"]}
    return say("bad", f"{a['recording']} no longer fits the other recordings: {what}{more}; {rmse}.", **figures)


def _others(a: Record) -> str:
    return some(a["others"]) if len(a["others"]) <= 4 else f"the {len(a['others'])} others"


def _share(m: Record) -> str:
    return "" if m["share"] is None else f" ({100.0 * m['share']:+.3g} %)"


def _same(record: Record) -> str:
    rest = record["apart"][0]["others"]
    return f"Without {some([a['recording'] for a in record['apart']], 9)} the recordings agree ({some(rest)}). {CAUSES}"


def _p(differ: Sequence[Record], record: Record) -> dict[str, float]:
    return {
        "p": min(
            [p["p_adjusted"] for p in differ], default=record["together"]["p_adjusted"] if record["together"] else 1.0
        )
    }


def _spread(record: Record) -> list[Sentence]:
    """That the standard error of the joint answer does not hold for another recording."""
    said = []
    for p in record["parameters"] if not record["apart"] or len(record["recordings"]) == 2 else ():
        error = p["joint"]["standard_error"]
        if p["differs"] and error and p["between"] > error:
            text = (
                f"Between recordings {p['name']} scatters by {with_unit(p['between'], p['unit'])} "
                f"(standard deviation), {number(p['between'] / error)} times the standard error "
                "of the joint answer, which does not hold for another recording."
            )
            said.append(say("warning", text, between=p["between"], standard_error=error))
    return said[:MOVED]


def _untested(record: Record) -> list[Sentence]:
    """What a recording alone does not determine, and recordings whose intervals do not hold."""
    said = []
    slow = [r["name"] for r in record["recordings"] if not r["sound"]]
    followed = max((r["rmse_alone"] for r in record["recordings"] if r["sound"]), default=np.inf)
    for r in record["recordings"]:
        if not r["sound"] and r["rmse_alone"] > LOST * followed:
            own, best = (with_unit(value, record["unit"]) for value in (r["rmse_alone"], followed))
            text = (
                f"The model does not follow {r['name']} even with values of its own (RMSE {own}, of the others up to "
                f"{best}): look at this recording first, as for a sign that is wrong, a lost channel or another plant."
            )
            said.append(say("warning", text, rmse=r["rmse_alone"]))
    if slow:
        text = (
            f"What is left of {some(slow)} moves too slowly, or is too "
            f"short, for intervals that hold; {_it(slow)} not compared."
        )
        said.append(say("info", text))
    for p in record["parameters"]:
        open_ = [a["recording"] for a in p["alone"] if not a["tested"] and a["recording"] not in slow]
        if open_:
            said.append(say("info", f"{p['name']} is not determined by {some(open_)} alone, and not compared there."))
    return said


def _it(names: Sequence[str]) -> str:
    return "it is" if len(names) == 1 else "they are"


def _value(value: float, error: float | None, unit: str | None) -> str:
    row = {"name": "x", "value": value, "standard_error": error, "unit": "" if unit in (None, "1") else unit}
    return estimate(row).removeprefix("x = ")
