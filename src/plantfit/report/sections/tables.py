"""The tables of the report as headings and rows of text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from plantfit.findings import Basin, Combination, Number, Parameter, Run, Score, Simulation, Weight
from plantfit.findings.filtered import AheadScore, FilteredAnswer
from plantfit.report.numbers import UNKNOWN, count, interval, plus_minus, seconds, significant, unit_label
from plantfit.report.sections.sentences import listed, parameter_status, run_end, run_status, share
from plantfit.trust.verdict.words import FAR, number

MOST_RUNS = 200
MOST_NAMES = 8  # columns of parameters
MOST_MOVED = 4  # parameters of a direction that are named


@dataclass(frozen=True)
class Table:
    """`numeric` are the places of right-aligned columns; `marked` the places of rows to stand out."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    numeric: frozenset[int] = frozenset()
    marked: frozenset[int] = frozenset()


def scores_table(scores: list[Score]) -> Table:
    """Fit and validation scores of every output."""
    rows = tuple(
        (
            s.recording,
            s.output,
            s.part,
            quantity(s.rmse, s.unit),
            quantity(s.bias, s.unit),
            fit_in_words(s.fit_percent) or per_cent(s.fit_percent),
            count(s.n),
        )
        for s in scores
    )
    head = ("recording", "output", "part", "RMSE", "bias", "fit", "samples")
    return Table(
        "Scores",
        head,
        rows,
        frozenset({3, 4, 5, 6}),
        frozenset(k for k, s in enumerate(scores) if s.part == "validation"),
    )


def parameters_table(parameters: Sequence[Parameter], caption: str = "Parameters") -> Table:
    """Values with standard errors, intervals, bounds and what is known."""
    rows = tuple(
        (p.name, _value(p), unit_label(p.unit), parameter_interval(p), _bounds(p), parameter_status(p))
        for p in parameters
    )
    head = ("parameter", "value ± standard error", "unit", "95 % interval", "bounds", "status")
    marked = frozenset(
        k for k, p in enumerate(parameters) if p.at_bound or p.status in ("weak", "flat", "at bound", "not visited")
    )
    return Table(caption, head, rows, frozenset({1, 3, 4}), marked)


def parameter_interval(p: Parameter, ascii_only: bool = False) -> str:
    """The 95 % interval; an end that the data do not set is said to be open, and no bound of the search stands
    there."""
    if p.open is None or p.open == "both":
        return interval(p.low, p.high, ascii_only) if p.open is None else "open"
    end = significant(p.high if p.open == "lower" else p.low, ascii_only=ascii_only)
    limit = (p.limits or [None, None])[0 if p.open == "upper" else 1]
    if limit is not None and limit == (p.low if p.open == "upper" else p.high):
        return f"above {end}" if p.open == "upper" else f"below {end}"
    return f"at least {end}" if p.open == "upper" else f"at most {end}"


def _value(p: Parameter) -> str:
    """A value that nothing was measured at is no estimate."""
    return "not visited" if p.status == "not visited" else plus_minus(p.value, p.standard_error)


def entries_tables(parameters: Sequence[Parameter]) -> list[Table]:
    """The entries of every table, its name and count in the caption."""
    entries = [p for p in parameters if p.index]
    own = {name: [p for p in entries if p.parameter == name] for name in dict.fromkeys(p.parameter for p in entries)}
    return [
        parameters_table(rows, f"All {len(rows)} entries of {name}: {statuses(rows)}") for name, rows in own.items()
    ]


def statuses(parameters: Sequence[Parameter]) -> str:
    """`21 determined, 6 weak`."""
    kinds = ("determined", "weak", "flat", "at bound", "not visited", "fixed")
    counts = {kind: sum(p.status == kind for p in parameters) for kind in kinds}
    return ", ".join(f"{n} {kind}" for kind, n in counts.items() if n)


def runs_table(runs: list[Run]) -> Table:
    """Every run, lowest cost first; long lists are cut."""
    ordered = sorted(runs, key=lambda r: float("inf") if r.cost is None else r.cost)[:MOST_RUNS]
    rows = tuple(
        (
            r.method,
            str(r.run),
            significant(r.cost, 6),
            significant(r.rmse, 4),
            " ".join(filter(None, (run_status(r.status), run_end(r.ended)))),
            count(r.evaluations),
            count(r.failures),
            seconds(r.seconds),
        )
        for r in ordered
    )
    cut = f": the {MOST_RUNS} lowest of {len(runs)}" if len(runs) > MOST_RUNS else ""
    head = ("method", "run", "final cost", "RMSE", "how it ended", "evaluations", "failed simulations", "time")
    return Table(f"Runs, lowest cost first{cut}", head, rows, frozenset({1, 2, 3, 5, 6, 7}))


def combinations_table(found: list[Combination]) -> Table:
    """Directions along which parameters move together, the loosest first."""
    rows = tuple((str(k), _moves(c.weights), significant(c.relative_sd, 2)) for k, c in enumerate(found, start=1))
    head = ("direction", "relative changes", "relative standard deviation")
    return Table(
        "Parameters that can move together while the simulated outputs hardly change", head, rows, frozenset({2})
    )


def _moves(weights: Mapping[str, float | None]) -> str:
    """The heaviest changes, and how many more."""
    heavy = sorted(weights.items(), key=lambda pair: -abs(pair[1] or 0.0))
    told = ", ".join(f"{n} {100 * (w or 0.0):+.0f} %" for n, w in heavy[:MOST_MOVED])
    return f"{told} and {len(heavy) - MOST_MOVED} more" if len(heavy) > MOST_MOVED else told


def weights_table(weights: list[Weight]) -> Table:
    """The residual of every output that counts as 1 in the cost, and who chose it."""
    rows = tuple((w.output, quantity(w.scale, w.unit), w.who) for w in weights)
    return Table(
        "Weights: residuals that count as 1",
        ("output", "residual that counts as 1", "how it was chosen"),
        rows,
        frozenset({1}),
    )


def noise_table(found: FilteredAnswer) -> Table:
    """Levels of noise that were estimated together with the parameters."""
    rows = tuple(
        (
            f"{n.kind} noise of {n.name}",
            quantity(n.value, n.unit),
            "" if n.low is None or n.high is None else interval(n.low, n.high),
            n.how,
        )
        for n in found.noise
    )
    return Table("Noise", ("noise", "standard deviation", "95 % interval", "how"), rows, frozenset({1, 2}))


def ahead_table(ahead: list[AheadScore]) -> Table:
    """How far outputs are off that a filter foretells one sample ahead."""
    rows = tuple((a.recording, a.output, a.part, quantity(a.rmse, a.unit), count(a.n)) for a in ahead)
    head = ("recording", "output", "part", "RMSE one sample ahead", "samples")
    return Table("Scores one sample ahead", head, rows, frozenset({3, 4}))


def basins_table(basins: list[Basin]) -> Table:
    """Minima that the runs ended in, with the parameters that differ most between them where there are many."""
    names = _telling(basins)
    rows = tuple(
        (significant(b.cost, 6), str(b.runs), share(b.share), *(significant(b.parameters.get(n)) for n in names))
        for b in basins[:MOST_RUNS]
    )
    cut = f", with the {len(names)} parameters that differ most" if len(names) < len(_named(basins)) else ""
    return Table(
        f"Minima found{cut}", ("cost", "runs", "share of runs", *names), rows, frozenset(range(3 + len(names)))
    )


def _named(basins: Sequence[Basin]) -> list[str]:
    return list(dict.fromkeys(name for b in basins for name in b.parameters))


def _telling(basins: Sequence[Basin]) -> list[str]:
    """At most MOST_NAMES parameters, in their order, by how much they differ relative to their size."""

    def differs(name: str) -> float:
        values = [v for b in basins if (v := b.parameters.get(name)) is not None]
        size = max(map(abs, values), default=0.0)
        return (max(values) - min(values)) / size if size else 0.0

    names = _named(basins)
    kept = set(sorted(names, key=differs, reverse=True)[:MOST_NAMES])
    return [n for n in names if n in kept]


def simulation_table(simulation: Simulation) -> Table:
    """Errors of the simulation beside the residuals, which they must stay far below."""
    rows = tuple(
        (
            name,
            quantity(o.max_error, o.unit),
            quantity(o.rms_error, o.unit),
            quantity(o.rms_residual, o.unit),
            _ratio(o.rms_error, o.rms_residual),
        )
        for name, o in simulation.outputs.items()
    )
    head = ("output", "largest error", "RMS error", "RMS residual", "RMS error / RMS residual")
    where = f" of recording {simulation.recording}" if simulation.recording else ""
    how = f", checked with {simulation.checked_with}" if simulation.checked_with else ""
    return Table(f"Error of the simulation{where}{how}", head, rows, frozenset({1, 2, 3, 4}))


def quantity(value: Number, unit: str | None, digits: int = 3) -> str:
    """A number with its unit."""
    label = unit_label(unit)
    return significant(value, digits) + (f" {label}" if label and value is not None else "")


def fit_in_words(percent: Number) -> str | None:
    """A fit that is so far below zero that per cent tell nothing, by the RMSE of the mean; None for another."""
    return None if percent is None or percent >= FAR else f"{number(1.0 - percent / 100.0)} times the mean's RMSE"


def per_cent(value: Number) -> str:
    """A number that is in per cent already."""
    return UNKNOWN if value is None else f"{significant(value, 3)} %"


def substeps(value: object) -> str:
    """Substeps per sample: one number, or one per recording."""
    if isinstance(value, dict):
        return listed(f"{steps} in {name}" for name, steps in value.items())
    if isinstance(value, list):
        return listed(str(v) for v in value)
    return UNKNOWN if value is None else str(value)


def _bounds(p: Parameter) -> str:
    if p.lower_bound is None or p.upper_bound is None:
        return UNKNOWN
    mark = {"lower": ("▸ ", ""), "upper": ("", " ◂"), None: ("", "")}[p.at_bound]
    log = " (log)" if p.scale == "log" else ""
    return f"{mark[0]}{significant(p.lower_bound)} to {significant(p.upper_bound)}{mark[1]}{log}"


def _ratio(error: Number, residual: Number) -> str:
    return significant(error / residual, 2) if error is not None and residual else UNKNOWN
