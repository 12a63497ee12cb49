"""What a design tells while it runs: which part it is at, and which search of how many."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from plantfit.optimize.loop.progress import Progress

Tell = Callable[[Any], None]


@dataclass(frozen=True)
class PartProgress(Progress):
    """Where one `part` of a design stands, its figures those of this part alone; `begins` where nothing of it is
    counted yet."""

    part: str
    begins: bool = False


def begins(tell: Tell | None, part: str) -> None:
    """Tells that a part begins which takes its time."""
    if tell is not None:
        tell(PartProgress(0, 1, 0.0, 1.0, float("inf"), 0.0, None, part, True))


def within(tell: Tell | None, whole: str) -> Tell | None:
    """A callback for the parts of a part, as in level 1 of 3."""
    return None if tell is None else lambda p: tell(replace(p, part=f"{whole}, {p.part}"))


class Searches:
    """Callbacks for searches one after another, `count` of them."""

    def __init__(self, tell: Tell | None, count: int):
        self._tell, self._count, self._begun = tell, count, 0

    def next(self, what: str) -> Tell | None:
        """Tells that the next search begins, one of `what`; the callback for its `Progress`."""
        self._begun += 1
        part, tell = f"search {self._begun} of {self._count} ({what})", self._tell
        begins(tell, part)
        if tell is None:
            return None
        return lambda p: tell(PartProgress(**vars(p), part=part))
