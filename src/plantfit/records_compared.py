"""Do my recordings agree: every recording of an answer fitted alone, and its parameters beside those of the others."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import RecordingError
from plantfit.findings.results.records_compared import ComparisonOfRecords
from plantfit.findings.results.result import Result
from plantfit.optimize import minimise
from plantfit.problem.problem import Problem
from plantfit.report.case_page import write_case_page
from plantfit.report.pages.records_compared import records_page, records_rows
from plantfit.report.text import columns
from plantfit.study.objective import objective_of
from plantfit.study.plan import default_budget
from plantfit.trust.heterogeneity.agreement import compared
from plantfit.trust.heterogeneity.alone import alone, estimates, fitted_alone, joint_start

if TYPE_CHECKING:
    import polars as pl


class RecordsCompared(Result[ComparisonOfRecords]):
    """What `compare_records` found."""

    @property
    def agree(self) -> bool | None:
        """Whether no parameter differs between recordings beyond chance; None where none could be tested."""
        return self.typed.agree

    @property
    def apart(self) -> tuple[str, ...]:
        """Recordings that no longer fit the others; none where they agree, where there are two, or where the
        recordings scatter."""
        return tuple(a.recording for a in self.typed.apart) if len(self.typed.recordings) > 2 else ()

    def to_frame(self) -> "pl.DataFrame":
        """A polars data frame, a row for each parameter and recording: parameter, unit, recording ("" for the joint
        fit), value, standard_error, low, high (95 %), status, p (adjusted, of the parameter)."""
        import polars as pl

        rows = [
            {
                "parameter": p.name, "unit": p.unit, "recording": getattr(a, "recording", ""), "value": a.value,
                "standard_error": a.standard_error, "low": a.low, "high": a.high, "status": a.status, "p": p.p_adjusted,
            }
            for p in self.typed.parameters
            for a in [*p.alone, p.joint]
        ]  # fmt: skip
        numbers = dict.fromkeys(("value", "standard_error", "low", "high", "p"), pl.Float64)
        return pl.DataFrame(rows, schema_overrides={"unit": pl.String, **numbers})

    def report(self, path: str | Path) -> Path:
        """Write the page with a forest plot of each parameter. Raises StoreError."""
        return write_case_page(records_page(self.typed), path)

    def table(self) -> str:
        """The parameters of every recording as text."""
        head, rows = records_rows(self.typed, ascii_only=True)
        return columns(head, rows, range(1, len(head)))


def compare_records(
    answer: Answer, *, budget: int | None = None, seed: int = 0, progress: Callable[[str], None] | None = None
) -> RecordsCompared:
    """Say whether the recordings of an answer agree on its parameters, and which one is apart.

    Every fitted recording is fitted alone, from the answer of all and by a search of `budget` evaluations within the
    bounds. Parameters that the study shares are held against each other: Cochran's Q with the standard errors that
    plantfit states, which allow for correlated residuals, as Welch has it for few degrees of freedom; all parameters at
    once by Hotelling's F; Holm's levels, so that 5 % of the studies whose recordings agree are told otherwise. Seconds
    a recording; `progress` is told which one is fitted.

    Raises RecordingError for an answer of one recording.
    """
    problem, z, say = answer.problem, np.asarray(answer.best.x, dtype=float), progress or (lambda text: None)
    names = list(problem.data["drive"])
    if len(names) < 2:
        raise RecordingError(one_recording(problem))
    say("looking at the joint fit")
    joint = estimates(problem, z, float(sum(r.evaluations for r in answer.runs)))
    each = {}
    for name in names:
        say(f"fitting {name} alone")
        own = alone(problem, name)
        each[name] = fitted_alone(own, joint_start(problem, z, own), lambda p, start: _searched(p, start, budget, seed))
    return RecordsCompared(ComparisonOfRecords.model_validate(compared(problem, joint, each)))


def one_recording(problem: Problem) -> str:
    """What to do with one recording."""
    name = next(iter(problem.data["drive"]))
    return (
        f"{problem.name!r} fits one recording, {name!r}, and there is nothing to compare it with; add another "
        "[recording.NAME], or name its file twice with different parts, as in fit = [0, 100] and fit = [100, 200]."
    )


def _searched(problem: Problem, start: np.ndarray, budget: int | None, seed: int) -> tuple[np.ndarray, float]:
    found = minimise(
        objective_of(problem, start[None, :]),
        "auto",
        budget=budget or default_budget(problem.space.dimension),
        seed=seed,
    )
    return np.asarray(found[0].x, dtype=float), float(found[0].evaluations)
