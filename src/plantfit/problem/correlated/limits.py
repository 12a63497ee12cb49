"""When noise that is correlated may be believed: how much samples tell of it, and how much of it is left."""

FEW = 8.0  # independent samples, below which it is hardly known how slow the noise is
SLOW = 0.05  # of the samples that are independent, below which what a model lacks is more likely than noise
LEFT = 0.1  # correlation of neighbours that may be left
MOST = 3e6  # samples times parameters, beyond which nobody waits for it
RARE = 2.576  # standard deviations that a normal variable exceeds, either way, in 1 % of draws


def enough(independent: float, samples: int) -> bool:
    """Whether so many samples, which are worth so many independent ones, show noise rather than a fault of the
    model."""
    return independent >= max(FEW, SLOW * samples)


def by_chance(correlation: float, samples: int) -> bool:
    """Whether so many independent samples have such a correlation of neighbours by chance, or one that does not
    matter."""
    return abs(correlation) <= max(LEFT, RARE / samples**0.5)
