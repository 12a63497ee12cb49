"""Progress of a demo through parts that are no search."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any

from plantfit.control.tune.searching import parts
from plantfit.optimize.loop.progress import Progress


@dataclass(frozen=True, kw_only=True)
class Stage(Progress):
    """Where a demo stands; a run is one part."""

    method: str
    unit: str = "part"


def stages(names: tuple[str, ...], progress: Callable[[Any], None] | None) -> Callable[[str], None]:
    """A function that tells `progress` which of `names` begins."""
    began = time.monotonic()

    def begins(name: str) -> None:
        if progress is not None:
            done = names.index(name)
            seconds = time.monotonic() - began
            progress(Stage(done, len(names), float(done), float(len(names)), math.inf, seconds, None, method=name))

    return begins


def within(name: str, progress: Callable[[Any], None] | None) -> Callable[[Progress], None] | None:
    """For what a part does: tells `progress` how far its search, or a part of its own, is, under `name`."""
    if progress is None:
        return None
    tell, tell_part = progress, parts.within(progress, name)
    assert tell_part is not None

    def under(p: Progress) -> None:
        if isinstance(p, parts.PartProgress):
            tell_part(p)
        else:
            tell(Stage(**{f.name: getattr(p, f.name) for f in fields(Progress)}, method=name, unit="run"))

    return under
