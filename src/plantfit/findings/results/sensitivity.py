"""`plantfit sensitivity`: which groups of parameters the cost reacts to."""

from typing import Literal

from plantfit.findings.record import Number, Printed, Record


class ElementaryEffect(Record):
    """Of one group by Morris screening, in units of the cost over the whole width that was looked at."""

    group: str
    coordinates: int
    mu_star: Number
    """Mean of the absolute effects."""
    half_width: Number
    """Of the bootstrap interval of `mu_star`."""
    mu: Number
    """Mean of the effects; None for a group of several coordinates."""
    sigma: Number
    """Standard deviation of the effects; None for a group of several coordinates."""


class VarianceShare(Record):
    """Shares of the variance of the cost that one group makes: Sobol indices."""

    group: str
    coordinates: int
    first: Number
    """By the group alone."""
    first_half_width: Number
    """Of its bootstrap interval."""
    total: Number
    """With all its interactions."""
    total_half_width: Number


class Sensitivities(Printed):
    """What `plantfit.trust.sensitivity` finds, by Morris screening or Sobol indices."""

    name: str = ""
    """Of the study; `--json` alone."""
    method: Literal["morris", "sobol"]
    radius: Number
    """Share of the bounds around the point that was looked at; None for the whole box."""
    confidence: float
    """Of the intervals."""
    evaluations: int
    trajectories: int | None = None
    """Of the screening."""
    samples: int | None = None
    """Of the indices."""
    dropped: int
    """Trajectories or samples that held a run that failed."""
    groups: list[ElementaryEffect | VarianceShare]
    page: str | None = None
    """File; `--json` alone."""
