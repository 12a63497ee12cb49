"""What the verdict says about stated errors: whether they or the noise decide how wide the intervals are."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from plantfit.trust.verdict.words import Sentence, say, some, span

Row = Mapping[str, Any]


def uncertainty_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """One sentence where errors were stated and parameters have intervals."""
    rows = [
        p
        for p in findings["parameters"]
        if p.get("uncertainty") and p["standard_error"] and p["status"] in ("determined", "weak")
    ]
    if findings.get("uncertainty") is None or not rows:
        return
    worst = max(rows, key=_widening)
    times = _widening(worst)
    shared = [p for p in rows if p["uncertainty"]["shared"] > p["standard_error"]]
    if not shared:
        rest = ", and others less" if len(rows) > 1 else ""
        text = (
            f"The stated errors widen the interval of {worst['name']} "
            f"by {100 * (times - 1):.2g} %{rest}: the noise decides."
        )
        yield say("good", text, widening=times)
        return
    interval = span([worst["uncertainty"]["low"], worst["uncertainty"]["high"]], worst["unit"])
    others = (
        f"; they outweigh the noise in {len(shared)} of {len(rows)} parameters ({_names(shared)})"
        if len(rows) > 1
        else ""
    )
    text = (
        f"With the stated errors the interval of {worst['name']} is {times:.2g} times as "
        f"wide, {interval}, {_source(worst, findings['uncertainty']['budgets'])}{others}. "
        "More samples of the same set-up do not narrow that."
    )
    yield say("warning", text, widening=times, outweighed=len(shared))


def _widening(p: Row) -> float:
    """Combined standard uncertainty over that by noise."""
    return p["uncertainty"]["combined"] / p["standard_error"]


def _names(rows: Sequence[Row]) -> str:
    return some([p["name"] for p in rows])


def _source(p: Row, budgets: Sequence[Mapping[str, Any]]) -> str:
    """`most of it from the gain of y (transducer)`: the largest source of a parameter, and what it acts on."""
    parts = p["uncertainty"]["sources"]
    name = max(parts, key=parts.__getitem__)
    much = "most of it" if 2.0 * parts[name] ** 2 > p["uncertainty"]["combined"] ** 2 else "the largest part"
    return f"{much} from {_acting(name, budgets)}"


def _acting(name: str, budgets: Sequence[Mapping[str, Any]]) -> str:
    having = [(b, s) for b in budgets for s in b["sources"] if s["name"] == name]
    budget, row = having[0]
    if budget["kind"] == "clock":
        return "the clock" if name == "clock" else f"the clock ({name})"
    if budget["kind"] == "constant":
        return f"the value of {budget['of']} ({name})"
    return f"the {row['acts']} of {some(list(dict.fromkeys(b['of'] for b, _ in having)))} ({name})"
