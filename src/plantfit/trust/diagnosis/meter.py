"""What a diagnosis spends, in evaluations of the cost, as searches count them; where it stops."""

from collections.abc import Callable
from dataclasses import dataclass


class Stopped(Exception):
    """Somebody asked for the end of a diagnosis."""


@dataclass
class Meter:
    """`spent` and at most `limit` evaluations of the cost. `stop` is asked before each simulation; True ends the
    diagnosis, with `Stopped` or, where it `winds_up`, as if no more work were allowed: what was tried is kept.

    Work is counted and not timed, so that the same answer gives the same diagnosis on every machine.
    """

    limit: float = float("inf")
    stop: Callable[[], bool] | None = None
    spent: float = 0.0
    winds_up: bool = False

    @property
    def stopped(self) -> bool:
        """Whether the end was asked for."""
        return self.stop is not None and self.stop()

    def charge(self, evaluations: float) -> None:
        """Count work that is about to be done. Raises Stopped where the end was asked for."""
        if self.stopped and not self.winds_up:
            raise Stopped
        self.spent += evaluations

    def holds(self, evaluations: float, share: float = 1.0, since: float = 0.0) -> bool:
        """Whether so many more evaluations stay within a share of what was left when `since` were spent."""
        return not self.stopped and self.spent + evaluations - since <= share * (self.limit - since)
