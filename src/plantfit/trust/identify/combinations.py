"""Which combinations of physical parameters a record determines, when its coefficients are functions of them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.runtime import jit
from plantfit.trust.identify.base_parameters import base_parameters
from plantfit.trust.identify.formulas import polynomial, polynomial_text
from plantfit.trust.verdict.words import some

import jax
import jax.numpy as jnp

RANK = 1e-9  # of the largest singular value of the scaled Jacobian
POINTS = 40  # of the box, at which the rank is asked

Base = Callable[[Mapping[str, Any]], Any]


def stacked(base: Base, names: Sequence[str]) -> Callable[[Any], Any]:
    """`base`, of named values, as a jax function of an array (d,); its numbers (k,) may come as an array, a list or
    a mapping."""

    def function(point: Any) -> Any:
        found = base({n: point[i] for i, n in enumerate(names)})
        return jnp.stack(
            [jnp.asarray(v, dtype=float) for v in (found.values() if isinstance(found, Mapping) else found)]
        )

    return function


@dataclass(frozen=True)
class Combinations:
    """Functions of d parameters that a record determines, all others being open.

    `function` maps (d,) to the rank determined combinations, `jacobian` to (rank, d), both of plain arrays. `labels`
    name them, `texts` say them as formulas where they are polynomials. `rank_at` (points,) is the rank at random points
    of the box.
    """

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    rank: int
    labels: tuple[str, ...]
    texts: tuple[str, ...]
    rank_at: np.ndarray
    function: Callable[[np.ndarray], np.ndarray]
    jacobian: Callable[[np.ndarray], np.ndarray]

    @property
    def open(self) -> int:
        """Number of directions along which the parameters can move unseen."""
        return len(self.names) - self.rank

    @property
    def sentence(self) -> str:
        d, r = len(self.names), self.rank
        if not self.open:
            return f"All {d} parameters are determined: {some(self.names, most=12)}."
        others = "the other direction is" if self.open == 1 else f"the other {self.open} directions are"
        what = (
            f"{r} combination{'s' if r > 1 else ''} of the {d} parameters {'are' if r > 1 else 'is'} determined: "
            f"{', '.join(self.texts)}"
        )
        return f"{what}; {others} flat."


def combinations(
    base: Base,
    names: Sequence[str],
    lower: Any,
    upper: Any,
    coefficients: Sequence[str] | None = None,
    regressor: Any = None,
    constants: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Combinations:
    """The combinations of parameters in the box [lower, upper] (d,) that a record tells, and their formulas.

    `base` maps named parameters to k coefficients (jax-traceable), called `coefficients`; the record is `regressor`
    (N, k) or its triangle, without it all coefficients count as known. The rank is that of the Jacobian at random
    points of the box, columns scaled by the box and rows by their length; combinations with the shortest formulas are
    kept. Raises ModelError for shapes that do not fit and for a map without finite values in the box.
    """
    names, low, high = tuple(names), np.asarray(lower, dtype=float), np.asarray(upper, dtype=float)
    if low.shape != (len(names),) or high.shape != low.shape or not np.all(low < high):
        raise ModelError(
            f"The box has shapes {low.shape} and {high.shape} for {len(names)} "
            "parameters; give a lower below an upper bound for each."
        )
    vector = stacked(base, names)
    points = np.random.default_rng(seed).uniform(low, high, (POINTS, len(names)))
    slopes = np.asarray(jit(jax.vmap(jax.jacfwd(vector)))(points))
    if not np.all(np.isfinite(slopes)):
        raise ModelError(
            "The map from parameters to coefficients is not finite everywhere in the box; narrow the bounds."
        )
    k = slopes.shape[1]
    labels = tuple(coefficients or (f"b{i + 1}" for i in range(k)))
    if len(labels) != k:
        raise ModelError(f"The map gives {k} coefficients, but {len(labels)} names are given: {list(labels)}.")
    mix, mixed_labels = np.eye(k), labels
    if regressor is not None:
        found = base_parameters(regressor, labels, constants)
        mix = found.regrouping
        mixed_labels = tuple(
            labels[c] if np.sum(row != 0) == 1 else f"J{i + 1}"
            for i, (c, row) in enumerate(zip(found.columns, mix, strict=True))
        )
    formulas = _formulas(vector, mix, names, low, high, constants or {})
    scaled = np.einsum("rk,pkd->prd", mix, slopes) * (high - low)
    scaled = scaled / np.maximum(np.max(np.linalg.norm(scaled, axis=2), axis=0), 1e-300)[None, :, None]
    ranks = np.array([_rank(j) for j in scaled])
    kept = _independent(scaled[int(np.argmax(ranks))], sorted(range(len(mix)), key=lambda i: (len(formulas[i]), i)))
    return _chosen(
        vector, mix[kept], names, low, high, [mixed_labels[i] for i in kept], [formulas[i] for i in kept], ranks
    )


def _chosen(
    vector: Any, mix: np.ndarray, names: Any, low: Any, high: Any, labels: list[str], formulas: list[str], ranks: Any
) -> Combinations:
    function = jit(lambda point: jnp.asarray(mix) @ vector(point))
    jacobian = jit(jax.jacfwd(function))
    texts = tuple(f"{label} = {text}" if text else label for label, text in zip(labels, formulas, strict=True))
    return Combinations(
        names, low, high, len(mix), tuple(labels), texts, ranks,
        lambda p: np.asarray(function(jnp.asarray(p, dtype=float))),
        lambda p: np.asarray(jacobian(jnp.asarray(p, dtype=float))),
    )  # fmt: skip


def _formulas(
    vector: Any,
    mix: np.ndarray,
    names: tuple[str, ...],
    low: np.ndarray,
    high: np.ndarray,
    constants: Mapping[str, float],
) -> list[str]:
    """The combinations `mix` (r, k) of the coefficients as polynomials, "" for those that are none."""
    many = jit(jax.vmap(vector))
    terms = [polynomial(lambda p, row=row: np.asarray(many(p)) @ row, low, high) for row in mix]
    return ["" if t is None else polynomial_text(t, names, constants) for t in terms]


def _rank(matrix: np.ndarray) -> int:
    singular = np.linalg.svd(matrix, compute_uv=False)
    return int(np.sum(singular > RANK * singular[0])) if len(singular) and singular[0] > 0 else 0


def _independent(matrix: np.ndarray, order: Sequence[int]) -> list[int]:
    """The first rows in `order` that are not sums of those before, sorted."""
    kept: list[int] = []
    for i in order:
        if _rank(matrix[[*kept, i]]) == len(kept) + 1:
            kept.append(i)
    return sorted(kept)
