"""COCO logs that `python -m cocopp FOLDER/logs/METHOD` reads: runs replayed through an observed problem.

COCO ends the process when a second problem is observed before the first is closed, so runs side by side cannot be
observed as they happen; the points of each are kept and evaluated again, one problem after another.
"""

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.bbob.suite import Run, coco_suite


def log_folder(folder: Path, method: str, function: int, dimension: int) -> Path:
    return folder / "logs" / method / f"f{function:02}_d{dimension:02}"


def write_logs(runs: list[Run], folder: Path, method: str, info: str) -> None:
    """Replay runs of one function and dimension that kept their points, into a folder that appears when it is whole."""
    import cocoex

    first = runs[0]
    target = log_folder(folder, method, first.problem.function, first.dimension)
    target.parent.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(prefix="part-", dir=folder))
    cocoex.log_level("error")
    words = "".join(c if c.isalnum() or c in " .,=()-" else " " for c in info)
    observer = cocoex.Observer(
        "bbob", f'outer_folder: {made} result_folder: {target.name} algorithm_name: {method} algorithm_info: "{words}"'
    )
    for run in runs:
        problem = coco_suite(run.dimension).get_problem_by_function_dimension_instance(
            run.problem.function, run.dimension, run.problem.instance, observer
        )
        for x in np.concatenate(run.points):
            problem(x)
        problem.free()
    del observer
    if target.exists():
        shutil.rmtree(target)
    os.replace(made / target.name, target)
    shutil.rmtree(made)
