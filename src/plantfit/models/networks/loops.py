"""Blocks of equations that need one another, solved exactly: fraction-free elimination over polynomials of the
parameters.

(E. H. Bareiss, Sylvester's identity and multistep integer-preserving Gaussian elimination, Math. Comp. 22, 1968,
565-578.)
"""

from collections.abc import Sequence

from plantfit.models.networks.laws import Equation, Terms
from plantfit.models.networks.polynomials import ONE, Polynomial, gcd_of

Solved = tuple[str, Terms, Polynomial]  # an unknown is the sum of the terms over the polynomial


class Singular(Exception):
    """The equations of a block do not determine its unknowns."""


def solved(equations: Sequence[Equation], unknowns: Sequence[str]) -> list[Solved]:
    """Every unknown of a block by what is known, and by those before it in the list. Raises Singular."""
    laws = {e.gives: e for e in equations if e.gives in unknowns} if len(unknowns) > 1 else {}
    kept = [v for v in unknowns if v not in laws]
    rest = [_without_flows(dict(e.terms), laws) for e in equations if e.gives not in laws]
    inner = _eliminated(rest, kept)
    return [*inner, *(_scalar(laws[v].terms, v) for v in laws)]


def _without_flows(terms: Terms, laws: dict[str, Equation]) -> Terms:
    """An equation with the flows replaced by their laws, times what the laws divide by."""
    for flow in [v for v in terms if v in laws]:
        law = laws[flow].terms
        factor, by = terms.pop(flow), -law[flow]
        terms = {v: c * by for v, c in terms.items()}
        for v, c in law.items():
            if v != flow:
                terms[v] = terms.get(v, Polynomial()) + factor * c
    return {v: c for v, c in terms.items() if c}


def _scalar(terms: Terms, unknown: str) -> Solved:
    if unknown not in terms:
        raise Singular
    return _simplified(unknown, {v: -c for v, c in terms.items() if v != unknown}, terms[unknown])


def _eliminated(rows: list[Terms], unknowns: Sequence[str]) -> list[Solved]:
    if len(unknowns) == 1:
        return [_scalar(rows[0], unknowns[0])]
    knowns = list(dict.fromkeys(v for row in rows for v in row if v not in unknowns))
    columns = [*unknowns, *knowns]
    matrix = [[row.get(v, Polynomial()) for v in columns] for row in rows]
    n, previous = len(unknowns), ONE
    pivots: dict[int, int] = {}
    for _ in range(n):
        free = [
            (k, j) for k in range(n) if k not in pivots for j in range(n) if j not in pivots.values() and matrix[k][j]
        ]
        if not free:
            raise Singular
        k, j = min(free, key=lambda place: len(matrix[place[0]][place[1]].terms))
        pivot = matrix[k][j]
        for i in range(n):
            if i != k:
                factor = matrix[i][j]
                matrix[i] = [(pivot * a - factor * b).over(previous) for a, b in zip(matrix[i], matrix[k], strict=True)]
        pivots[k], previous = j, pivot
    return [
        _simplified(unknowns[j], {v: -matrix[k][n + i] for i, v in enumerate(knowns) if matrix[k][n + i]}, matrix[k][j])
        for k, j in sorted(pivots.items(), key=lambda p: p[1])
    ]


def _simplified(unknown: str, terms: Terms, over: Polynomial) -> Solved:
    """Without common factors, and with a positive denominator."""
    common = gcd_of([over, *terms.values()])
    if not common.is_one:
        over, terms = over.over(common), {v: c.over(common) for v, c in terms.items()}
    if all(c < 0 for c in over.terms.values()):
        over, terms = -over, {v: -c for v, c in terms.items()}
    return unknown, terms, over
