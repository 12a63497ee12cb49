"""The methods by name: those of plantfit, and those that other packages bring (`plugins.py`)."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from plantfit.errors import SearchError
from plantfit.optimize.contract import Host, Needs, Population
from plantfit.optimize.settings import build, close_match, describe
from plantfit.plugins import Plugin, first_sentence, offered


@dataclass(frozen=True)
class Entry:
    """A method, what it does in one sentence, and where it comes from; `place` is its module in this room and its
    class."""

    place: str
    sentence: str
    paper: str

    @property
    def kind(self) -> type:
        """The class; imported when first asked for, since a study uses one or two of the methods."""
        module, name = self.place.rsplit(".", 1)
        return getattr(import_module(f"plantfit.optimize.{module}"), name)


REGISTRY = {
    "auto": Entry(
        "algorithms.auto.Auto",
        "Chooses for you: a spread sample, then exact-derivative local searches until the best answer repeats.",
        "Rinnooy Kan and Timmer 1987, Mathematical Programming 39:27",
    ),
    "least_squares": Entry(
        "algorithms.least_squares.LeastSquares",
        "Trust-region least squares with the exact Jacobian from many starts, with robust losses.",
        "Branch, Coleman and Li 1999, SIAM Journal on Scientific Computing 21:1",
    ),
    "lbfgsb": Entry(
        "algorithms.lbfgsb.Lbfgsb",
        "Quasi-Newton descent with the exact gradient and bounds from many starts.",
        "Byrd, Lu, Nocedal and Zhu 1995, SIAM Journal on Scientific Computing 16:1190",
    ),
    "cmaes": Entry(
        "algorithms.cma_es.cmaes.CmaEs",
        "Evolution strategy that learns which parameters move together; needs no derivatives.",
        "Hansen 2016, The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772",
    ),
    "sep_cmaes": Entry(
        "algorithms.cma_es.separable_cmaes.SeparableCmaEs",
        "CMA-ES that learns a scale for every parameter and no directions: cheap and fast where parameters act alone.",
        "Ros and Hansen 2008, PPSN X, LNCS 5199:296",
    ),
    "dd_cmaes": Entry(
        "algorithms.cma_es.dd_cmaes.DecodingCmaEs",
        "CMA-ES for hundreds of parameters: learns scales fast and directions slowly.",
        "Akimoto and Hansen 2020, Evolutionary Computation 28:405",
    ),
    "ipop_cmaes": Entry(
        "algorithms.cma_es.ipop.IpopCmaEs",
        "CMA-ES that restarts with twice the population: for many local minima in a broad valley.",
        "Auger and Hansen 2005, IEEE CEC, 1769",
    ),
    "bipop_cmaes": Entry(
        "algorithms.cma_es.bipop.BipopCmaEs",
        "CMA-ES that restarts with large and with small populations in turn: for many local minima of any kind.",
        "Hansen 2009, GECCO companion, 2389",
    ),
    "pso": Entry(
        "algorithms.pso.ParticleSwarm",
        "Particle swarm with constriction coefficients, global or ring neighbourhood.",
        "Kennedy and Eberhart 1995, IEEE ICNN; Clerc and Kennedy 2002, IEEE TEC 6:58",
    ),
    "cga": Entry(
        "algorithms.genetic.cga.ContinuousGenetic",
        "Real-coded genetic algorithm with elites or steady-state replacement.",
        "Eshelman and Schaffer 1993, FOGA 2:187; Deb and Agrawal 1995, Complex Systems 9:115",
    ),
    "binary_ga": Entry(
        "algorithms.genetic.binary_ga.BinaryGenetic",
        "Genetic algorithm on bit strings, in Gray or plain code.",
        "Holland 1975, Adaptation in Natural and Artificial Systems; Caruana and Schaffer 1988, ICML 5:153",
    ),
    "elite_ga": Entry(
        "algorithms.genetic.elite_ga.EliteGenetic",
        "Genetic algorithm in which an elite breeds with the rest and immigrants arrive in every generation.",
        "The Use of a Statistical Filter and Metaheuristics to Model and Control the DC Motor of the Mobile Robot Used "
        "on NXP Cup, 2018",
    ),
    "salp_swarm": Entry(
        "algorithms.salp_swarm.SalpSwarm",
        "Salp chain around the best point, kept to replicate published results; its steps depend on the budget and on "
        "where the box lies.",
        "Mirjalili et al. 2017, Advances in Engineering Software 114:163",
    ),
    "hms": Entry(
        "algorithms.hierarchic.hms.Hms",
        "A tree of populations: evolution that keeps exploring starts CMA-ES where it finds separate basins.",
        "Smolka and Schaefer 2014, LNCS 8602:138; Sawicki, Los, Smolka and Schaefer 2022, Natural Computing 21:289",
    ),
    "sea": Entry(
        "algorithms.genetic.sea.SimpleEvolution",
        "Simple evolution: tournaments and Gaussian mutation whose step is drawn over many scales.",
        "Schaefer and Kolodziej 2003, Foundations of Genetic "
        "Algorithms 7; Dietzfelbinger et al. 2011, Algorithmica 59:301",
    ),
    "jso": Entry(
        "algorithms.differential_evolution.jso.Jso",
        "Differential evolution that adapts F and CR while its population shrinks; spends the whole budget as planned.",
        "Brest, Maucec and Boskovic 2017, IEEE CEC, pp. 1311-1318",
    ),
    "dish": Entry(
        "algorithms.differential_evolution.dish.Dish",
        "jSO whose memory favours the successes that moved far.",
        "Viktorin, Senkerik, Pluhacek, Kadavy and Zamuda 2019, Swarm and Evolutionary Computation 50:100462",
    ),
    "lshade": Entry(
        "algorithms.differential_evolution.lshade.LShade",
        "Differential evolution with a memory of what succeeded and a shrinking population.",
        "Tanabe and Fukunaga 2014, IEEE CEC, pp. 1658-1665",
    ),
    "shade": Entry(
        "algorithms.differential_evolution.shade.Shade",
        "Differential evolution with a memory of what succeeded and a fixed population; needs no planned budget.",
        "Tanabe and Fukunaga 2013, IEEE CEC, pp. 71-78",
    ),
    "de": Entry(
        "algorithms.differential_evolution.de.DifferentialEvolution",
        "Differential evolution with fixed F and CR: rand/1, best/1 or current-to-best/1.",
        "Storn and Price 1997, Journal of Global Optimization 11:341",
    ),
    "nelder_mead": Entry(
        "algorithms.nelder_mead.NelderMead",
        "Downhill simplex from many starts: a baseline without derivatives for few parameters.",
        "Nelder and Mead 1965, Computer Journal 7:308; Gao and Han "
        "2012, Computational Optimization and Applications 51:259",
    ),
    "sobol": Entry(
        "algorithms.sobol_search.SobolSearch",
        "Scrambled Sobol points: a baseline that covers the box more evenly than random points.",
        "Sobol 1967, USSR Computational Mathematics and Mathematical Physics 7:86",
    ),
    "random": Entry(
        "algorithms.random_search.RandomSearch",
        "Uniform random points: the baseline that every method must beat.",
        "Bergstra and Bengio 2012, Journal of Machine Learning Research 13:281",
    ),
}


@dataclass(frozen=True)
class Brought:
    """A method of another package: its class is a frozen dataclass with `needs`, as those of plantfit; it may state
    its `paper`."""

    plugin: Plugin

    @property
    def kind(self) -> type:
        """The class. Raises SearchError where it cannot be imported, or is no method."""
        kind = self.plugin.load(SearchError)
        if not (
            isinstance(kind, type)
            and dataclasses.is_dataclass(kind)
            and isinstance(getattr(kind, "needs", None), Needs)
        ):
            raise SearchError(
                f"{self.plugin.name!r} of the package {self.plugin.package} is no search method: "
                "it has to be a frozen dataclass with `needs = Needs(...)`; see docs/plug-ins.md."
            )
        return kind

    @property
    def sentence(self) -> str:
        return first_sentence(self.kind)

    @property
    def paper(self) -> str:
        return str(getattr(self.kind, "paper", "")) or f"package {self.plugin.package}"


def known() -> Mapping[str, Entry | Brought]:
    """All methods by name: first those of plantfit, then those of other packages."""
    return {**REGISTRY, **{n: Brought(p) for n, p in offered("methods", frozenset(REGISTRY)).items()}}


def make(name: str, /, **settings: Any) -> Population | Host:
    """The method called `name` with checked settings.

    Raises SearchError for an unknown method or setting, or a value outside its range.
    """
    if name in REGISTRY:  # packages are not looked through for a name that is known
        return build(REGISTRY[name].kind, name, settings)
    methods = known()
    if name not in methods:
        hint = close_match(name, methods) or f" There are {', '.join(list(methods)[:4])} and {len(methods) - 4} more."
        raise SearchError(f"There is no method {name!r}.{hint} `plantfit methods` lists all.")
    return build(methods[name].kind, name, settings)


def methods() -> list[dict[str, Any]]:
    """One plain record per method: name, sentence, paper, needs, settings."""
    return [
        {
            "name": name,
            "sentence": entry.sentence,
            "paper": entry.paper,
            "needs": dataclasses.asdict(entry.kind.needs),
            "settings": describe(entry.kind),
        }
        for name, entry in known().items()
    ]


def name_of(method: Any) -> str:
    """The registered name of a method, else the name of its class."""
    place = f"{type(method).__module__}.{type(method).__name__}"
    own = (name for name, entry in REGISTRY.items() if f"plantfit.optimize.{entry.place}" == place)
    brought = (
        n for n, p in offered("methods", frozenset(REGISTRY)).items() if p.point.value.replace(":", ".") == place
    )
    return next(own, None) or next(brought, type(method).__name__)
