"""Progress of a demo through parts that are no search."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Stage:
    """Where a demo stands, in the words of `optimize.Progress`; a run is one part."""

    method: str
    runs_done: int
    runs: int
    seconds: float
    evaluations: float
    budget_total: float
    best: float = math.inf
    seconds_left: float | None = None
    unit: str = "part"


def stages(names: tuple[str, ...], progress: Callable[[Any], None] | None) -> Callable[[str], None]:
    """A function that tells `progress` which of `names` begins."""
    began = time.monotonic()

    def begins(name: str) -> None:
        if progress is not None:
            done = names.index(name)
            progress(Stage(name, done, len(names), time.monotonic() - began, float(done), float(len(names))))

    return begins
