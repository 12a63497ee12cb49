"""Whether an estimate of coefficients can be those of a real body."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chi2

from plantfit.problem.evaluate.compress import Compressed
from plantfit.trust.identify.combinations import Base
from plantfit.trust.rigid_body.constrained_optimum import Optimum, constrained_optimum
from plantfit.trust.rigid_body.feasibility import Constraints
from plantfit.trust.verdict.words import number, some

CLOSE = 1e-6  # standard deviations that count as none


@dataclass(frozen=True)
class Possible:
    """The possible parameters nearest to an estimate: its squared distance by the covariance, and how often chance
    alone goes further from a truth there (chi-squared with k degrees of freedom)."""

    nearest: Optimum
    distance: float
    p_value: float

    @property
    def sentence(self) -> str:
        at = ", ".join(f"{n} = {number(v)}" for n, v in self.nearest.values.items())
        if self.distance < CLOSE:
            return f"The estimate is physically possible, for example with {at}."
        said = f"The estimate lies {number(self.distance)} standard deviations outside of what is physically possible"
        verdict = (
            "which chance explains"
            if self.p_value > 0.05
            else f"more than chance explains (p = {number(self.p_value)})"
        )
        return f"{said} ({some(self.nearest.active, most=6)}), {verdict}."


def nearest_possible(
    coefficients: Any,
    covariance: Any,
    base: Base,
    names: Sequence[str],
    lower: Any,
    upper: Any,
    constraints: Constraints | None = None,
) -> Possible:
    """The parameters inside box and constraints whose coefficients lie nearest to an estimate (k,) with covariance (k,
    k).

    Arguments as for `constrained_optimum`, which does the search. The p-value is conservative: near a bound the
    distance has fewer degrees of freedom.
    """
    estimate, spread = np.asarray(coefficients, dtype=float), np.asarray(covariance, dtype=float)
    scale = np.sqrt(np.diag(spread))
    factor = np.linalg.cholesky(spread / np.outer(scale, scale))
    whitening = np.asarray(np.linalg.qr(np.linalg.solve(factor, np.diag(1.0 / scale)), mode="r"))
    optimum = constrained_optimum(
        Compressed(whitening, whitening @ estimate, 0.0, 1), base, names, lower, upper, constraints
    )
    return Possible(optimum, optimum.rmse, float(chi2.sf(optimum.cost, len(estimate))))
