"""The tables of a comparison as headings and rows of text."""

from collections.abc import Callable, Mapping, Sequence

from plantfit.findings.record import Number
from plantfit.findings.results.methods_compared import (
    CostTarget,
    MethodPair,
    MethodRuns,
    OverProblems,
    PairInTime,
    SameCostAnswers,
)
from plantfit.report.numbers import UNKNOWN, count, interval, percent, seconds, significant
from plantfit.report.sections.tables import Table
from plantfit.study.comparing.pairwise import effect_word
from plantfit.study.comparing.sentences import p_value

_BEST = (UNKNOWN, UNKNOWN, "best")


def costs_table(methods: Sequence[MethodRuns]) -> Table:
    """Location and spread of the final costs, with the effort; the lowest mean stands out."""
    head = ("method", "runs", "best", "worst", "mean", "median", "std", "SEM", "95 % CI of mean", "evaluations", "time")
    rows = []
    for m in methods:
        c = m.cost
        failed = f" + {c.failed} failed" if c.failed else ""
        numbers = (significant(v, 6) for v in (c.minimum, c.maximum, c.mean, c.median))
        spread = (significant(v, 3) for v in (c.std, c.sem))
        effort = (count(_known(m.evaluations.mean)), seconds(_known(m.seconds.mean)))
        rows.append((m.name, f"{c.n}{failed}", *numbers, *spread, interval(*c.t_interval), *effort))
    best = min(range(len(methods)), key=lambda k: _last(methods[k].cost.mean), default=None)
    marked = frozenset([best]) if best is not None and len(methods) > 1 else frozenset()
    return Table("Final costs", head, tuple(rows), frozenset(range(1, 11)), marked)


def intervals_table(methods: Sequence[MethodRuns]) -> Table:
    """The three intervals of the mean side by side."""
    head = ("method", "mean", "normal (as in papers)", "Student's t", "bootstrap (BCa)")
    rows = tuple(
        (
            m.name,
            significant(c.mean, 6),
            interval(*c.normal_interval),
            interval(*c.t_interval),
            interval(*c.bootstrap_interval),
        )
        for m, c in ((m, m.cost) for m in methods)
    )
    return Table("95 % intervals of the mean cost", head, rows, frozenset(range(1, 5)))


def pairs_table(pairs: Sequence[MethodPair]) -> Table:
    """Every pair by final cost: effect with interval first, then the p values."""
    head = ("lower cost", "against", "A12", "95 % interval", "effect", "ratio of medians", "p", "p (Holm)")
    rows = []
    for p in pairs:
        ratio = UNKNOWN if p.ratio != p.ratio else f"{significant(p.ratio, 4)} ({interval(*p.ratio_interval)})"
        effect = (significant(p.a12, 3), interval(*p.a12_interval), effect_word(p.a12))
        rows.append((p.better, p.worse, *effect, ratio, p_value(p.p)[2:], p_value(p.p_holm)[2:]))
    marked = frozenset(k for k, p in enumerate(pairs) if p.differs)
    return Table("Pairs of methods by final cost", head, tuple(rows), frozenset({2, 3, 5, 6, 7}), marked)


def hitting_table(hitting: Sequence[PairInTime], cost: float) -> Table:
    """Every pair by the time to a target."""
    head = ("sooner", "against", "A12", "95 % interval", "effect", "p", "p (Holm)")
    rows = []
    for h in hitting:
        first = h.a12 <= 0.5
        names = (h.first, h.second) if first else (h.second, h.first)
        effect = 1 - h.a12 if first else h.a12
        low, high = h.a12_interval
        limits = (1 - high, 1 - low) if first else (low, high)
        told = (significant(effect, 3), interval(*limits), effect_word(effect))
        rows.append((*names, *told, p_value(h.p)[2:], p_value(h.p_holm)[2:]))
    return Table(
        f"Pairs of methods by time to the cost {significant(cost, 6)}", head, tuple(rows), frozenset({2, 3, 5, 6})
    )


def targets_table(target: CostTarget) -> Table:
    """How often, and after how much, each method reaches one cost."""
    head = ("method", "hits", "success rate", "95 % interval (Wilson)")
    head += ("expected evaluations (95 %)", "expected time (95 %)")
    rows = []
    for m, r in target.methods.items():
        low, high = r.rate_interval
        rate = (percent(r.rate), f"{percent(low)} to {percent(high)}")
        spent = (
            _with_limits(r.ert, r.ert_interval, _amount),
            _with_limits(r.ert_seconds, r.ert_seconds_interval, _time),
        )
        rows.append((m, f"{r.hits} of {r.n}", *rate, *spent))
    return Table(f"Target {significant(target.cost, 6)} ({target.label})", head, tuple(rows), frozenset(range(1, 6)))


def optima_table(optima: SameCostAnswers, most: int = 8) -> Table:
    """Groups of runs that share the lowest cost, with the parameters that differ most."""
    names = optima.names
    spread = [
        max(g.place[k] for g in optima.groups) - min(g.place[k] for g in optima.groups) for k in range(len(names))
    ]
    kept = sorted(sorted(range(len(names)), key=lambda k: -spread[k])[:most])
    rows = tuple(
        (
            significant(g.cost, 7),
            str(g.runs),
            percent(g.share),
            _by(g.methods),
            *(significant(g.value[k]) for k in kept),
        )
        for g in optima.groups
    )
    head = ("lowest cost", "runs", "share of runs", "methods", *(names[k] for k in kept))
    return Table("Distinct answers of the same cost", head, rows, frozenset({0, 1, 2, *range(4, 4 + len(kept))}))


def ranks_table(across: OverProblems) -> Table | None:
    """Mean ranks over problems with the post-hoc tests against the best."""
    f = across.friedman
    if f is None:
        return None
    rows = []
    for m in sorted(across.methods, key=lambda m: f.mean_ranks[m]):
        tests = (significant(f.z[m], 3), _chance(f.p_post_hoc[m]), _chance(f.p_holm[m])) if m != f.best else _BEST
        rows.append((m, significant(f.mean_ranks[m], 3), *tests))
    head = ("method", "mean rank", "z against the best", "p", "p (Holm)")
    return Table("Mean ranks over problems", head, tuple(rows), frozenset(range(1, 5)))


def _by(methods: Mapping[str, int]) -> str:
    return ", ".join(f"{m} {n}" for m, n in methods.items())


def _chance(p: Number) -> str:
    return UNKNOWN if p is None else p_value(p)[2:]


def _amount(value: float) -> str:
    return "∞" if value == float("inf") else count(float(f"{value:.3g}")) if value == value else UNKNOWN


def _time(value: float) -> str:
    return "∞" if value == float("inf") else seconds(value) if value == value else UNKNOWN


def _with_limits(value: float, limits: Sequence[float], form: Callable[[float], str]) -> str:
    return f"{form(value)} ({form(limits[0])} to {form(limits[1])})"


def _known(value: float) -> float | None:
    return value if value == value else None


def _last(value: float) -> float:
    return value if value == value else float("inf")
