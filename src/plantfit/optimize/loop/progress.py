"""What a search tells about itself while it runs."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Progress:
    """Where a search stands. `seconds_left` is an estimate from the pace so far, None before the first."""

    runs_done: int
    runs: int
    evaluations: float
    budget_total: float
    best: float
    seconds: float
    seconds_left: float | None


def estimate(
    runs_done: int, runs: int, evaluations: float, skipped: float, budget_total: float, best: float, seconds: float
) -> Progress:
    """A `Progress` whose remaining time assumes the pace so far; `skipped` evaluations came from a checkpoint
    or were saved by runs that ended early, and cost no time."""
    worked = evaluations - skipped
    left = max(budget_total - evaluations, 0.0) * seconds / worked if worked > 0 else None
    return Progress(runs_done, runs, evaluations, budget_total, best, seconds, 0.0 if runs_done == runs else left)
