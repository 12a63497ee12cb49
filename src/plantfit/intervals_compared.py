"""Intervals of an answer's parameters by several kinds, side by side: covariance, profile likelihood, bootstrap,
posterior."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.special import stdtrit

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import PlantfitError, SpecError
from plantfit.findings.results.intervals_compared import (
    BootstrapOfIntervals,
    ComparisonOfIntervals,
    IntervalsOfParameter,
    KindOfInterval,
    PosteriorOfIntervals,
)
from plantfit.findings.results.result import Result
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import LEAST_SQUARES, Problem
from plantfit.report.case_page import write_case_page
from plantfit.report.pages.intervals import interval_rows, intervals_page
from plantfit.report.text import columns
from plantfit.space import Coordinate
from plantfit.trust.finish.unknown_noise import as_known, rest_on_it, unknown_noise
from plantfit.trust.intervals.kinds.bootstrap import Bootstrap, bootstrap, percentiles
from plantfit.trust.intervals.kinds.inference_data import Drawn, netcdf_of
from plantfit.trust.intervals.kinds.noise import noise_of
from plantfit.trust.intervals.kinds.posterior import CHAINS, Draws, need_blackjax, posterior
from plantfit.trust.intervals.kinds.priors import Prior, normal_priors
from plantfit.trust.intervals.kinds.told import interval_sentences
from plantfit.trust.intervals.linearised import residual_blocks
from plantfit.trust.intervals.profile import Profile, profile
from plantfit.trust.intervals.ranges import degrees_left
from plantfit.trust.intervals.robust_or_classical import robust_errors

if TYPE_CHECKING:
    import polars as pl

KINDS = ("covariance", "profile", "bootstrap", "posterior")
MOST_SAMPLED = 60  # coordinates of a posterior
EDGE = 1e-3  # of the box: an interval that ends so near a bound is cut off by it
STILL = 1e-6  # of the box: refits that lie closer together never left their bound
VERDICTS = 0.95  # level of the verdict's own intervals


@dataclass(frozen=True, repr=False, eq=False)
class IntervalsCompared(Result[ComparisonOfIntervals]):
    """What `compare_intervals` found; `profiles` by parameter, `refits` and `draws` are there where asked for."""

    answer: Answer
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    refits: Bootstrap | None = None
    draws: Draws | None = None

    def to_frame(self) -> "pl.DataFrame":
        """A polars data frame, a row for each parameter and kind: parameter, unit, value, kind, low, high, open_low,
        open_high (whether a bound cuts that end off)."""
        import polars as pl

        rows = [
            {"parameter": p.name, "unit": p.unit, "value": p.value, "kind": k.kind, "low": k.low, "high": k.high,
             "open_low": k.open_low,
             "open_high": k.open_high}
            for p in self.typed.parameters for k in p.kinds
        ]  # fmt: skip
        return pl.DataFrame(rows, schema_overrides={"unit": pl.String, "low": pl.Float64, "high": pl.Float64})

    def save_draws(self, path: str | Path) -> Path:
        """Write the posterior's draws as netCDF with the groups that ArviZ opens, and xarray.

        Raises PlantfitError where there is no posterior, MissingExtra where h5netcdf is not installed.
        """
        if self.draws is None:
            raise PlantfitError("There are no draws to save; ask for the posterior.")
        stats = {"lp": self.draws.log_density, "diverging": self.draws.diverging.astype(np.int8)}
        drawn = Drawn(self.draws.values, stats, "The posterior, by NUTS.")
        Path(path).write_bytes(netcdf_of(self.answer.problem, drawn, self.answer.score("fit"), self.typed.seed))
        return Path(path)

    def report(self, path: str | Path) -> Path:
        """Write the page with every interval, profile and histogram. Raises StoreError."""
        return write_case_page(intervals_page(self.typed), path)

    def table(self) -> str:
        """Intervals as text."""
        head, rows = interval_rows(self.typed)
        return columns(head, rows, range(1, len(head)))


def compare_intervals(
    answer: Answer,
    *,
    kinds: Sequence[str] = KINDS[:3],
    parameters: Sequence[str] = (),
    level: float = 0.95,
    replicates: int = 400,
    chains: int = CHAINS,
    draws: int = 1000,
    priors: Mapping[str, Prior] | None = None,
    seed: int = 1,
    progress: Callable[[str], None] | None = None,
) -> IntervalsCompared:
    """Intervals at `level` of an answer's parameters, or of those named, by each of `kinds`.

    "covariance": the linearised problem, robust against correlated residuals; "profile": the likelihood ratio with all
    others refitted; "bootstrap": `replicates` refits of records with resampled blocks of residuals; "posterior": NUTS
    with `chains` of `draws`, flat priors on the search's scale within its bounds or normal ones, `priors` {"tau": (138,
    5)} or {"tau": "138 ± 5 s"}, and white or autoregressive noise; where residuals are neither, no posterior is made
    and a sentence says so. The verdict's own intervals stand beside them at 95 %. Stated errors of instruments are in
    the verdict's alone. Same seed, same numbers.

    Raises SpecError and UnitError for wrong wishes, MissingExtra where blackjax is not installed.
    """
    estimator, answer = answer.problem.answered_by, answer.by_least_squares  # all kinds are of one estimate
    problem, z = answer.problem, np.asarray(answer.best.x, dtype=float)
    space, say = problem.space, progress or (lambda text: None)
    check_wishes(kinds, level, replicates, chains, draws)
    unknown = [n for n in parameters if n not in space.names]
    if unknown:
        raise SpecError(f"There is no free parameter {unknown[0]!r}; there are {', '.join(space.names)}.")
    given = normal_priors(space, priors or {})
    if given and "posterior" not in kinds:
        raise SpecError("A prior is for the posterior; ask for that kind too.")
    places = [i for i, n in enumerate(space.names) if not parameters or n in parameters]
    refused: dict[str, str] = {}
    drawn, orders = None, {}
    if "posterior" in kinds:  # first: what is not installed is told at once
        drawn, orders = _posterior(answer, z, given, chains, draws, seed, say, refused)
    found = bootstrap(problem, z, replicates, seed, _counted(say, "refit")) if "bootstrap" in kinds else None
    profiles: dict[str, Profile] = {}
    for k, i in enumerate(places if "profile" in kinds else ()):
        say(f"profile of {space.names[i]}, {k + 1} of {len(places)}")
        profiles[space.names[i]] = profile(problem, z, space.names[i], level)
    say("comparing")
    rows = {r["name"]: r for r in answer.findings["parameters"]}
    rest = (
        rest_on_it(problem, residuals_and_jacobian(problem.unsmoothed, z)[1])
        if unknown_noise(problem)
        else np.zeros(len(z), dtype=bool)
    )
    silent = {n for n, on in zip(space.names, rest, strict=True) if on}
    degrees = _degrees(as_known(problem), z)
    compared = [
        _row(answer, z, i, rows, kinds, level, profiles, found, drawn, refused, silent, degrees) for i in places
    ]
    if estimator != LEAST_SQUARES:
        refused["weighted"] = (
            f"The study's own answer is that of {estimator}; all intervals here, also those of the "
            "verdict, are of least squares."
        )
    if answer.errors:
        refused["errors"] = "Stated errors of instruments are in the verdict's intervals alone."
    made = ComparisonOfIntervals(
        name=problem.name,
        level=level,
        seed=seed,
        parameters=compared,
        bootstrap=None if found is None else _bootstrap_record(answer, found, replicates),
        posterior=None if drawn is None else PosteriorOfIntervals(
            chains=chains, draws=draws, orders=orders, diverged=int(drawn.diverging.sum()),
            priors={space.names[k]: list(p) for k, p in given.items()},
            r_hat={space.names[i]: float(drawn.r_hat[i]) for i in range(space.dimension)},
            effective={space.names[i]: float(drawn.effective[i]) for i in range(space.dimension)},
        ),
        refused=refused,
    )  # fmt: skip
    return IntervalsCompared(made.having(verdict=interval_sentences(made)), answer, profiles, found, drawn)


def check_wishes(kinds: Sequence[str], level: float, replicates: int, chains: int, draws: int) -> None:
    """Raise SpecError for a wish that cannot be met, and MissingExtra for a posterior where blackjax is not
    installed."""
    for kind in kinds:
        if kind not in KINDS:
            raise SpecError(f"There is no kind {kind!r} of interval; there are {', '.join(KINDS)}.")
    if not kinds:
        raise SpecError(f"Give at least one kind of interval: {', '.join(KINDS)}.")
    for name, value, low, high in (
        ("level", level, 0.5, 0.999), ("replicates", replicates, 50, 20_000), ("chains", chains, 2, 64),
        ("draws", draws, 100, 100_000),
    ):  # fmt: skip
        if not low <= value <= high:
            raise SpecError(f"{name} is {value:g}; give {low:g} to {high:g}.")
    if "posterior" in kinds:
        need_blackjax()


def _posterior(
    answer: Answer, z: np.ndarray, given: Mapping[int, tuple[float, float]], chains: int, draws: int, seed: int,
    say: Callable[[str], None], refused: dict[str, str],
) -> tuple[Draws | None, dict[str, int]]:  # fmt: skip
    problem = answer.problem
    if problem.space.dimension > MOST_SAMPLED:
        refused["posterior"] = (
            f"No posterior is drawn of {problem.space.dimension} free values; {MOST_SAMPLED} at most."
        )
        return None, {}
    noises = noise_of(problem, residuals_and_jacobian(problem.unsmoothed, z)[0])
    wrong = [n for n in noises if n.against]
    if wrong:
        refused["posterior"] = (
            f"No posterior is drawn: the residuals of {wrong[0].output} {wrong[0].against}, so they are not "
            "the noise that a likelihood is made of. `plantfit diagnose` looks for what the model lacks."
        )
        return None, {}
    found = posterior(
        problem, z, noises, given, chains=chains, draws=draws, seed=seed, tell=_counted(say, "posterior: draw")
    )
    return found, {n.output: n.order for n in noises}


def _counted(say: Callable[[str], None], what: str) -> Callable[[int, int], None]:
    return lambda done, of: say(f"{what} {done} of {of}")


def _degrees(problem: Problem, z: np.ndarray) -> float:
    """Degrees of freedom of Student's t for intervals by the covariance at the cube point z (d,), as the verdict has
    them."""
    residuals, blocks = residuals_and_jacobian(problem.unsmoothed, z)[0], residual_blocks(problem)
    return degrees_left(residuals, blocks, len(z), robust_errors(problem, residuals, blocks))[2]


def _row(
    answer: Answer, z: np.ndarray, i: int, rows: Mapping[str, Any], kinds: Sequence[str], level: float,
    profiles: Mapping[str, Profile],
    found: Bootstrap | None, drawn: Draws | None, refused: dict[str, str], silent: Collection[str], degrees: float,
) -> IntervalsOfParameter:  # fmt: skip
    """All intervals of one coordinate; `silent` are those that rest on an output of unknown noise, `degrees` those of
    freedom of Student's t."""
    problem = answer.problem
    c, value = problem.space.coordinates[i], float(np.asarray(problem.space.physical(z))[i])
    own = rows[c.name]
    all_of: list[KindOfInterval] = []
    if abs(level - VERDICTS) < 1e-9:
        all_of.append(_kind("verdict", own["low"], own["high"], c))
    for kind in kinds:
        if kind == "covariance":
            error = (own["by_noise"] or own)["standard_error"]
            half = None if error is None else float(stdtrit(degrees, 0.5 + level / 2)) * error
            all_of.append(
                _kind(kind, None if half is None else value - half, None if half is None else value + half, None)
            )
        elif kind == "profile" and c.name in profiles:
            p = profiles[c.name]
            more = {"points": p.points.tolist(), "excess": p.excess, "threshold": p.threshold, "inflation": p.inflation}
            all_of.append(_kind(kind, p.low, p.high, None, open_low=p.at_lower, open_high=p.at_upper, **more))
        elif kind == "bootstrap" and own["status"] == "flat" and c.name in silent:
            names = ", ".join(unknown_noise(problem))
            refused[f"bootstrap of {c.name}"] = (
                f"Nothing shows how large the errors of {names} are, so the bootstrap has no interval of {c.name}."
            )
            all_of.append(_kind(kind, None, None, None))
        elif kind == "bootstrap" and found is not None and len(found.values) > 1:
            refits = found.values[:, i]
            # on the scale of the search: of a parameter over decades a thousandth of the box is most of it
            drawn_at, at = _along(c, refits), float(_along(c, value))
            low, high = (float(v) for v in _back(c, percentiles(drawn_at, at, level, (0.0, 1.0))))
            if float(_along(c, high) - _along(c, low)) <= STILL:
                bound = min(at, 1.0 - at) <= STILL
                why = (
                    f"Refits leave {c.name} on its bound"
                    if bound
                    else f"Refits do not move {c.name}, for its samples are followed exactly"
                )
                refused[f"bootstrap of {c.name}"] = f"{why}, so the bootstrap has no interval of it."
                all_of.append(_kind(kind, None, None, None))
                continue
            all_of.append(_kind(kind, low, high, c, sample=_thinned(refits)))
        elif kind == "posterior" and drawn is not None:
            sample = drawn.values[:, :, i].ravel()
            low, high = np.quantile(sample, [0.5 - level / 2, 0.5 + level / 2])
            all_of.append(
                _kind(kind, float(low), float(high), c, sample=_thinned(sample), median=float(np.median(sample)))
            )
    return IntervalsOfParameter(
        name=c.name,
        unit=c.unit,
        value=value,
        standard_error=own["standard_error"],
        status=own["status"],
        scatters=own["by_noise"] is not None,
        kinds=all_of,
    )


def _kind(kind: str, low: float | None, high: float | None, c: Coordinate | None, **more: Any) -> KindOfInterval:
    """An interval; an end within a thousandth of the box from a bound (of c) is open."""
    if low is None or high is None or not (np.isfinite(low) and np.isfinite(high)):
        ends: dict[str, Any] = {"low": None, "high": None, "open_low": False, "open_high": False}
    else:
        ends = {"low": float(low), "high": float(high), "open_low": c is not None and bool(_along(c, low) <= EDGE),
                "open_high": c is not None and bool(_along(c, high) >= 1.0 - EDGE)}  # fmt: skip
    return KindOfInterval.model_validate({"kind": kind, **ends, **more})


def _along(c: Coordinate, value: Any) -> np.ndarray:
    """Where values are on the axis of the search, 0 at its lower bound and 1 at its upper one."""
    value = np.asarray(value, dtype=float)
    if not c.log:
        return (value - c.lower) / (c.upper - c.lower)
    return np.log(np.maximum(value, 1e-300) / c.lower) / np.log(c.upper / c.lower)


def _back(c: Coordinate, along: Any) -> np.ndarray:
    """The values at such places."""
    along = np.asarray(along, dtype=float)
    return c.lower * (c.upper / c.lower) ** along if c.log else c.lower + along * (c.upper - c.lower)


def _thinned(sample: np.ndarray) -> list[float]:
    """Up to 4000 values for a histogram."""
    return [float(f"{v:.6g}") for v in sample[:: max(1, len(sample) // 4000)]]


def _bootstrap_record(answer: Answer, found: Bootstrap, replicates: int) -> BootstrapOfIntervals:
    lengths = {o: max(len(i[o]) for i in answer.problem.data["index"].values()) for o in found.block}
    blocks = {o: int(n // found.block[o]) for o, n in lengths.items()}
    return BootstrapOfIntervals(replicates=replicates, lost=found.lost, block=found.block, blocks=blocks)
