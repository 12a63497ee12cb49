"""What else would have to be measured to open the flat directions, and how well each parameter would then be known."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations as choices
from typing import Any

import numpy as np

from plantfit.errors import ModelError
from plantfit.runtime import jit
from plantfit.trust.identify.combinations import Combinations, stacked
from plantfit.trust.verdict.words import number, some

import jax
import jax.numpy as jnp

RANK = 1e-7  # of the largest singular value of rows of length 1
SETS = 3000  # of measurements that are compared at most


@dataclass(frozen=True)
class Measurement:
    """An extra measurement: `function` of named parameters to one number or several, known to `sd` (one, or one for
    each)."""

    name: str
    function: Callable[[Mapping[str, Any]], Any]
    sd: float | Sequence[float]


@dataclass(frozen=True)
class Opening:
    """What the record with `measurements` beside it determines: directions opened, standard errors (d,), inf where
    still open."""

    names: tuple[str, ...]
    measurements: tuple[str, ...]
    opened: int
    still_open: int
    standard_error: np.ndarray

    @property
    def determined(self) -> tuple[str, ...]:
        return tuple(n for n, e in zip(self.names, self.standard_error, strict=True) if np.isfinite(e))

    @property
    def sentence(self) -> str:
        what, verb = some(self.measurements, most=8), "open" if len(self.measurements) > 1 else "opens"
        if not self.opened:
            return (
                f"{what}: {verb} nothing; what this tells about the "
                "parameters follows from what the record determines already."
            )
        gain = f"{what}: {verb} {self.opened} of {self.opened + self.still_open} flat directions"
        errors = [
            f"{n} to ±{number(e)}" for n, e in zip(self.names, self.standard_error, strict=True) if np.isfinite(e)
        ]
        if not errors:
            return f"{gain}, but no parameter alone is determined yet."
        if self.still_open:
            return f"{gain}; determined {'are' if len(errors) > 1 else 'is'} then {', '.join(errors)}."
        return f"{gain}, so that all parameters are determined ({', '.join(errors)}; standard errors)."


@dataclass(frozen=True)
class Openings:
    """`alone`: each measurement by itself; `together`: the best smallest set that opens everything, or None."""

    names: tuple[str, ...]
    record: Opening
    alone: tuple[Opening, ...]
    together: Opening | None

    @property
    def sentences(self) -> list[str]:
        last = (
            "No set of these measurements opens every flat direction."
            if self.together is None
            else self.together.sentence
        )
        return [o.sentence for o in self.alone] + ([last] if self.record.still_open else [])

    def table(self) -> dict[str, Any]:
        """A table for a report: a row for each measurement, a column of standard errors for each parameter."""
        rows = [self.record, *self.alone, *([self.together] if self.together else [])]
        body = [
            [" + ".join(o.measurements) or "the record alone", str(o.opened), *map(_error, o.standard_error)]
            for o in rows
        ]
        return {
            "caption": "Standard errors with an extra measurement",
            "columns": ["Extra measurement", "Opened", *self.names],
            "rows": body,
            "note": "Opened: flat directions that the measurement opens. Errors are in the parameters' own units.",
        }


def _error(value: float) -> str:
    return number(value) if np.isfinite(value) else "open"


def openings(
    found: Combinations, covariance: np.ndarray, point: np.ndarray, candidates: Sequence[Measurement]
) -> Openings:
    """What each candidate measurement, and the best set of them, adds to a record at the parameters `point` (d,).

    `covariance` (rank, rank) is that of the combinations `found`. Measurements are linearised at the point, independent
    of the record and of each other. A parameter is determined when its axis lies in the span of all gradients. Of the
    smallest sets that open everything the one with the least sum of squared relative errors is chosen. Raises
    ModelError for a covariance or a standard deviation that cannot be.
    """
    covariance, point = np.asarray(covariance, dtype=float), np.asarray(point, dtype=float)
    if covariance.shape != (found.rank, found.rank) or np.any(np.linalg.eigvalsh(covariance) <= 0):
        wanted = f"a positive definite ({found.rank}, {found.rank})"
        raise ModelError(
            f"The covariance of the {found.rank} combinations has shape {covariance.shape}; give {wanted}."
        )
    width = found.upper - found.lower
    record = np.linalg.solve(np.linalg.cholesky(covariance), found.jacobian(point)) * width
    extra = [_rows(m, found.names, point) * width for m in candidates]

    def opening(chosen: Sequence[int]) -> Opening:
        rank, errors = _errors(np.vstack([record, *(extra[i] for i in chosen)]))
        names = tuple(candidates[i].name for i in chosen)
        return Opening(found.names, names, rank - found.rank, len(width) - rank, errors * width)

    plain = opening(())
    return Openings(
        found.names,
        plain,
        tuple(opening((i,)) for i in range(len(candidates))),
        _best(plain, opening, len(candidates), point),
    )


def _best(plain: Opening, opening: Callable[[Sequence[int]], Opening], count: int, point: np.ndarray) -> Opening | None:
    tried, size_of = 0, np.maximum(np.abs(point), 1e-300)
    if not plain.still_open:
        return None
    for size in range(1, count + 1):
        full: list[Opening] = []
        for chosen in choices(range(count), size):
            tried += 1
            made = opening(chosen)
            if not made.still_open:
                full.append(made)
            if tried > SETS:
                break
        if full or tried > SETS:
            return min(full, key=lambda o: float(np.sum((o.standard_error / size_of) ** 2))) if full else None
    return None


def _rows(m: Measurement, names: Sequence[str], point: np.ndarray) -> np.ndarray:
    """Gradients (q, d) of a measurement in its standard deviations."""

    def listed(p: Mapping[str, Any]) -> Any:
        made = m.function(p)
        return made if isinstance(made, (Mapping, list, tuple)) else list(jnp.atleast_1d(made))

    gradient = np.asarray(jit(jax.jacfwd(stacked(listed, names)))(jnp.asarray(point)))
    sd = (
        np.broadcast_to(np.asarray(m.sd, dtype=float), len(gradient))
        if np.size(m.sd) in (1, len(gradient))
        else np.zeros(1)
    )
    if np.any(sd <= 0) or not np.all(np.isfinite(sd)):
        raise ModelError(
            f"Measurement {m.name!r}: sd is {m.sd}; give a standard deviation above 0, one or {len(gradient)}."
        )
    if not np.all(np.isfinite(gradient)):
        raise ModelError(
            f"Measurement {m.name!r} has no finite derivative at "
            f"{dict(zip(names, point.tolist(), strict=True))}; check its function."
        )
    return gradient / sd[:, None]


def _errors(rows: np.ndarray) -> tuple[int, np.ndarray]:
    """Rank of gradients (q, d) and standard errors (d,), inf for an axis outside of their span."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    _, singular, axes = np.linalg.svd(rows / np.maximum(length, 1e-300))
    rank = int(np.sum(singular > RANK * max(singular[0], 1e-300)))
    span = axes[:rank]
    # from the triangle and not from the normal equations, which would square the condition
    spread = np.linalg.lstsq(np.asarray(np.linalg.qr(rows @ span.T, mode="r")).T, span)[0]
    outside = np.linalg.norm(np.eye(rows.shape[1]) - span.T @ span, axis=0)
    return rank, np.where(outside < 1e-5, np.linalg.norm(spread, axis=0), np.inf)
