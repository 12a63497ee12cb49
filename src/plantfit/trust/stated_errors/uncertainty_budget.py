"""Uncertainty of a measured value from its sources: the budget table of the GUM (JCGM 100:2008), and by Monte Carlo
(JCGM 101:2008)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import scipy  # scipy.special is loaded at its first use

from plantfit.errors import RecordingError
from plantfit.units import equal, quotient

Shape = Literal["rectangular", "triangular", "normal", "u-shaped"]

# JCGM 100, 4.3.7 and 4.3.9; M3003
_DIVISORS = {"rectangular": np.sqrt(3.0), "triangular": np.sqrt(6.0), "u-shaped": np.sqrt(2.0)}
MANY = 1e9  # degrees of freedom that count as infinite


@dataclass(frozen=True)
class Source:
    """One thing that makes a value uncertain.

    `limit` (in `unit`): half width of the shape, for "normal" the standard uncertainty times `divisor`. `sensitivity`:
    by how much the result moves for a unit of it. `degrees_of_freedom` inf: the limit is certain.
    """

    name: str
    kind: Literal["A", "B"]
    limit: float
    divisor: float
    shape: Shape
    unit: str | None = None
    sensitivity: float = 1.0
    degrees_of_freedom: float = np.inf

    @property
    def standard(self) -> float:
        """Standard uncertainty in its own unit."""
        return self.limit / self.divisor

    @property
    def contribution(self) -> float:
        """Standard uncertainty that it gives the result."""
        return abs(self.sensitivity) * self.standard

    def draw(self, rng: np.random.Generator, n: int) -> np.ndarray:
        """Errors (n,) in its own unit; Student's t where the degrees of freedom are few (JCGM 101, 6.4.9.2)."""
        if self.shape == "normal":
            few = self.degrees_of_freedom < MANY
            return self.standard * (rng.standard_t(self.degrees_of_freedom, n) if few else rng.standard_normal(n))
        if self.shape == "rectangular":
            return rng.uniform(-self.limit, self.limit, n)
        if self.shape == "triangular":
            return self.limit * (rng.uniform(-0.5, 0.5, n) + rng.uniform(-0.5, 0.5, n))
        return self.limit * np.sin(rng.uniform(0.0, 2.0 * np.pi, n))


def type_a(name: str, readings: Any, unit: str | None = None, sensitivity: float = 1.0) -> Source:
    """From repeats (n,) of one quantity: the standard deviation of their mean, n - 1 degrees of freedom (JCGM 100, eq.
    5).

    Raises RecordingError for fewer than two repeats.
    """
    x = np.asarray(readings, dtype=float).ravel()
    x = x[np.isfinite(x)]
    if len(x) < 2:
        raise RecordingError(
            f"Source {name!r} has {len(x)} repeats; type A needs two at least: repeat the reading, or use type B."
        )
    return Source(
        name, "A", float(np.std(x, ddof=1) / np.sqrt(len(x))), 1.0, "normal", unit, sensitivity, float(len(x) - 1)
    )


def type_b(
    name: str,
    limit: float,
    unit: str | None = None,
    shape: Shape = "rectangular",
    *,
    k: float = 2.0,
    sensitivity: float = 1.0,
    degrees_of_freedom: float = np.inf,
) -> Source:
    """From a data sheet, a certificate or judgement: `limit` is the half width, for "normal" the expanded uncertainty
    with factor `k`.

    Raises RecordingError for a limit below 0 or an unknown shape.
    """
    if shape != "normal" and shape not in _DIVISORS:
        raise RecordingError(f"Source {name!r} has shape {shape!r}; use one of {[*_DIVISORS, 'normal']}.")
    for what, value, good in (
        ("limit", limit, limit >= 0),
        ("k", k, k > 0),
        ("degrees_of_freedom", degrees_of_freedom, degrees_of_freedom > 0),
    ):
        if not (good and not np.isnan(value)):
            raise RecordingError(
                f"Source {name!r} has {what} = {value}; give a number "
                f"{'of at least' if what == 'limit' else 'above'} 0."
            )
    divisor = k if shape == "normal" else float(_DIVISORS[shape])
    return Source(name, "B", float(limit), divisor, shape, unit, sensitivity, degrees_of_freedom)


@dataclass(frozen=True)
class Budget:
    """Sources of one result (`unit`), independent of one another."""

    sources: tuple[Source, ...]
    unit: str | None = None

    @property
    def combined(self) -> float:
        """Combined standard uncertainty: root of the sum of squared contributions (JCGM 100, eq. 10)."""
        return float(np.sqrt(sum(s.contribution**2 for s in self.sources)))

    @property
    def degrees_of_freedom(self) -> float:
        """Effective degrees of freedom by Welch and Satterthwaite (JCGM 100, eq. G.2b); inf when no source has few."""
        few = sum(s.contribution**4 / s.degrees_of_freedom for s in self.sources)
        return self.combined**4 / few if few > 0 else np.inf

    def coverage_factor(self, level: float = 0.95) -> float:
        """Student's t for the effective degrees of freedom, cut to a whole number (JCGM 100, G.4.1)."""
        nu = self.degrees_of_freedom
        return float(
            scipy.special.ndtri(0.5 + level / 2)
            if nu > MANY
            else scipy.special.stdtrit(max(1.0, np.floor(nu)), 0.5 + level / 2)
        )

    def expanded(self, k: float = 2.0) -> float:
        """Expanded uncertainty k times the combined one."""
        return k * self.combined

    def monte_carlo(self, draws: int = 200_000, seed: int = 0, level: float = 0.95) -> tuple[float, float]:
        """Half width of the symmetric interval that holds `level` of the drawn errors, and its own standard error
        (JCGM 101, 7.7)."""
        rng = np.random.default_rng(seed)
        errors = np.sort(np.abs(sum((s.sensitivity * s.draw(rng, draws) for s in self.sources), np.zeros(draws))))
        half, around = level * draws, np.sqrt(draws * level * (1.0 - level))
        low, high = (errors[int(np.clip(half + d, 0, draws - 1))] for d in (-around, around))
        return float(errors[int(half)]), float(0.5 * (high - low))

    def rows(self, k: float = 2.0) -> list[dict[str, Any]]:
        """One row for each source, JSON types: name, kind, shape, limit, unit, divisor, standard, sensitivity,
        contribution, expanded (k times it), share of the variance, degrees_of_freedom (None: infinite)."""
        total = max(self.combined**2, np.finfo(float).tiny)
        return [
            {
                "name": s.name, "kind": s.kind, "shape": s.shape, "limit": s.limit, "unit": s.unit,
                "divisor": s.divisor,
                "standard": s.standard, "sensitivity": s.sensitivity, "contribution": s.contribution,
                "expanded": k * s.contribution, "share": s.contribution**2 / total,
                "degrees_of_freedom": None if s.degrees_of_freedom > MANY else s.degrees_of_freedom,
            }
            for s in self.sources
        ]  # fmt: skip


def uncertainty_budget(sources: Sequence[Source], unit: str | None = None) -> Budget:
    """The budget of one result, in `unit` or that of the first source.

    Raises RecordingError without sources, for equal names, and for a source in another unit without a sensitivity.
    """
    names = [s.name for s in sources]
    if not names:
        raise RecordingError("An uncertainty budget needs at least one source; give some by type_a and type_b.")
    twice = [n for n in names if names.count(n) > 1]
    if twice:
        raise RecordingError(f"Source {twice[0]!r} is in the budget twice; give each source a name of its own.")
    unit = unit or sources[0].unit
    for s in sources:
        # a sensitivity of 1 is the default: that it is meant for mV in a budget in V is hardly so
        if s.sensitivity == 1.0 and unit and s.unit and not equal(s.unit, unit):
            how = f"write its limit in {unit}, or give its sensitivity in {quotient(unit, s.unit)}"
            raise RecordingError(f"Source {s.name!r} is in {s.unit} and the result in {unit}: {how}.")
    return Budget(tuple(sources), unit)
