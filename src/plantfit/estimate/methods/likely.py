"""Maximum likelihood in which process noise that the recordings do not ask for is left out."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from plantfit.errors import FlatLikelihood, SearchError
from plantfit.estimate.filters.maximum_likelihood import MaximumLikelihood, maximum_likelihood
from plantfit.estimate.filters.noise import Noise
from plantfit.estimate.methods.proposals import Proposal
from plantfit.problem.problem import Problem

NOT_NEEDED = (
    2.71  # twice the loss of log-likelihood at a level of 0 that chance exceeds in 5 of 100: half of chi-squared's tail
)
NEAR = 1e-3  # of the range of a level, in decades
WEAK = 0.6  # of a level: one whose interval begins higher is known well enough to be there


def likely(
    problem: Problem, proposal: Proposal, values: Mapping[str, float], budget: int = 300, seed: int = 0
) -> tuple[MaximumLikelihood, tuple[str, ...]]:
    """Maximum likelihood from `values` of the parameters and by its own starts, and a sentence for each level that was
    left out.

    Levels of process noise that were proposed are 0 where they lean on their lower bound, and where the likelihood
    loses no more than chance explains: 2.71 twice, the 5 % point of a variance on its bound (Self, Liang, J. Am.
    Statist. Assoc. 82 (1987) 605, case 5). Levels that the user gives are kept. Raises FlatLikelihood and SearchError
    as `maximum_likelihood`.
    """
    noise, told = proposal.noise, []
    start = dict(values) | dict(proposal.start)
    found: MaximumLikelihood | None = None
    while True:
        free = {f"process {n}" for n, v in noise.process.items() if isinstance(v, tuple)} & proposal.proposed
        if found is None:
            try:
                found = maximum_likelihood(problem, noise, budget=budget, seed=seed, start=_kept(start, noise))
            except FlatLikelihood as error:
                flat = sorted(set(error.names) & free)
                loose = [n for n in error.names if n in proposal.proposed and n.startswith("measurement ")]
                if not flat and loose:
                    raise SearchError(
                        "The recordings do not show how large the noise of "
                        f"{loose[0].removeprefix('measurement ')!r} is; give its standard deviation "
                        "as measurement ([estimate.measurement]), quantum / sqrt(12) for rounding."
                    ) from None
                if not flat:
                    raise
                noise = _without(noise, flat)
                told += [f"{name}: 0, the recordings do not show any" for name in flat]
                continue
        start = found.estimate.named
        low = sorted(n for n in free if _at_low(noise, n, start[n]))
        if low:
            noise, found = _without(noise, low), None
            told += [f"{name}: 0, the recordings ask for none" for name in low]
            continue
        weak = sorted(n for n in free if found.interval[n][0] <= max(_range(noise, n)[0] * (1 + NEAR), WEAK * start[n]))
        if not weak:
            return found, tuple(told)
        widths = {n: found.interval[n][1] / max(found.interval[n][0], 1e-300) for n in weak}
        name = max(weak, key=lambda n: widths[n])
        less = _without(noise, [name])
        try:
            without = maximum_likelihood(problem, less, budget=budget, seed=seed, start=_kept(start, less))
        except FlatLikelihood:
            return found, tuple(told)
        if 2.0 * (found.log_likelihood - without.log_likelihood) > NOT_NEEDED:
            return found, tuple(told)
        found, noise = without, less
        told.append(f"{name}: 0, the recordings do not ask for any beyond chance")


def _kept(start: Mapping[str, float], noise: Noise) -> dict[str, float]:
    """The start without levels that are held."""
    held = {
        f"{kind} {n}"
        for kind in ("process", "measurement")
        for n, v in getattr(noise, kind).items()
        if not isinstance(v, tuple)
    }
    return {n: v for n, v in start.items() if n not in held}


def _range(noise: Noise, name: str) -> tuple[float, float]:
    level = noise.process[name.removeprefix("process ")]
    assert isinstance(level, tuple)
    return level


def _at_low(noise: Noise, name: str, value: float) -> bool:
    low, high = _range(noise, name)
    return bool(np.log(value / low) <= NEAR * np.log(high / low))


def _without(noise: Noise, names: list[str]) -> Noise:
    gone = {n.removeprefix("process ") for n in names}
    return replace(noise, process={n: (0.0 if n in gone else v) for n, v in noise.process.items()})
