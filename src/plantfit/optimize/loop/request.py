"""One search as `minimise` was asked for it, checked."""

from collections.abc import Callable
from dataclasses import dataclass

from plantfit.optimize.contract import Objective
from plantfit.optimize.loop.checkpoint import Checkpoint
from plantfit.optimize.loop.progress import Progress


@dataclass(frozen=True)
class Plan:
    """Runs first_run .. first_run + runs - 1 of a method, with the callbacks that watch them."""

    objective: Objective
    name: str
    identity: str
    runs: int
    first_run: int
    budget: int
    seed: int
    target: float | None
    stagnation: int | None
    progress: Callable[[Progress], None] | None
    checkpoint: Callable[[Checkpoint], None] | None
    resume: Checkpoint | None
    stop: Callable[[], bool] | None

    def stopped(self) -> bool:
        return self.stop is not None and self.stop()
