"""Budgets of what shared errors make uncertain: one reading of every signal, the clock, every assumed value."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from plantfit.findings.uncertainty import ReadingBudget, StatedError
from plantfit.problem.problem import Problem
from plantfit.trust.stated_errors.shared_error import SharedError
from plantfit.trust.stated_errors.uncertainty_budget import MANY, Budget

Kind = Literal["signal", "clock", "constant"]
K = 2.0  # coverage factor of the expanded uncertainty that is quoted


def reading_budgets(problem: Problem, errors: Sequence[SharedError]) -> list[ReadingBudget]:
    """One budget for every signal (and every group of recordings that has the same errors), clock and constant.

    `at` is the recorded reading that is the most uncertain, or the value of the constant; `expanded` has k = 2.
    """
    found = []
    for subject in dict.fromkeys(s for e in errors for s in _subjects(e)):
        own = [e for e in errors if subject in _subjects(e)]
        for names in _groups(problem, own):
            here = [e for e in own if e.kind == "constant" or set(names) <= set(e.touches(tuple(problem.experiments)))]
            found.append(_budget(problem, *subject, here, names, all_of_them=len(names) == len(problem.experiments)))
    return found


def _subjects(error: SharedError) -> list[tuple[Kind, str]]:
    """What an error makes uncertain: kind and name."""
    if error.kind == "clock":
        return [("clock", "clock")]
    return [("constant" if error.kind == "constant" else "signal", name) for name in error.names]


def _groups(problem: Problem, errors: Sequence[SharedError]) -> list[list[str]]:
    """Recordings with the same errors, without those that have none; all of them for constants."""
    recordings = tuple(problem.experiments)
    if errors[0].kind == "constant":
        return [list(recordings)]
    groups: dict[tuple[int, ...], list[str]] = {}
    for name in recordings:
        groups.setdefault(tuple(i for i, e in enumerate(errors) if name in e.touches(recordings)), []).append(name)
    return [names for mine, names in groups.items() if mine]


def _budget(
    problem: Problem, kind: Kind, of: str, errors: Sequence[SharedError], names: Sequence[str], all_of_them: bool
) -> ReadingBudget:
    at, unit = _place(problem, errors, kind, of, names)
    reading = 0.0 if at is None else at
    sources = [
        dataclasses.replace(e.source, sensitivity=e.sensitivity(reading) if kind == "signal" else 1.0) for e in errors
    ]
    budget = Budget(tuple(sources), unit)
    rows = zip(budget.rows(K), errors, strict=True)
    degrees = budget.degrees_of_freedom
    return ReadingBudget(
        of=of,
        kind=kind,
        unit=unit,
        at=at,
        recordings=None if all_of_them else list(names),
        sources=[StatedError(**row, acts=e.kind, per_recording=e.per_recording) for row, e in rows],
        combined=budget.combined,
        expanded=budget.expanded(K),
        degrees_of_freedom=None if degrees > MANY else degrees,
        coverage_factor=budget.coverage_factor(),
    )


def _place(
    problem: Problem, errors: Sequence[SharedError], kind: str, of: str, names: Sequence[str]
) -> tuple[float | None, str | None]:
    """Where the budget is made, and its unit."""
    if kind == "clock":
        return None, "1"
    if kind == "constant":
        held = problem.space.parameters[of]
        return None if held.value is None else float(held.value), held.unit
    signals = [problem.experiments[n].recording.signals[of] for n in names]
    readings = np.concatenate([s.values[np.isfinite(s.values)] for s in signals])
    unit = next((s.unit for s in signals if s.unit), None)
    if not len(readings):
        return None, unit

    def spread(y: float) -> float:
        """Variance of a reading y; the largest is at an end, since it is a parabola in y that opens upwards."""
        return sum((e.sensitivity(y) * e.source.standard) ** 2 for e in errors)

    return max((float(readings.min()), float(readings.max())), key=spread), unit
