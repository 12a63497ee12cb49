"""What physics allows a rigid link to be, as inequalities on its parameters."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from plantfit.errors import ModelError

# what holds, in words -> a function that is >= 0 where it holds
Constraints = Mapping[str, Callable[[Mapping[str, Any]], Any]]


@dataclass(frozen=True)
class LinkNames:
    """Names of a link's parameters, mass (kg), distance of its centre of mass from its joint (m), inertia about that
    centre (kg m^2), and its `length` (m): a number, or None where the body may reach beyond."""

    mass: str
    centre: str
    inertia: str
    length: float | None = None


def link_constraints(links: Sequence[LinkNames]) -> Constraints:
    """Positive mass and inertia, centre of mass inside the link, and I <= m lc (l - lc).

    The last holds for any distribution of a positive mass on a line from joint to tip: its second moment about
    the joint is at most l times its first. It is the planar case of the density's support in a known
    shape (Wensing, Kim, Slotine, IEEE RA-L 3 (2018) 60, section III).
    """
    made: dict[str, Callable[[Mapping[str, Any]], Any]] = {}
    for link in links:
        made |= _of_one(link)
    return made


def _of_one(link: LinkNames) -> dict[str, Callable[[Mapping[str, Any]], Any]]:
    m, c, i, length = link.mass, link.centre, link.inertia, link.length
    found: dict[str, Callable[[Mapping[str, Any]], Any]] = {f"{m} >= 0": lambda p: p[m], f"{i} >= 0": lambda p: p[i]}
    if length is None:
        return found
    if not length > 0:
        raise ModelError(f"The link of mass {m!r} has length {length}; give a length above 0 m, or None.")
    found |= {
        f"{c} >= 0": lambda p: p[c],
        f"{c} <= {length:g}": lambda p: length - p[c],
        f"{i} <= {m}*{c}*({length:g} - {c})": lambda p: p[m] * p[c] * (length - p[c]) - p[i],
    }
    return found
