"""How a number depends on the coordinates of a problem: not at all, as a polynomial of degree 1 in a set of them, or
otherwise."""

from collections.abc import Iterable
from functools import reduce
from typing import NamedTuple

MOST_PRODUCTS = 60  # pairs of sets that are told apart; beyond them the coordinates count as nonlinear


class Degree(NamedTuple):
    """Sets of coordinates as bits of integers.

    `seen`: those that the number depends on. `more`: those that it is not affine in, whatever the others are.
    `products`: pairs of disjoint sets; a coordinate of one may be multiplied by one of the other. For every set S of
    coordinates without one of `more` and without both sides of a product, the number is affine in S jointly, given the
    others.
    """

    seen: int = 0
    more: int = 0
    products: frozenset[tuple[int, int]] = frozenset()

    def allows(self, coordinates: int) -> bool:
        """Whether the number is affine in this set of coordinates jointly."""
        return not coordinates & self.more and not any(a & coordinates and b & coordinates for a, b in self.products)


CONSTANT = Degree()


def coordinate(number: int) -> Degree:
    """That of a coordinate itself."""
    return Degree(1 << number)


def added(a: Degree, b: Degree) -> Degree:
    """Of a sum, or of whatever is a linear combination of both with constant weights."""
    if a is b or b is CONSTANT:
        return a
    if a is CONSTANT:
        return b
    return _limited(Degree(a.seen | b.seen, a.more | b.more, a.products | b.products))


def summed(degrees: Iterable[Degree]) -> Degree:
    """Of a linear combination of all."""
    return reduce(added, degrees, CONSTANT)


def multiplied(a: Degree, b: Degree) -> Degree:
    """Of a product."""
    if a.seen == 0:
        return b
    if b.seen == 0:
        return a
    more = a.more | b.more | (a.seen & b.seen)
    left, right = a.seen & ~more, b.seen & ~more
    new = frozenset([(min(left, right), max(left, right))] if left and right else [])
    return _limited(Degree(a.seen | b.seen, more, a.products | b.products | new))


def bent(*degrees: Degree) -> Degree:
    """Of any nonlinear function of these, jumps included."""
    seen = 0
    for d in degrees:
        seen |= d.seen
    return Degree(seen, seen) if seen else CONSTANT


def chosen(by: Degree, among: Iterable[Degree]) -> Degree:
    """Of one of several numbers, chosen by a condition or an index."""
    return added(summed(among), bent(by))


def _limited(degree: Degree) -> Degree:
    if len(degree.products) <= MOST_PRODUCTS:
        return degree
    more = degree.more
    for a, b in degree.products:
        more |= a | b
    return Degree(degree.seen, more)
