"""How sentences of the verdict are made: levels, numbers with units, lists that stay short."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.findings.verdict import Sentence as Said

Sentence = dict[str, Any]

FEW = 3  # recordings, or parameters of one kind, that get a sentence each; more are grouped
NAMED = 4  # names in a list before "and 7 more"
_ORDER = ("good", "info", "warning", "bad")


def say(level: str, sentence: str, **figures: float) -> Sentence:
    """One sentence of the verdict."""
    return Said.model_validate(
        {"level": level, "sentence": sentence, "figures": {k: float(v) for k, v in figures.items()}}
    ).plain()


def worst(levels: Iterable[str]) -> str:
    """The gravest of several levels."""
    return max(levels, key=_ORDER.index)


def number(value: float, digits: int = 3) -> str:
    """Three significant digits, or so many."""
    return f"{value:.{digits}g}"


def with_unit(value: float, unit: str | None) -> str:
    """A number with its unit."""
    return f"{number(value)} {unit}" if unit and unit not in ("1", "") else number(value)


FAR = -100.0  # per cent: below that a fit is told as how many times farther off than the mean the model is


def plain_unit(unit: str | None) -> str:
    """A unit as a sentence has it: differences of temperatures in K."""
    return "" if unit in (None, "1") else unit.replace("delta_degree_Celsius", "K").replace("delta_degC", "K")


def percent(share: float) -> str:
    """A share as a sentence has it."""
    of_100 = 100.0 * share
    return (
        f"{of_100:.0f} %" if of_100 < 99.5 and of_100 >= 2 else f"{of_100:.1f} %" if of_100 < 99.95 else "over 99.9 %"
    )


def times_the_mean(percent: float) -> str | None:
    """`354 times that of a constant at the mean`, of an RMSE, where a fit in per cent is below -100; else None."""
    return f"{number(1.0 - percent / 100.0)} times that of a constant at the mean" if percent < FAR else None


def span(values: Sequence[float], unit: str | None) -> str:
    """`0.1 to 0.3 V`, or one number when both ends read the same."""
    low, high = min(values), max(values)
    return with_unit(low, unit) if number(low) == number(high) else f"{number(low)} to {with_unit(high, unit)}"


def interval(low: float, high: float, unit: str | None = None, *, beside: float | None = None) -> str:
    """`0.1 to 0.3 V`, in as many digits as tell the ends apart, or what is narrower `beside` it, in two figures."""
    width, size = min(high - low, high - low if beside is None else beside), max(abs(low), abs(high))
    apart = int(np.ceil(np.log10(size / width))) + 2 if 0 < width < np.inf and np.isfinite(size) else 3
    digits = min(max(3, apart), 15)
    return f"{number(low, digits)} to {number(high, digits)}{f' {unit}' if unit and unit != '1' else ''}"


def some(names: Sequence[str], most: int = NAMED) -> str:
    """`a, b and c`; of a long list the first, and how many more."""
    if len(names) > most:
        return f"{', '.join(names[: most - 1])} and {len(names) - most + 1} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


EXACT = 1e-9  # of a value: standard errors below are those of rounded numbers, no sensor is as good


def estimate(p: dict[str, Any]) -> str:
    """`R = 2.31 ± 0.04 ohm`, rounded by the standard error; `R = 2.31 ohm (exact to rounding)` where that says no
    more."""
    error, unit = p["standard_error"], "" if p["unit"] in (None, "1") else p["unit"]
    if error and error <= EXACT * abs(p["value"]):
        return f"{p['name']} = {p['value']:.9g} {unit}".rstrip() + " (exact to rounding)"
    if not error:
        return f"{p['name']} = {with_unit(p['value'], p['unit'])}"
    digits = max(0, 1 - int(np.floor(np.log10(error)))) if error < 10 else 0
    if p["value"] and (abs(p["value"]) < 1e-3 or abs(p["value"]) >= 1e5):
        power = int(np.floor(np.log10(abs(p["value"]))))
        scaled = error / 10.0**power
        digits = max(0, 1 - int(np.floor(np.log10(scaled))))
        body = f"({p['value'] / 10.0**power:.{digits}f} ± {scaled:.{digits}f})e{power}"
    else:
        body = f"{p['value']:.{digits}f} ± {error:.{digits}f}"
    return f"{p['name']} = {body} {unit}".rstrip()


def study_file(findings: Mapping[str, Any]) -> str:
    """The study file of the command that made an answer; "" for an answer of Python."""
    command = findings.get("reproduction", {}).get("command", "")
    return command.removeprefix("plantfit run ") if command.startswith("plantfit run ") else ""
