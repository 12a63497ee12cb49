"""Numbers and functions written as formulas: products of known constants, sums, polynomials found by evaluating
them."""

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from itertools import combinations_with_replacement, product

import numpy as np

POWERS = (-2, -1, 0, 1, 2)
FACTORS = (Fraction(1), Fraction(2), Fraction(1, 2), Fraction(3), Fraction(1, 3), Fraction(4), Fraction(1, 4))
DEGREE = 4  # of the polynomials that are tried
MONOMIALS = 1000  # at most

Polynomial = dict[tuple[int, ...], float]  # exponents of the variables -> coefficient


def factor_text(value: float, constants: Mapping[str, float], tolerance: float = 1e-7) -> str:
    """A positive number as the simplest product of powers of constants, `l1^2`; `1` is "", and what is not recognised a
    plain number.

    Tried are up to three constants with exponents from -2 to 2 and the factors 1 to 4 and their inverses.
    """
    best: tuple[int, str] | None = None
    for factor in FACTORS:
        for powers in product(POWERS, repeat=len(constants)) if len(constants) <= 4 else _few_powers(len(constants)):
            cost = sum(map(abs, powers)) + 2 * sum(p != 0 for p in powers) + (3 if factor != 1 else 0)
            if best is not None and cost >= best[0]:
                continue
            found = float(factor) * float(np.prod([c**p for c, p in zip(constants.values(), powers, strict=True) if p]))
            if abs(found - value) <= tolerance * abs(value):
                best = cost, _product(factor, dict(zip(constants, powers, strict=True)))
    return f"{value:.6g}" if best is None else best[1]


def _few_powers(n: int) -> list[tuple[int, ...]]:
    """Exponents of n constants of which at most two take part."""
    found = {tuple([0] * n)}
    for i, j in combinations_with_replacement(range(n), 2):
        for a, b in product(POWERS, repeat=2):
            row = [0] * n
            row[i], row[j] = a, b
            found.add(tuple(row))
    return sorted(found)


def _product(factor: Fraction, powers: Mapping[str, int]) -> str:
    up = [_power(n, p) for n, p in powers.items() if p > 0]
    down = [_power(n, -p) for n, p in powers.items() if p < 0]
    if factor.numerator != 1:
        up.insert(0, str(factor.numerator))
    if factor.denominator != 1:
        down.insert(0, str(factor.denominator))
    return "*".join(up or (["1"] if down else [])) + "".join(f"/{d}" for d in down)


def _power(name: str, exponent: int) -> str:
    return name if exponent == 1 else f"{name}^{exponent}"


def sum_text(terms: Sequence[tuple[float, str]], constants: Mapping[str, float]) -> str:
    """`I1 + l1^2*m2 - 0.5*c` of terms (coefficient, name)."""
    text = ""
    for coefficient, name in terms:
        factor = factor_text(abs(coefficient), constants)
        body = "*".join(filter(None, [factor, name])) or "1"
        sign = "-" if coefficient < 0 else "+"
        text += f" {sign} {body}" if text else ("-" if sign == "-" else "") + body
    return text or "0"


def polynomial(
    function: Callable[[np.ndarray], np.ndarray], lower: np.ndarray, upper: np.ndarray, seed: int = 0
) -> Polynomial | None:
    """The polynomial that a function of points (n, d) is, or None where it is none of degree 4 (3, 2, 1 with many
    variables).

    Coefficients by least squares at random points of the cube around zero that holds the box [lower, upper];
    those that are zero to rounding are dropped, and the rest must give the function at fresh points of the box.
    """
    d, rng = len(lower), np.random.default_rng(seed)
    scale = np.maximum(np.maximum(np.abs(lower), np.abs(upper)), 1e-300)
    exponents = _exponents(d)
    points = rng.uniform(-1.0, 1.0, (3 * len(exponents) + 20, d))
    values = np.asarray(function(points * scale), dtype=float)
    if not np.all(np.isfinite(values)) or not np.any(values):
        return None
    matrix = np.prod(points[:, None, :] ** exponents[None], axis=2)
    found = np.linalg.lstsq(matrix, values)[0]
    found = np.where(np.abs(found) > 1e-9 * np.max(np.abs(found)), found, 0.0)
    used = np.flatnonzero(found)
    found[used] = np.linalg.lstsq(matrix[:, used], values)[0]  # without the others these are good to rounding
    fresh = rng.uniform(lower, upper, (30, d))
    expected = np.asarray(function(fresh), dtype=float)
    got = np.prod((fresh / scale)[:, None, :] ** exponents[None, used], axis=2) @ found[used]
    if not np.allclose(got, expected, rtol=1e-8, atol=1e-10 * np.max(np.abs(expected))):
        return None
    return {tuple(int(e) for e in exponents[i]): float(found[i] / np.prod(scale ** exponents[i])) for i in used}


def _exponents(d: int) -> np.ndarray:
    """Exponents (q, d) of the monomials up to the highest degree that keeps their number small; constant first."""
    rows = [np.zeros(d, int)]
    for degree in range(1, DEGREE + 1):
        more = [np.bincount(c, minlength=d) for c in combinations_with_replacement(range(d), degree)]
        if len(rows) + len(more) > MONOMIALS and degree > 1:
            break
        rows += more
    return np.array(rows)


def polynomial_text(terms: Polynomial, names: Sequence[str], constants: Mapping[str, float]) -> str:
    """`m1*lc1^2 + l1^2*m2 + I1`: monomials in the order of the variables, those of lower degree last."""
    order = sorted(terms, key=lambda e: (-sum(e), tuple(-x for x in e)))
    return sum_text(
        [(terms[e], "*".join(_power(n, k) for n, k in zip(names, e, strict=True) if k)) for e in order], constants
    )
