"""Kalman filters over a study's recordings, begun in the middle of the box, or at the answer where they lose their
way from there."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Protocol

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import SimulationError
from plantfit.estimate.comparison import SURE
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.filters.consistency import Consistency, chi_squared_test
from plantfit.estimate.filters.kalman import ekf, kalman_filter, ukf
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.filters.state_space import LOGIT_SPREAD
from plantfit.estimate.methods.levels import Asked
from plantfit.estimate.methods.over_records import Runs, over_recordings
from plantfit.problem.problem import Problem

FILTERS = {"ekf": "EKF", "ukf": "UKF", "kalman": "Kalman filter"}
NEAR = 5.0  # standard errors that a filter begins with near the answer; narrows its intervals by 2 %


class Wished(Protocol):
    """What is asked of the filters: which `methods`, where they `begin` ("box" or "answer"), and `kappa` of the UKF."""

    @property
    def methods(self) -> Sequence[str]: ...
    @property
    def begin(self) -> str: ...
    @property
    def kappa(self) -> float: ...


def filtered(
    problem: Problem,
    noise: Noise,
    wished: Wished,
    told: Asked,
    known: tuple[Mapping[str, float], Mapping[str, float]],
    say: Callable[[str], None],
) -> tuple[dict[str, Runs], list[str]]:
    """Runs by method, and what was assumed for them; `known` are values that are believed, and their standard
    errors."""
    believed, errors = known  # values and standard errors
    late = {d.parameter for d in problem.model.delays}  # pyrefly: ignore[missing-attribute]
    held = {c.name: believed[c.name] for c in problem.space.coordinates if c.parameter in late}
    names = [n for n in problem.space.names if n not in held]
    kinds: dict[str, Callable[..., Any]] = {"ekf": ekf, "ukf": partial(ukf, kappa=wished.kappa), "kalman": _plain}
    remarks = [
        f"{n}: held at {v:.5g} in the filters, because a dead time cannot "
        "be a state; their intervals leave out what is not known of it"
        for n, v in held.items()
    ]
    found: dict[str, Runs] = {}
    twice: list[str] = []
    for method in dict.fromkeys(m for m in wished.methods if m in FILTERS):
        say(FILTERS[method])
        if method == "kalman":
            found[method] = over_recordings(_plain, problem, noise, (), at=believed, prior={}, drift={})
            continue
        begun: Runs | None = None
        run = partial(over_recordings, kinds[method], problem, noise, names, made={})
        if wished.begin == "box":
            prior, drift = told.spreads(problem, names, held)
            with suppress(SimulationError):
                begun = run(at=held, prior=prior, drift=drift)
                if (
                    not prior and not drift
                ):  # what is known beforehand counts once, and what wanders ends elsewhere than it began
                    begun = _again(run, problem, begun.estimate, believed, held, names)
                    twice.append(FILTERS[method])
        if begun is None or _too_sure(begun):
            twice = [name for name in twice if name != FILTERS[method]]  # the run that counts is another
            at = _inside(problem, believed)
            prior, drift = told.spreads(problem, names, at)
            near = _near(problem, at, errors, names)
            again = run(at=at, prior=near | prior, drift=drift)
            if wished.begin == "box":
                why = (
                    "it diverged"
                    if begun is None
                    else f"its innovations were {_factor(begun):.2g} times as large as it expected"
                )
                remarks.append(
                    f"{FILTERS[method]}: began at the answer, {NEAR:g} standard errors wide, because from the middle "
                    f"of the box {why}"
                )
            begun = again
        found[method] = begun
    if twice:
        remarks.append(
            f"{' and '.join(twice)}: ran twice, from the middle of the box and then from where that ended, "
            f"{NEAR:g} standard errors wide, because tangents taken far from the answer make intervals too narrow"
        )
    return found, remarks


def innovation_size(runs: Runs) -> Consistency:
    """Whether the innovations of all recordings are as large as the filter expects."""
    every = list(runs.runs.values())
    measured = np.concatenate([r.measured[r.measured > 0] for r in every])
    return chi_squared_test(np.concatenate([r.nis[r.measured > 0] for r in every]), measured)


def _again(
    run: Callable[..., Runs],
    problem: Problem,
    first: Estimate,
    believed: Mapping[str, float],
    held: Mapping[str, float],
    names: Sequence[str],
) -> Runs:
    """A filter run once more from where it ended."""
    own, errors = (dict(zip(first.names, v.tolist(), strict=True)) for v in (first.values, first.standard_error))
    at = {**_inside(problem, {**believed, **own}), **held}
    return run(at=at, prior=_near(problem, at, errors, names), drift={})


def _factor(runs: Runs) -> float:
    """By how much innovations are larger than a filter expects."""
    return float(
        np.sqrt(innovation_size(runs).mean / np.mean([np.mean(r.measured[r.measured > 0]) for r in runs.runs.values()]))
    )


def _too_sure(runs: Runs) -> bool:
    """Whether innovations are larger than a filter expects: curvature has misled it on its way from the box."""
    nis = innovation_size(runs)
    return nis.p_value < SURE and nis.mean > nis.high


def _near(
    problem: Problem, at: Mapping[str, float], errors: Mapping[str, float], names: Sequence[str]
) -> dict[str, float]:
    """Standard deviations of the filter's states of parameters that stand for so many standard errors, no wider than
    the box."""
    found = {}
    for c in problem.space.coordinates:
        if c.name in names and np.isfinite(errors.get(c.name, np.nan)) and errors[c.name] > 0:
            low, high, v = c.lower, c.upper, at[c.name]
            slope = 1.0 / v if c.log else (high - low) / ((v - low) * (high - v))
            widest = 0.25 * np.log(high / low) if c.log else LOGIT_SPREAD
            found[c.name] = float(min(NEAR * errors[c.name] * slope, widest))
    return found


def _plain(
    problem: Problem, noise: Noise, parameters: Sequence[str], *, at: Any, prior: Any, drift: Any, recording: str
) -> Any:
    return kalman_filter(problem, noise, at=at, recording=recording)


def _inside(problem: Problem, values: Mapping[str, float]) -> dict[str, float]:
    """Values a hundredth of the box away from its bounds at least, where a bounded parameter can still move."""
    space = problem.space
    z = np.clip(np.asarray(space.cube(space.vector(values))), 0.01, 0.99)
    return dict(zip(space.names, np.asarray(space.physical(z)).tolist(), strict=True))
