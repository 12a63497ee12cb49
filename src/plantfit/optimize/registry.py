"""The methods by name."""

import dataclasses
from typing import Any, NamedTuple

from plantfit.errors import SearchError
from plantfit.optimize.auto import Auto
from plantfit.optimize.cmaes import CmaEs
from plantfit.optimize.contract import Host, Population
from plantfit.optimize.lbfgsb import Lbfgsb
from plantfit.optimize.least_squares import LeastSquares
from plantfit.optimize.pso import ParticleSwarm
from plantfit.optimize.random_search import RandomSearch
from plantfit.optimize.settings import build, close_match, describe


class Entry(NamedTuple):
    """A method, what it does in one sentence, and where it comes from."""

    kind: type
    sentence: str
    paper: str


REGISTRY = {
    "auto": Entry(
        Auto,
        "Chooses for you: a spread sample, then exact-derivative local searches until the best answer repeats.",
        "Rinnooy Kan and Timmer 1987, Mathematical Programming 39:27",
    ),
    "least_squares": Entry(
        LeastSquares,
        "Trust-region least squares with the exact Jacobian from many starts, with robust losses.",
        "Branch, Coleman and Li 1999, SIAM Journal on Scientific Computing 21:1",
    ),
    "lbfgsb": Entry(
        Lbfgsb,
        "Quasi-Newton descent with the exact gradient and bounds from many starts.",
        "Byrd, Lu, Nocedal and Zhu 1995, SIAM Journal on Scientific Computing 16:1190",
    ),
    "cmaes": Entry(
        CmaEs,
        "Evolution strategy that learns which parameters move together; needs no derivatives.",
        "Hansen 2016, The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772",
    ),
    "pso": Entry(
        ParticleSwarm,
        "Particle swarm with constriction coefficients, global or ring neighbourhood.",
        "Kennedy and Eberhart 1995, IEEE ICNN; Clerc and Kennedy 2002, IEEE TEC 6:58",
    ),
    "random": Entry(
        RandomSearch,
        "Uniform random points: the baseline that every method must beat.",
        "Bergstra and Bengio 2012, Journal of Machine Learning Research 13:281",
    ),
}


def make(name: str, /, **settings: Any) -> Population | Host:
    """The method called `name` with checked settings.

    Raises SearchError for an unknown method or setting, or a value outside its range.
    """
    if name not in REGISTRY:
        raise SearchError(f"There is no method {name!r}; there are {list(REGISTRY)}.{close_match(name, REGISTRY)}")
    return build(REGISTRY[name].kind, name, settings)


def methods() -> list[dict[str, Any]]:
    """One plain record per method: name, sentence, paper, needs, settings."""
    return [
        {
            "name": name,
            "sentence": entry.sentence,
            "paper": entry.paper,
            "needs": dataclasses.asdict(entry.kind.needs),  # type: ignore[attr-defined]
            "settings": describe(entry.kind),
        }
        for name, entry in REGISTRY.items()
    ]


def name_of(method: Any) -> str:
    """The registered name of a method, else the name of its class."""
    return next((name for name, entry in REGISTRY.items() if entry.kind is type(method)), type(method).__name__)
