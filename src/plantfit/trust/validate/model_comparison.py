"""Models of the same recordings side by side: parameters, fit, information criteria, error on recordings left out."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.linearised import residual_blocks
from plantfit.trust.verdict.words import number
from plantfit.trust.which_model.candidates import effective_count
from plantfit.trust.which_model.criteria import criteria, inflation_of


@dataclass(frozen=True)
class Candidate:
    """One model: free and effective parameters, RMS of the scaled residuals, criteria as differences to the least of
    all.

    `left_out` is the RMS of the scaled residuals over recordings that the fit had not seen, None where no such
    prediction exists.
    """

    name: str
    free: int
    effective: float
    rms: float
    aic: float
    aicc: float
    bic: float
    left_out: float | None = None


@dataclass(frozen=True)
class ModelComparison:
    """Candidates in the order given; `samples` residuals, worth `independent` of them because neighbours are
    correlated."""

    candidates: tuple[Candidate, ...]
    samples: int
    independent: float

    def best(self, criterion: str) -> Candidate:
        """The candidate with the least "aic", "aicc", "bic", "rms" or "left_out"."""
        known = [c for c in self.candidates if getattr(c, criterion) is not None]
        if not known:
            raise ModelError(f"No candidate has {criterion!r}; give left_out to by_criteria.")
        return min(known, key=lambda c: getattr(c, criterion))

    @property
    def sentences(self) -> list[str]:
        """Which model each criterion chooses, and what the samples are worth."""
        worth = (
            f"{self.samples} residuals count as {self.independent:.0f} independent ones"
            if self.independent < self.samples
            else ""
        )
        said = [f"AICc chooses {self.best('aicc').name}, BIC {self.best('bic').name}{f' ({worth})' if worth else ''}."]
        if any(c.left_out is not None for c in self.candidates):
            best, blind = self.best("left_out"), [c.name for c in self.candidates if c.left_out is None]
            alone = f"; {', '.join(blind)}: cannot predict a recording without having seen it" if blind else ""
            said.append(
                f"Recordings left out are predicted best by {best.name}, with an RMS error of "
                f"{number(best.left_out or 0.0)}{alone}."
            )
        return said

    def table(self, unit: str = "") -> dict[str, Any]:
        """A table for a report."""
        end = f" ({unit})" if unit else ""
        columns = ["Model", "Free", "Effective", f"RMS error{end}", "AIC", "AICc", "BIC", f"Left out{end}"]
        rows = [
            [c.name, str(c.free), f"{c.effective:.1f}", number(c.rms), *(f"{v:.1f}" for v in (c.aic, c.aicc, c.bic)),
             "cannot" if c.left_out is None else number(c.left_out)]
            for c in self.candidates
        ]  # fmt: skip
        note = (
            f"Criteria as differences to the best. {self.samples} "
            f"residuals, worth {self.independent:.0f} independent ones."
        )
        return {"caption": "Models compared", "columns": columns, "rows": rows, "note": note}


def by_criteria(
    answers: Mapping[str, tuple[Problem, np.ndarray]], left_out: Mapping[str, float] | None = None
) -> ModelComparison:
    """Candidates from problems on the same residuals and their answers z (d,); `left_out` RMS errors by name, where
    there are any.

    The criteria are those of `trust.which_model.criteria` (1). `plantfit.compare_models` says of finished answers which
    predicts better. Raises ModelError for candidates whose data differ.
    """
    data = {name: np.asarray(problem.residuals(z)) for name, (problem, z) in answers.items()}
    sizes = {
        name: (len(r), tuple(problem.scales.values()))
        for (name, (problem, _)), r in zip(answers.items(), data.values(), strict=True)
    }
    if len(set(sizes.values())) != 1:
        raise ModelError(
            "by_criteria: the candidates have (residuals, scales) "
            f"{sizes}; fit all of them to the same data and scales."
        )
    richest = min(data, key=lambda name: float(np.sum(data[name] ** 2)))
    blocks = residual_blocks(answers[richest][0])
    n, factor = len(data[richest]), inflation_of([data[richest][b.rows] for b in blocks], [b.index for b in blocks])
    made = {}
    for name, (problem, z) in answers.items():
        square, k = float(np.mean(data[name] ** 2)), effective_count(problem, z)
        made[name] = (problem.space.dimension, k, np.sqrt(square), *criteria(np.log(square), n, k, factor))
    least = np.min([row[3:] for row in made.values()], axis=0)
    left = left_out or {}
    candidates = [
        Candidate(
            name,
            free,
            float(k),
            float(rms),
            float(aic - least[0]),
            float(aicc - least[1]),
            float(bic - least[2]),
            left.get(name),
        )
        for name, (free, k, rms, aic, aicc, bic) in made.items()
    ]
    return ModelComparison(tuple(candidates), n, n / factor)
