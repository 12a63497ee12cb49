"""Rows of a table without times that do not hang on one another: those of a plant at rest, and no motion."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np

from plantfit.cli.commands.begin.study_text import SPLIT

if TYPE_CHECKING:
    from plantfit.cli.commands.begin.study_text import Link
    from plantfit.recording.description import Description
    from plantfit.recording.readers.columns import Table

FEWEST = 5  # rows: of fewer nothing is told
BACK = 8  # rows before one that it may hang on
CHANCE = 3.0  # standard deviations of a correlation that is none
MOST_BACK = 4  # times as many rows as are looked back
LEVELS = 0.5  # of the rows that are sorted by an input: different values of it

Order = Literal["any", "sorted"]
TOLD: dict[Order, str] = {
    "any": "no row hangs on those before it",
    "sorted": "the rows are sorted by the input",
}
CLOCK = """\
period = 1.0           # the rows have no times
steady = true          # every row is the plant at rest"""
SPLITS: dict[Order, str] = {
    "any": SPLIT,
    "sorted": "# split = 0.7          # left out: the rows are sorted, and the last ones lie beyond the others\n",
}


def rows_at_rest(content: "Table", found: "Description", links: Sequence["Link"]) -> Order | None:
    """How the rows of a table without times lie where they are no motion; None where they may be one.

    They are none where inputs and outputs do not correlate with any of them some rows before, and where they are sorted
    by an input that takes many values, which no test signal does.
    """
    from plantfit.recording.readers.long_tables import widened
    from plantfit.recording.readers.numbers import casted

    if found.time is not None or found.period or found.rows < FEWEST:
        return None
    table = widened(content)

    def values(header: str) -> np.ndarray:
        return np.asarray(casted(table, table.column(header, "a signal").cells).values, dtype=float)

    inputs = {c.header: values(c.header) for link in links for u in link.inputs for c in u.read}
    outputs = {link.output.header: values(link.output.header) for link in links}
    for u in inputs.values():
        steps = np.diff(u[np.isfinite(u)])
        if (np.all(steps >= 0) or np.all(steps <= 0)) and np.sum(steps != 0) >= LEVELS * found.rows:
            return "sorted"
    before = [*inputs.values(), *outputs.values()]
    hangs = any(_hangs(a, b) for b in before for a in before)
    return None if hangs else "any"


def _hangs(later: np.ndarray, earlier: np.ndarray) -> bool:
    """Whether a column correlates with one of some rows before, beyond chance."""
    for k in range(1, min(BACK, len(later) // MOST_BACK) + 1):
        a, b = later[k:], earlier[:-k]
        both = np.isfinite(a) & np.isfinite(b)
        a, b = a[both], b[both]
        if len(a) < FEWEST - 1 or np.ptp(a) == 0 or np.ptp(b) == 0:
            continue
        if abs(np.corrcoef(a, b)[0, 1]) > CHANCE / np.sqrt(len(a)):
            return True
    return False
