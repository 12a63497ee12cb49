"""Base parameters: the combinations of a linear model's parameters that a record determines."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import qr

from plantfit.errors import ModelError
from plantfit.trust.identify.formulas import sum_text
from plantfit.trust.verdict.words import some

TOLERANCE = 1e-8  # of the largest singular value of the normed columns: below it only rounding is left


@dataclass(frozen=True)
class BaseParameters:
    """What k parameters x of a regression W x are worth: W x = W[:, columns] (regrouping x) for every x.

    `regrouping` (rank, k); `texts` its rows as formulas; `columns` the columns kept, by number; `unseen` the
    parameters that the regression does not depend on; `singular_values` (k,) and `condition` of the normed columns.
    """

    names: tuple[str, ...]
    rank: int
    columns: tuple[int, ...]
    regrouping: np.ndarray
    texts: tuple[str, ...]
    unseen: tuple[str, ...]
    singular_values: np.ndarray
    condition: float

    @property
    def sentence(self) -> str:
        k = len(self.names)
        if self.rank == k:
            return f"All {k} parameters are determined: {some(self.names, most=12)}."
        alone = f" {some(self.unseen)} {'has' if len(self.unseen) == 1 else 'have'} no effect." if self.unseen else ""
        are = "combination of the" if self.rank == 1 else "combinations of the"
        return (
            f"{self.rank} {are} {k} parameters {'is' if self.rank == 1 else 'are'} determined: "
            f"{', '.join(self.texts)}.{alone}"
        )


def base_parameters(
    regressor: Any, names: Sequence[str], constants: Mapping[str, float] | None = None, tolerance: float = TOLERANCE
) -> BaseParameters:
    """Base parameters of a regressor (N, k), or of its triangle (k, k), with parameters `names`.

    The rank is that of the normed columns by singular values; the first independent columns in the order given are
    kept and the others regrouped into them (Gautier, J. Robotic Systems 8 (1991) 485, eqs. 20 to 27). Coefficients are
    written as products of `constants` where they are some. `tolerance` is relative to the largest singular value:
    raise it to the relative noise of the columns where a dependence holds only up to noise.
    Raises ModelError for shapes that do not fit, or a regressor without finite values.
    """
    w, names = np.asarray(regressor, dtype=float), tuple(names)
    if w.ndim != 2 or w.shape[1] != len(names) or w.shape[0] == 0:
        raise ModelError(
            f"The regressor has shape {w.shape} for {len(names)} "
            f"parameters; give (N, {len(names)}) with at least one row."
        )
    bad = np.argwhere(~np.isfinite(w))
    if len(bad):
        raise ModelError(
            f"The regressor has a missing value at row {bad[0][0]}, column {names[bad[0][1]]!r}; leave that row out."
        )
    if len(w) > w.shape[1]:
        w = np.asarray(np.linalg.qr(w, mode="r"))
    norms = np.linalg.norm(w, axis=0)
    seen = np.flatnonzero(norms > 0.0)
    normed = w[:, seen] / norms[seen]
    singular = np.linalg.svd(normed, compute_uv=False) if len(seen) else np.zeros(0)
    rank = int(np.sum(singular > tolerance * singular[0])) if len(seen) else 0
    kept = _first_independent(normed, rank, tolerance)
    share = np.linalg.lstsq(normed[:, kept], normed)[0] if rank else np.zeros((0, len(seen)))
    condition = float(singular[0] / singular[rank - 1]) if rank else 1.0
    share[np.abs(share) < max(10.0 * tolerance * condition**0.5, 1e-9)] = 0.0  # rounding, not a dependence
    share[:, kept] = np.eye(rank)
    regrouping = np.zeros((rank, len(names)))
    regrouping[:, seen] = share * norms[seen] / norms[seen[kept]][:, None]
    columns = tuple(int(c) for c in seen[kept])
    texts = tuple(
        sum_text([(1.0, names[lead])] + [(c, names[j]) for j, c in enumerate(row) if c and j != lead], constants or {})
        for lead, row in zip(columns, regrouping, strict=True)
    )
    unseen = tuple(n for j, n in enumerate(names) if norms[j] == 0.0)
    values = np.concatenate([singular, np.zeros(len(names) - len(singular))])
    return BaseParameters(names, rank, columns, regrouping, texts, unseen, values, condition)


def _first_independent(normed: np.ndarray, rank: int, tolerance: float) -> np.ndarray:
    """Numbers (rank,) of the first columns that are not sums of those before; by pivots where that is not clear."""
    kept: list[int] = []
    basis = np.zeros((len(normed), 0))
    for j in range(normed.shape[1]):
        left = normed[:, j] - basis @ (basis.T @ normed[:, j])
        left -= basis @ (basis.T @ left)
        size = float(np.linalg.norm(left))
        if size > tolerance * normed.shape[1] ** 0.5:
            kept.append(j)
            basis = np.column_stack([basis, left / size])
    if len(kept) != rank:
        pivots = qr(normed, pivoting=True)[-1]
        kept = sorted(int(j) for j in pivots[:rank])
    return np.array(kept, dtype=int)
