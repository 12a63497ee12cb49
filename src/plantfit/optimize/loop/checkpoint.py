"""The exact middle of a search as plain arrays, so that it can be stored and taken up again."""

import io
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plantfit.errors import SearchError, Status
from plantfit.optimize.contract import RunResult

FORMAT = 2  # of the arrays; counts up when the loop's carry or history changes
NO_HISTORY = np.zeros((0, 0, 2))


@dataclass(frozen=True)
class Checkpoint:
    """Finished runs and, for population methods, the arrays of the group of runs under way.

    `identity` describes the search; resuming another search with it is refused. `arrays` are the leaves
    of the loop's carry, `history` (generations, runs of the group, 2) evaluations and best costs so far.
    """

    identity: str
    finished: tuple[RunResult, ...] = ()
    arrays: tuple[np.ndarray, ...] = ()
    history: np.ndarray = field(default_factory=lambda: NO_HISTORY)

    def to_bytes(self) -> bytes:
        """An npz archive without pickles; seconds and `extra` travel as JSON."""
        table: dict[str, Any] = {"history": self.history}
        head = {
            "format": FORMAT,
            "identity": self.identity,
            "arrays": len(self.arrays),
            "finished": [_head(r) for r in self.finished],
        }
        table["head"] = np.array(json.dumps(head))
        for i, array in enumerate(self.arrays):
            table[f"array{i}"] = array
        for i, run in enumerate(self.finished):
            table[f"x{i}"], table[f"n{i}"], table[f"f{i}"] = run.x, run.history_evaluations, run.history_cost
        buffer = io.BytesIO()
        np.savez(buffer, **table)
        return buffer.getvalue()

    @staticmethod
    def from_bytes(data: bytes) -> "Checkpoint":
        """The inverse of `to_bytes`. Raises SearchError for bytes that are not a whole checkpoint."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as table:
                head = json.loads(str(table["head"]))
                if head.get("format") != FORMAT:
                    raise ValueError("written by another version")
                arrays = tuple(table[f"array{i}"] for i in range(head["arrays"]))
                runs = tuple(
                    _run(h, table[f"x{i}"], table[f"n{i}"], table[f"f{i}"]) for i, h in enumerate(head["finished"])
                )
                return Checkpoint(head["identity"], runs, arrays, table["history"])
        except Exception as error:
            # a damaged archive can fail in zipfile, numpy or json; all mean the same to the caller
            raise SearchError(
                f"A checkpoint of {len(data)} bytes cannot be read ({type(error).__name__}); start the search anew."
            ) from error


_PLAIN = ("method", "run", "seed", "cost", "evaluations", "seconds", "failures", "extra")


def _head(run: RunResult) -> dict[str, Any]:
    return {**{name: getattr(run, name) for name in _PLAIN}, "status": run.status.value}


def _run(head: dict[str, Any], x: np.ndarray, evaluations: np.ndarray, cost: np.ndarray) -> RunResult:
    own = dict[str, Any](head, status=Status(head["status"]))
    return RunResult(**own, x=x, history_evaluations=evaluations, history_cost=cost)
