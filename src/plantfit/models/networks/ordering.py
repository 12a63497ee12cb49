"""Which equation gives which unknown, and in which order: a perfect matching, and the strongly connected blocks of what
is left.

(I. S. Duff, J. K. Reid, An implementation of Tarjan's algorithm for the block triangularization of a matrix, ACM Trans.
Math. Softw. 4, 1978, 137-147; A. L. Dulmage, N. S. Mendelsohn, Coverings of bipartite graphs, Can. J. Math. 10, 1958,
517-534, for what does not match.)
"""

from collections.abc import Sequence
from dataclasses import dataclass

from plantfit.models.networks.laws import Equation


@dataclass(frozen=True)
class Unmatched(Exception):
    """`parts` whose equations fix their unknowns more than once; the others leave something open."""

    parts: tuple[str, ...]


def blocks(equations: Sequence[Equation], unknowns: Sequence[str]) -> list[tuple[list[Equation], list[str]]]:
    """Equations with the unknowns that they give, block by block: each block needs only those before it. Raises
    Unmatched."""
    wanted = set(unknowns)
    edges = [_unknowns(e, wanted) for e in equations]
    own = _matched(equations, edges, wanted)
    giver = {v: k for k, v in own.items()}
    needs = {
        k: [giver[v] for v in _needed(equations[k], edges[k], wanted) if giver[v] != k] for k in range(len(equations))
    }
    return [([equations[k] for k in block], [own[k] for k in block]) for block in _components(needs)]


def _unknowns(equation: Equation, wanted: set[str]) -> list[str]:
    """What an equation can give: of a curve only the quantity through it."""
    return [equation.gives] if equation.curve else [v for v in equation.terms if v in wanted]


def _needed(equation: Equation, edges: list[str], wanted: set[str]) -> list[str]:
    return [*edges, *([equation.across] if equation.across in wanted else [])]


def _matched(equations: Sequence[Equation], edges: list[list[str]], wanted: set[str]) -> dict[int, str]:
    """Each equation's own unknown, by augmenting paths. Raises Unmatched."""
    giver: dict[str, int] = {}

    def augment(k: int, seen: set[str]) -> bool:
        for v in edges[k]:
            if v in seen:
                continue
            seen.add(v)
            if v not in giver or augment(giver[v], seen):
                giver[v] = k
                return True
        return False

    for k in range(len(equations)):
        seen: set[str] = set()
        if not augment(k, seen):
            crowd = [k, *(giver[v] for v in seen)]  # more equations than unknowns
            raise Unmatched(
                tuple(dict.fromkeys(p for e in crowd for p in equations[e].parts if len(equations[e].parts) == 1))
            )
    if len(giver) < len(wanted):
        left = wanted - set(giver)
        raise Unmatched(tuple(dict.fromkeys(p for e in equations if left & set(e.terms) for p in e.parts)))
    return {k: v for v, k in giver.items()}


def _components(needs: dict[int, list[int]]) -> list[list[int]]:
    """Strongly connected components, each after those that it needs (Tarjan)."""
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    stack: list[int] = []
    found: list[list[int]] = []

    def visit(k: int) -> None:
        index[k] = low[k] = len(index)
        stack.append(k)
        for other in needs[k]:
            if other not in index:
                visit(other)
                low[k] = min(low[k], low[other])
            elif other in stack:
                low[k] = min(low[k], index[other])
        if low[k] == index[k]:
            at = stack.index(k)
            found.append(stack[at:])
            del stack[at:]

    for k in needs:
        if k not in index:
            visit(k)
    return found
