"""An estimate with its covariance."""

from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtri

LEVEL = 0.95


@dataclass(frozen=True)
class Estimate:
    """Values (k,) with covariance (k, k), in the units of the parameters `names`.

    `influence` (n, k), where known, is what the error of every sample adds to every value, at sample numbers `index`
    (n,): two estimates from the same samples are compared by it. `residuals` (n, m) are those of the whitened rows,
    `order` the order of the whitening filter, `iterations` how often the instruments were made anew. `degrees` (k,),
    where known, is on how many independent errors the variance of each value rests. The covariance is widened for few
    of them: 1.96 standard errors are the 95 % interval of Student's t with so many degrees of freedom.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    influence: np.ndarray | None = field(default=None, repr=False)
    index: np.ndarray | None = field(default=None, repr=False)
    residuals: np.ndarray | None = field(default=None, repr=False)
    order: int = 0
    iterations: int = 0
    degrees: np.ndarray | None = field(default=None, repr=False)

    @property
    def named(self) -> dict[str, float]:
        """Values by name."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    @property
    def standard_error(self) -> np.ndarray:
        """Standard errors (k,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def low(self) -> np.ndarray:
        """Lower ends (k,) of the 95 % intervals."""
        return self.values - float(-ndtri(0.5 * (1.0 - LEVEL))) * self.standard_error

    @property
    def high(self) -> np.ndarray:
        """Upper ends (k,) of the 95 % intervals."""
        return self.values + float(-ndtri(0.5 * (1.0 - LEVEL))) * self.standard_error
