"""What a diagnosis spends, in evaluations of the cost, as searches count them; where it stops."""

from collections.abc import Callable
from dataclasses import dataclass


class Stopped(Exception):
    """Somebody asked for the end of a diagnosis."""


@dataclass
class Meter:
    """`spent` and at most `limit` evaluations of the cost. `stop` is asked before each simulation; True ends the diagnosis.

    Work is counted and not timed, so that the same answer gives the same diagnosis on every machine.
    """

    limit: float = float("inf")
    stop: Callable[[], bool] | None = None
    spent: float = 0.0

    def charge(self, evaluations: float) -> None:
        """Count work that is about to be done. Raises Stopped where the end was asked for."""
        if self.stop is not None and self.stop():
            raise Stopped
        self.spent += evaluations

    def holds(self, evaluations: float, share: float = 1.0, since: float = 0.0) -> bool:
        """Whether so many more evaluations stay within a share of what was left when `since` were spent."""
        return self.spent + evaluations - since <= share * (self.limit - since)
