"""Exact polynomials with whole coefficients in named symbols: what parameters of a network are multiplied to."""

import math
from collections.abc import Iterable

Monomial = tuple[tuple[str, int], ...]  # symbols in alphabetical order with their powers; () is 1


class Polynomial:
    """Immutable; sums, products, exact quotients and greatest common divisors."""

    __slots__ = ("terms",)

    def __init__(self, terms: dict[Monomial, int] | None = None):
        self.terms = {m: c for m, c in (terms or {}).items() if c}

    @staticmethod
    def number(value: int) -> "Polynomial":
        return Polynomial({(): value})

    @staticmethod
    def symbol(name: str) -> "Polynomial":
        return Polynomial({((name, 1),): 1})

    def __bool__(self) -> bool:
        return bool(self.terms)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Polynomial) and self.terms == other.terms

    def __hash__(self) -> int:
        return hash(frozenset(self.terms.items()))

    def __add__(self, other: "Polynomial") -> "Polynomial":
        terms = dict(self.terms)
        for m, c in other.terms.items():
            terms[m] = terms.get(m, 0) + c
        return Polynomial(terms)

    def __neg__(self) -> "Polynomial":
        return Polynomial({m: -c for m, c in self.terms.items()})

    def __sub__(self, other: "Polynomial") -> "Polynomial":
        return self + -other

    def __mul__(self, other: "Polynomial") -> "Polynomial":
        terms: dict[Monomial, int] = {}
        for a, x in self.terms.items():
            for b, y in other.terms.items():
                m = _times(a, b)
                terms[m] = terms.get(m, 0) + x * y
        return Polynomial(terms)

    def over(self, other: "Polynomial") -> "Polynomial":
        """The quotient; raises ArithmeticError where it is no polynomial."""
        rest, quotient = self, Polynomial()
        lead, by = other._leading()
        while rest:
            m, c = rest._leading()
            power = _over(m, lead)
            if power is None or c % by:
                raise ArithmeticError(f"({self}) is no multiple of ({other})")
            part = Polynomial({power: c // by})
            quotient, rest = quotient + part, rest - part * other
        return quotient

    def symbols(self) -> set[str]:
        return {name for m in self.terms for name, _ in m}

    @property
    def is_one(self) -> bool:
        return self.terms == {(): 1}

    def _leading(self) -> tuple[Monomial, int]:
        """The first term in the order of powers, symbol by symbol (lexicographic)."""
        names = sorted(self.symbols())
        m = max(self.terms, key=lambda m: [dict(m).get(n, 0) for n in names])
        return m, self.terms[m]

    def _in(self, name: str) -> dict[int, "Polynomial"]:
        """Coefficients by the powers of one symbol."""
        found: dict[int, dict[Monomial, int]] = {}
        for m, c in self.terms.items():
            power = dict(m).get(name, 0)
            found.setdefault(power, {})[tuple(f for f in m if f[0] != name)] = c
        return {power: Polynomial(terms) for power, terms in found.items()}

    def __str__(self) -> str:
        """As an expression, with what all terms share in front."""
        if not self:
            return "0"
        shared = _shared(self.terms)
        content = math.gcd(*self.terms.values())
        if all(c < 0 for c in self.terms.values()):
            content = -content
        rest = Polynomial({_over(m, shared) or (): c // content for m, c in self.terms.items()})
        front = _product(shared, content)
        if rest.is_one:
            return front
        inner = joined((c, _product(m, abs(c))) for m, c in sorted(rest.terms.items(), key=lambda t: (t[1] < 0, t[0])))
        if front == "1":
            return inner
        return f"-({inner})" if front == "-1" else f"{front}*({inner})"

    __repr__ = __str__


ONE = Polynomial.number(1)


def gcd(a: Polynomial, b: Polynomial) -> Polynomial:
    """The greatest common divisor, by primitive remainders in one symbol after another (Knuth, The Art of Computer
    Programming, 4.6.1)."""
    if not a or not b:
        return _positive(a or b)
    shared = sorted(a.symbols() & b.symbols())
    if not shared:
        return Polynomial.number(math.gcd(*a.terms.values(), *b.terms.values()))  # only numbers divide both
    name = shared[0]
    inside = gcd(_content(a, name), _content(b, name))
    a, b = a.over(_content(a, name)), b.over(_content(b, name))
    if max(a._in(name)) < max(b._in(name)):
        a, b = b, a
    while b:
        rest = _remainder(a, b, name)
        a, b = b, rest.over(_content(rest, name)) if rest else rest
        if b and name not in b.symbols():
            return _positive(inside)
    return _positive(inside * a)


def gcd_of(many: Iterable[Polynomial]) -> Polynomial:
    found = Polynomial()
    for p in many:
        found = gcd(found, p)
        if found.is_one:
            break
    return found


def _content(p: Polynomial, name: str) -> Polynomial:
    return gcd_of(p._in(name).values())


def _remainder(a: Polynomial, b: Polynomial, name: str) -> Polynomial:
    """The pseudo-remainder of a by b in one symbol."""
    degree, lead = max(b._in(name)), b._in(name)[max(b._in(name))]
    while a and max(a._in(name)) >= degree:
        parts = a._in(name)
        top = max(parts)
        shift = Polynomial({((name, top - degree),): 1}) if top > degree else ONE
        a = a * lead - b * parts[top] * shift
    return a


def _positive(p: Polynomial) -> Polynomial:
    return -p if p and p._leading()[1] < 0 else p


def _times(a: Monomial, b: Monomial) -> Monomial:
    powers = dict(a)
    for name, power in b:
        powers[name] = powers.get(name, 0) + power
    return tuple(sorted(powers.items()))


def _over(a: Monomial, b: Monomial) -> Monomial | None:
    powers = dict(a)
    for name, power in b:
        powers[name] = powers.get(name, 0) - power
        if powers[name] < 0:
            return None
    return tuple(sorted((n, p) for n, p in powers.items() if p))


def _shared(monomials: Iterable[Monomial]) -> Monomial:
    every = [dict(m) for m in monomials]
    return tuple((n, min(m.get(n, 0) for m in every)) for n in sorted(every[0]) if all(n in m for m in every))


def _product(m: Monomial, number: int) -> str:
    factors = [f"{n}^{p}" if p > 1 else n for n, p in m]
    if not factors:
        return str(number)
    return {1: "", -1: "-"}.get(number, f"{number}*") + "*".join(factors)


def joined(terms: Iterable[tuple[int, str]]) -> str:
    """A sum of terms that are written without their signs."""
    text = "".join(f" {'-' if sign < 0 else '+'} {term}" for sign, term in terms)
    return f"-{text[3:]}" if text.startswith(" - ") else text[3:]
