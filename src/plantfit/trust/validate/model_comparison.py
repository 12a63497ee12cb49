"""Models of the same recordings side by side: parameters, fit, information criteria, error on recordings left out."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.problem.measure.long_run import inflation
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.covariance import effective_parameters
from plantfit.trust.intervals.linearised import residual_blocks
from plantfit.trust.verdict.words import number

NEAR = 2.0  # difference of a criterion up to which a model has as much support (Burnham and Anderson 2002, section 2.6)


@dataclass(frozen=True)
class Candidate:
    """One model: free and effective parameters, RMS of the scaled residuals, criteria as differences to the least of all.

    `left_out` is the RMS of the scaled residuals over recordings that the fit had not seen, None where no such prediction exists.
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
    """Candidates in the order given; `samples` residuals, worth `independent` of them because neighbours are correlated."""

    candidates: tuple[Candidate, ...]
    samples: int
    independent: float

    def best(self, criterion: str) -> Candidate:
        """The candidate with the least "aic", "aicc", "bic", "rms" or "left_out"."""
        known = [c for c in self.candidates if getattr(c, criterion) is not None]
        if not known:
            raise ModelError(f"No candidate has {criterion!r}; give left_out to compare_models.")
        return min(known, key=lambda c: getattr(c, criterion))

    @property
    def sentences(self) -> list[str]:
        """Which model each criterion chooses, and what the samples are worth."""
        worth = f"{self.samples} residuals count as {self.independent:.0f} independent ones" if self.independent < self.samples else ""
        said = [f"AICc chooses {self.best('aicc').name}, BIC {self.best('bic').name}{f' ({worth})' if worth else ''}."]
        if any(c.left_out is not None for c in self.candidates):
            best, blind = self.best("left_out"), [c.name for c in self.candidates if c.left_out is None]
            alone = f"; {', '.join(blind)}: cannot predict a recording without having seen it" if blind else ""
            said.append(
                f"Recordings left out are predicted best by {best.name}, with an RMS error of {number(best.left_out or 0.0)}{alone}."
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
        note = f"Criteria as differences to the best. {self.samples} residuals, worth {self.independent:.0f} independent ones."
        return {"caption": "Models compared", "columns": columns, "rows": rows, "note": note}


def compare_models(answers: Mapping[str, tuple[Problem, np.ndarray]], left_out: Mapping[str, float] | None = None) -> ModelComparison:
    """Candidates from problems on the same data and their answers z (d,); `left_out` RMS errors by name, where there are any.

    With K effective parameters and one for the variance, n residuals of mean square s^2 and the factor c by which correlation
    from sample to sample inflates the variance of a mean, in the candidate that fits best (so that all have the same):

        AIC = n ln(s^2)/c + 2 K,   AICc = AIC + 2 K (K + 1)/(n/c - K - 1),   BIC = n ln(s^2)/c + K ln(n/c)        (1)

    Burnham and Anderson, Model Selection and Multimodel Inference, 2nd ed. 2002, sections 2.5 and 6.4.1; smoothed tables count
    by their effective entries (Hastie, Tibshirani and Friedman, Elements of Statistical Learning, 2nd ed., section 7.6). Raises
    ModelError for candidates whose data differ.
    """
    data = {name: _residuals(problem, z) for name, (problem, z) in answers.items()}
    sizes = {name: (len(r), tuple(problem.scales.values())) for (name, (problem, _)), r in zip(answers.items(), data.values(), strict=True)}
    if len(set(sizes.values())) != 1:
        raise ModelError(f"compare_models: the candidates have (residuals, scales) {sizes}; fit all of them to the same data and scales.")
    richest = min(data, key=lambda name: float(np.sum(data[name] ** 2)))
    n, factor = len(data[richest]), _inflation(answers[richest][0], data[richest])
    made = {}
    for name, (problem, z) in answers.items():
        square, k = float(np.mean(data[name] ** 2)), _effective(problem, z)
        fit, count, rest = n * np.log(square) / factor, k + 1.0, n / factor - k - 2.0
        aic = fit + 2.0 * count
        aicc = aic + 2.0 * count * (count + 1.0) / rest if rest > 0 else float("inf")
        made[name] = (problem.space.dimension, k, np.sqrt(square), aic, aicc, fit + count * np.log(n / factor))
    least = np.min([row[3:] for row in made.values()], axis=0)
    left = left_out or {}
    candidates = [
        Candidate(name, free, float(k), float(rms), float(aic - least[0]), float(aicc - least[1]), float(bic - least[2]), left.get(name))
        for name, (free, k, rms, aic, aicc, bic) in made.items()
    ]
    return ModelComparison(tuple(candidates), n, n / factor)


def _residuals(problem: Problem, z: np.ndarray) -> np.ndarray:
    return np.asarray(problem.residuals(z))


def _inflation(problem: Problem, residuals: np.ndarray) -> float:
    squares = [float(np.sum(residuals[b.rows] ** 2)) for b in residual_blocks(problem)]
    factors = [inflation(residuals[b.rows], b.index) for b in residual_blocks(problem)]
    return float(np.dot(squares, factors) / max(np.sum(squares), 1e-300))


def _effective(problem: Problem, z: np.ndarray) -> float:
    """Effective number of free parameters at z."""
    residuals, jacobian = problem.unsmoothed.residuals_and_jacobian(z)
    variance = max(float(np.mean(residuals**2)), 1e-300)
    smoothing = np.zeros((len(z), len(z))) if problem.smoothing is None else problem.smoothing.matrix
    return float(np.sum(effective_parameters(jacobian, residual_blocks(problem), smoothing, variance)))
