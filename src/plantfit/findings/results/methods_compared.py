"""`plantfit compare` of search methods: the costs, times and answers of their runs, on one problem and over several."""

from typing import ClassVar

from plantfit.findings.record import Exclude, Number, Printed, Real, Record
from plantfit.findings.verdict import Sentence

Interval = tuple[Real, Real]
SIGNIFICANCE = 0.05  # a p value below which a difference is more than chance


class RunsSummary(Record):
    """The final costs, evaluations or seconds of the runs of a method; not a number where no run has a finite value."""

    n: int
    """Runs with a finite value."""
    failed: int
    """The others, which enter no number below."""
    minimum: Real
    maximum: Real
    median: Real
    mean: Real
    std: Real
    """With n - 1 in the denominator."""
    sem: Real
    """std / sqrt(n)"""
    normal_interval: Interval
    """95 % interval of the mean: mean +- 1.96 sem."""
    t_interval: Interval
    """By Student's t."""
    bootstrap_interval: Interval
    """BCa."""


class SortedCosts(Record):
    """Final costs, the lowest first; of many runs every k-th."""

    rank: list[float]
    """Share of the runs that ended at or below the cost."""
    cost: list[float]


class MethodRuns(Record):
    """The runs of one method."""

    name: str
    runs: int
    cost: RunsSummary
    evaluations: RunsSummary
    seconds: RunsSummary
    sorted: SortedCosts | None = None
    """Left out of `--json`."""


class CostScale(Record):
    """What costs are measured against."""

    best: float
    """The known optimum, else the lowest cost found."""
    reference: float
    """The median final cost of random search; where it is not among the methods, the median best cost after a run's
    first evaluations."""
    source: str
    """Which of the two."""
    known: bool
    """Whether the optimum is known."""

    def at(self, decades: float) -> float:
        """The cost best + 10^-decades (reference - best)."""
        return self.best + 10.0**-decades * (self.reference - self.best)


class Reached(Record):
    """How often, and after how much, the runs of a method reach a cost."""

    hits: int
    n: int
    rate: float
    rate_interval: Interval
    """Wilson."""
    ert: Real
    """Expected evaluations, restarts after every miss counted; infinite without a hit."""
    ert_interval: Interval
    ert_seconds: Real
    ert_seconds_interval: Interval


class CostTarget(Record):
    """A cost to reach."""

    label: str
    """Where it comes from: asked for, noise floor or 10^-2."""
    cost: Real
    methods: dict[str, Reached] = {}


class Lead(Record):
    """From `start` evaluations on `method` is ahead."""

    method: str
    start: float


class MethodPair(Record):
    """Two methods on one problem by final cost."""

    better: str
    worse: str
    runs: tuple[int, int]
    pairs: int
    """Of methods on this problem, for which p values are corrected."""
    a12: Real
    """Probability that a run of `better` ends lower than one of `worse`; 0.5 is a draw."""
    a12_interval: Interval
    p: Real
    """Mann-Whitney, two-sided."""
    p_holm: Real
    medians: tuple[Real, Real]
    """Costs of better and worse; infinite where the median run failed."""
    ratio: Real
    """Of the medians, worse over better; not a number where one is not above zero."""
    ratio_interval: Interval
    detectable: float
    """The A12 that these runs would have shown with 80 % power."""
    leads: list[Lead] = []
    sentence: str = ""
    differs: bool
    """Whether the difference is more than chance, at 5 % over all pairs."""


class PairInTime(Record):
    """Two methods by the time to a target, or by any other number of which less is better."""

    first: str
    second: str
    a12: Real
    """Probability that `first` has more than `second`; below 0.5 it is better."""
    p: Real
    """Mann-Whitney, two-sided."""
    p_holm: Real
    a12_interval: Interval

    @property
    def differs(self) -> bool:
        """Whether the difference is more than chance, at 5 % over all pairs."""
        return self.p_holm < SIGNIFICANCE

    @property
    def winner(self) -> str:
        """The method with less, shown or not."""
        return self.first if self.a12 <= 0.5 else self.second


class Quartiles(Record):
    """The best cost so far of a method's runs, from where every one of them has begun."""

    at: list[float]
    """Evaluations or seconds."""
    low: list[float]
    median: list[float]
    high: list[float]


class SharesReached(Record):
    """The share of (run, target) that was reached by a time."""

    targets: int | None = None
    at: list[float]
    """Evaluations; over several problems by dimension plus one."""
    methods: dict[str, list[float]]


class PlacedRun(Record):
    """One of the best runs: where its parameters lie between their bounds, 0 to 1, and their values."""

    method: str
    run: int
    cost: float
    place: list[float]
    value: list[Number]


class BestRuns(Record):
    """The best runs of each method."""

    names: list[str]
    """Parameters, those that differ most."""
    runs: list[PlacedRun]
    left_out: int
    """Parameters that differ less."""


class SameCostAnswer(Record):
    """Runs that ended at one place at the lowest cost."""

    cost: float
    runs: int
    share: float
    """Of all runs."""
    methods: dict[str, int]
    """Runs by method."""
    place: list[float]
    spread: list[float]
    """Widest difference of each parameter, as a share of its bounds."""
    value: list[Number]


class SameCostAnswers(Record):
    """Distinct answers of the lowest cost."""

    within: float
    """Costs this near to the lowest count as the same."""
    groups: list[SameCostAnswer]
    count: int
    names: list[str]
    shares: list[float] = []
    """Of all runs in each group."""
    widest: tuple[str, float] | None = None
    """The parameter that differs most within the first group, and by how much of its bounds."""


class ProblemComparison(Record):
    """Methods on one problem."""

    name: str
    studies: list[int]
    dimension: int
    floor: Number
    """The cost that noise alone leaves, where it is known."""
    optimum: Number
    """The lowest cost there can be, where it is known."""
    scale: CostScale | None
    """None without a finite cost, or where nothing was gained."""
    methods: list[MethodRuns]
    targets: list[CostTarget]
    main_target: int | None
    """Place in `targets` of the one on which times are compared."""
    pairs: list[MethodPair]
    hitting: list[PairInTime]
    """All pairs by the time to the main target."""
    convergence: dict[str, Quartiles] = {}
    """Against evaluations; left out of `--json`, as the next three."""
    convergence_seconds: dict[str, Quartiles] = {}
    ecdf: SharesReached | None = None
    parallel: BestRuns | None = None
    optima: SameCostAnswers
    notes: list[str]
    """What makes the comparison less than fair."""
    sentences: list[Sentence]


class RankTest(Record):
    """Friedman's test of the ranks of methods over problems; rank 1 is the lowest cost."""

    methods: list[str]
    problems: int
    mean_ranks: dict[str, float]
    chi_square: float
    p_chi_square: float
    f: Real
    """Of Iman and Davenport, which is less timid; infinite where all problems rank alike."""
    p: float
    """Of `f`."""
    best: str
    """The method with the lowest mean rank, with which the others are compared below; None for itself."""
    z: dict[str, Number]
    p_post_hoc: dict[str, Number]
    p_holm: dict[str, Number]
    sentence: str = ""


class PairOverProblems(Record):
    """Two methods over several problems."""

    better: str
    worse: str
    problems: int
    test: str
    a12: Real
    """Mean over problems of the probability that a run of `better` ends lower than one of `worse`."""
    a12_interval: Interval
    """Over problems and runs."""
    p: Real
    p_holm: Real
    ert_ratio: Real = float("nan")
    """Geometric mean of the ratio of expected evaluations to the main targets; not a number unless both reach all of
    them."""
    ert_ratio_interval: Interval = (float("nan"), float("nan"))
    sentence: str = ""


class OverProblems(Record):
    """Methods that ran on every problem; the problems are the replicates."""

    methods: list[str]
    problems: int
    medians: list[list[Real]]
    """Of final costs, by problem and method."""
    friedman: RankTest | None
    """None of two methods, whose medians are compared by signed ranks."""
    pairs: list[PairOverProblems]
    profile: SharesReached | None = None
    """Left out of `--json`."""
    sentences: list[str]


class ComparisonOfMethods(Printed):
    """What `plantfit.study.comparing.record.compared` finds. Its size does not grow with the number of runs."""

    samples_in: ClassVar[Exclude] = {
        "problems": {
            "__all__": {
                "convergence": True,
                "convergence_seconds": True,
                "ecdf": True,
                "parallel": True,
                "methods": {"__all__": {"sorted": True}},
            }
        },
        "across": {"profile": True},
    }

    name: str
    problems: list[ProblemComparison]
    across: OverProblems | None
    """None of one problem, or where fewer than two methods ran on all."""
    seed: int
    """Of the bootstrap intervals."""
    reproduction: dict[str, str] = {}
    """What makes the same comparison again; from the command alone."""
    written: dict[str, str] = {}
    """Files by kind; `--json` alone."""
