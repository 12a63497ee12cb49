"""What one method did on one function in one dimension, kept in one small file."""

import json
import os
import tempfile
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.bbob.suite import TARGETS, Run


@dataclass(frozen=True)
class Result:
    """Runs on the instances (k,) of a function: evaluations spent (k,), and for each run the improvements.

    `at[i]` and `above[i]` are evaluations and distances to the optimum of run i at its improvements. `seconds` is
    processor time of all runs; `about` tells package, version, settings.
    """

    method: str
    function: int
    dimension: int
    budget: int
    instances: np.ndarray
    spent: np.ndarray
    at: list[np.ndarray]
    above: list[np.ndarray]
    seconds: float
    about: dict[str, Any] = field(default_factory=dict)

    def hits(self) -> np.ndarray:
        """Evaluations (k, 51) until each target was reached, inf where it was not."""
        return np.array([first_hits(at, above) for at, above in zip(self.at, self.above, strict=True)]).reshape(
            -1, len(TARGETS)
        )

    def only(self, instances: Any) -> "Result":
        """The runs on these instances alone."""
        rows = np.flatnonzero(np.isin(self.instances, instances))
        at, above = ([part[i] for i in rows] for part in (self.at, self.above))
        return replace(self, instances=self.instances[rows], spent=self.spent[rows], at=at, above=above)


def first_hits(at: Any, above: Any) -> np.ndarray:
    """Evaluations (51,) at which improvements `above` at evaluations `at` first reached each target; inf if never."""
    at, above = np.asarray(at, dtype=float), np.asarray(above, dtype=float)
    reached = above[:, None] <= TARGETS
    return np.min(np.where(reached, at[:, None], np.inf), axis=0, initial=np.inf)


def from_runs(method: str, runs: list[Run], seconds: float, about: dict[str, Any]) -> Result:
    first = runs[0]
    return Result(
        method, first.problem.function, first.dimension, first.budget,
        np.array([r.problem.instance for r in runs]), np.array([r.evaluations for r in runs]),
        [np.array(r.at, dtype=np.int64) for r in runs], [np.array(r.above) for r in runs], seconds, about,
    )  # fmt: skip


def path_of(folder: Path, method: str, function: int, dimension: int) -> Path:
    return folder / "results" / method / f"f{function:02}_d{dimension:02}.npz"


def save(result: Result, folder: Path) -> None:
    """Write the file at once, so that a killed process leaves it whole or not at all."""
    path = path_of(folder, result.method, result.function, result.dimension)
    path.parent.mkdir(parents=True, exist_ok=True)
    facts = {"method": result.method, "function": result.function, "dimension": result.dimension,
             "budget": result.budget,
             "seconds": result.seconds, "about": result.about}  # fmt: skip
    with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".part", delete=False) as file:
        np.savez_compressed(
            file,
            facts=np.array(json.dumps(facts)),
            instances=result.instances,
            spent=result.spent,
            lengths=np.array([len(a) for a in result.at]),
            at=np.concatenate(result.at),
            above=np.concatenate(result.above),
        )
    os.replace(file.name, path)


def load(path: Path) -> Result:
    with np.load(path) as file:
        facts = json.loads(str(file["facts"]))
        ends = np.cumsum(file["lengths"])[:-1]
        return Result(
            facts["method"], facts["function"], facts["dimension"], facts["budget"], file["instances"], file["spent"],
            np.split(file["at"], ends), np.split(file["above"], ends), facts["seconds"], facts["about"],
        )  # fmt: skip


def load_all(folder: Path) -> list[Result]:
    """Every result under the folder, in a fixed order."""
    return [load(path) for path in sorted((folder / "results").glob("*/*.npz"))]
