"""The sections on what may be missing in the model and on what is odd about the data."""

from typing import Any

from plantfit.findings import Diagnosis, Findings, Round, Tried
from plantfit.recording.looks.look import IN_VERDICT, Look
from plantfit.report import figures
from plantfit.report.drawings import Drawings
from plantfit.report.figures.looks import TIMES
from plantfit.report.numbers import percent, plus_minus, significant, unit_label
from plantfit.report.sections.sentences import LEVELS, listed
from plantfit.report.sections.tables import Table

MOST_PANELS, POINTS = 6, 2000  # series drawn, samples of each
MOST_LOOKS = 12  # pictures


def of_findings(record: Findings, drawings: Drawings) -> dict[str, Any] | None:
    """What the template shows of a diagnosis; None where none was made, or the verdict on top of the page says all
    of it."""
    found = record.diagnosis
    if found is None:
        return None
    rounds = [r for r in found.rounds if r.tried]
    bars = change = None
    if rounds:
        bars = drawings.add(
            figures.share_figure(rounds[0], _unmeasured(found)),
            "Share of the mean square left that each addition to the model explains.",
        )
    if found.residuals:
        label = f"Residuals over time with the model as it is and with {listed(found.with_)}."
        change = drawings.add(figures.residual_change_figure(found.residuals[:MOST_PANELS], POINTS), label)
    told = {v.sentence for v in record.verdict}  # stands on top of the page already
    more = [v for v in found.verdict if v.sentence not in told]
    if not (rounds or found.residuals or found.write or more):
        return None
    return {
        "sentences": [_said(v.level, v.sentence) for v in more],
        "bars": bars,
        "change": change,
        "with_it": listed(found.with_) if found.with_ else "",
        "left": max(0, len(found.residuals) - MOST_PANELS),
        "tables": [_table(r) for r in rounds],
        "write": "\n".join(found.write),
        "next": found.next,
    }


def _unmeasured(found: Diagnosis) -> dict[str, float]:
    """By name the share that a pattern or a step explains."""
    told = {p.name: found.repeating.explained for p in found.repeating.places} if found.repeating else {}
    told |= {s.name: found.stepping.explained for s in found.stepping.steps} if found.stepping else {}
    return {name: share for name, share in told.items() if share is not None}


def looks(record: Findings, drawings: Drawings) -> list[dict[str, Any]]:
    """What is odd about the data, each with where it is, the line that treats it, and a picture of the place."""
    recordings = {r.name: r for r in record.recordings}
    found = []
    for k, look in enumerate(look for look in record.data if look.kind not in IN_VERDICT):
        own = recordings.get(look.recording)
        figure = None if own is None or k >= MOST_LOOKS else figures.look_figure(look, own)
        label = f"{_shown(look)} in {look.recording}."
        drawn = None if figure is None else drawings.add(figure, label)
        found.append({**_said(look.level, look.sentence), "where": _where(look), "write": look.write, "figure": drawn})
    return found


def _shown(look: Look) -> str:
    """What the picture of a look shows."""
    if look.kind in TIMES:
        return "Samples beside the time that the model asks for"
    if look.kind == "feedback":
        return f"What is new in {look.signal} and what {look.other} tells of it"
    return f"{look.signal or 'The clock'} where this is"


def _said(level: str, sentence: str) -> dict[str, Any]:
    return {"level": level, "word": LEVELS[level][0], "mark": LEVELS[level][1], "sentence": sentence}


def _where(look: Look) -> str:
    if look.begin is None or look.end is None:
        return look.recording
    return f"{look.recording}, {significant(look.begin, 4)} to {significant(look.end, 4)} s"


def _table(one: Round) -> Table:
    caption = "Tried" + (f" beside {listed(one.beside)}" if one.beside else "")
    head = (
        "addition to the model",
        "explains",
        "RMSE without",
        "RMSE with it",
        "unseen without",
        "unseen with it",
        "its value",
        "unit",
    )
    rows = tuple(_row(t) for t in one.tried) + tuple((name, "not tried", *[""] * 6) for name in one.untried)
    marked = frozenset(k for k, t in enumerate(one.tried) if t.name in one.found)
    return Table(caption, head, rows, frozenset(range(1, 7)), marked)


def _row(t: Tried) -> tuple[str, ...]:
    share = "" if t.explained is None else percent(round(t.explained, 5))
    unseen = ("", "") if t.unseen_rmse is None else (significant(t.unseen_rmse, 4), significant(t.unseen_rmse_with, 4))
    value = (
        ""
        if t.value is None
        else plus_minus(t.value, t.standard_error)
        if t.standard_error
        else significant(t.value, 3)
    )
    return (t.name, share, significant(t.rmse, 4), significant(t.rmse_with, 4), *unseen, value, unit_label(t.unit))


__all__ = ["looks", "of_findings"]
