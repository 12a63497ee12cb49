"""How long intervals of an estimator are beside those of least squares."""

from collections.abc import Mapping, Sequence
from typing import Any

from plantfit.trust.verdict.words import number


def times(least: Mapping[str, Any], own: Mapping[str, Any]) -> float | None:
    """Length of an interval over that of least squares, where both ends of both are known."""
    lengths = [r["high"] - r["low"] for r in (least, own) if r["low"] is not None and r["high"] is not None]
    return lengths[1] / lengths[0] if len(lengths) == 2 and lengths[0] > 0 else None


def compared(least: Sequence[Mapping[str, Any]], own: Mapping[str, Mapping[str, Any]]) -> tuple[str, float] | None:
    """The end of a sentence, "intervals are 0.6 (a) to 0.9 (b) times as long as by least squares", and the least of
    these; `own` by name. None where there is nothing to compare."""
    ratios = {p["name"]: r for p in least if p["name"] in own and (r := times(p, own[p["name"]])) is not None}
    if not ratios:
        return None
    first, last = min(ratios, key=lambda n: ratios[n]), max(ratios, key=lambda n: ratios[n])
    short, long = number(ratios[first]), number(ratios[last])
    span = f"{short} ({first})" if short == long else f"{short} ({first}) to {long} ({last})"
    return f"intervals are {span} times as long as by least squares", ratios[first]


__all__ = ["compared", "times"]
