"""Recordings of several lengths simulated by one program: a short one goes on under its last inputs, and what lies
behind its end is left out.

A program is compiled for one number of samples. Ten recordings of ten lengths would take ten programs, each some
tenths of a second, where a sample takes less than a millionth of one.
"""

from collections.abc import Iterable

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.simulate.simulator import Drive
from plantfit.simulate.steps.grid import Pieces

LONGEST = 10_000  # samples up to which recordings go on
TIMES = 10  # the samples of its own, at most


def as_long_as_others(drive: Drive, others: Iterable[Drive]) -> Drive:
    """The drive with as many samples and edges of delayed inputs as the longest of `others`; itself where that costs
    more than a program, or where its times or its past are of its own."""
    alike = [o for o in others if _may_go_on(o)]
    count = max((len(o.t) for o in alike), default=0)
    if not _may_go_on(drive) or not len(drive.t) <= count <= min(LONGEST, TIMES * len(drive.t)):
        return drive
    edges = (max(len(pieces.knots) for pieces in channel) for channel in zip(*(o.delayed for o in alike), strict=True))
    more, step = count - len(drive.t), drive.t[-1] - drive.t[-2]
    return drive._replace(
        t=np.append(drive.t, drive.t[-1] + step * np.arange(1, more + 1)),
        value=tuple(np.append(v, np.full(more, v[-1])) for v in drive.value),
        slope=tuple(np.append(s, np.zeros(more)) for s in drive.slope),
        delayed=tuple(_with_edges(p, e) for p, e in zip(drive.delayed, edges, strict=True)),
    )


def _may_go_on(drive: Drive) -> bool:
    return drive.samples is None and drive.jumps is None and drive.ring is None and len(drive.t) > 1


def _with_edges(pieces: Pieces, count: int) -> Pieces:
    """The same pieces and others that never begin, `count` edges in all."""
    more = count - len(pieces.knots)
    return Pieces(
        np.append(pieces.value, np.full(more, pieces.value[-1])),
        np.append(pieces.slope, np.zeros(more)),
        np.append(pieces.origin, np.full(more, pieces.origin[-1])),
        np.append(pieces.knots, np.full(more, np.inf)),
    )
