"""The runs of the search, where they ended, and whether they agree."""

from typing import Any

from pydantic import model_validator

from plantfit.findings.record import Number, Record, Values


class History(Record):
    """The best cost after so many evaluations."""

    evaluations: Values = []
    cost: Values = []

    @model_validator(mode="after")
    def _lengths_agree(self) -> "History":
        if len(self.evaluations) != len(self.cost):
            raise ValueError(f"history has {len(self.evaluations)} evaluations but {len(self.cost)} costs")
        return self


class Run(Record):
    """One seeded run, brought to its end on the final problem."""

    method: str
    run: int
    """Its number among those of the method, from 0."""
    seed: int | None = None
    cost: Number = None
    """Mean square of the residuals over their scales, smoothing included."""
    rmse: Number = None
    """In the unit of one output; of several in their scales."""
    status: str = ""
    """How the search ended: converged, budget, ..."""
    ended: str = ""
    """How it came to the final problem: searched, same point (as another run), cut, left, refused."""
    evaluations: Number = None
    seconds: Number = None
    failures: int = 0
    """Evaluations that could not be simulated."""
    parameters: dict[str, Number] = {}
    searched: dict[str, Number] = {}
    """The parameters that the search ended with, where they were moved since."""
    history: History = History()
    extra: dict[str, Any] = {}
    """What the method and the stages after it say of this run alone."""


class Basin(Record):
    """Runs that ended at one place."""

    cost: Number = None
    runs: int
    share: Number = None
    """Of all runs with a cost."""
    parameters: dict[str, Number] = {}


class DistinctAnswer(Record):
    """An answer of the lowest cost that is not the same model as the others."""

    runs: int
    """That ended there; 0: local searches within them met it, and it fits equally well."""
    parameters: dict[str, Number] = {}


class SameModel(Record):
    """A map between answers that are one model: parameter `name` takes the value of `source[name]`, times its
    `sign`, added to its `whole` (0, but of a share that becomes the rest 1, or 100 %)."""

    sentence: str
    source: dict[str, str] = {}
    sign: list[int] = []
    whole: list[float] = []


class Agreement(Record):
    """Runs whose own search, run to its end on the final problem, reaches the lowest cost."""

    runs: int
    """All of them."""
    agree: int
    """Those that reach the lowest cost."""
    cost: Number = None
    """The lowest one."""
    spent: int = 0
    """Runs that were cut by their budget."""
    spent_and_searched: int = 0
    """Those of them that were searched on, on the final problem."""
    spent_and_agree: int = 0
    """Those of them that reach the lowest cost."""
    cut: int = 0
    """Runs that were cut in the local search on the final problem."""
    left: int = 0
    """Runs that were left where their search had ended."""
    ended: str = ""
    """How the reported answer came to the final problem, as `ended` of a run."""
    ranges: dict[str, list[float]] = {}
    """By parameter, over runs of the lowest cost, exchanged terms aside: from, to."""
    answers: list[DistinctAnswer] = []
    """Distinct answers of the lowest cost, the best first."""
    symmetries: list[SameModel] = []
    """Exchanges and signs that make two answers the same model."""
