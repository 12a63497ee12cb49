"""pyhms as a reference. It needs numpy < 2, so it lives in an environment of its own and is run as a subprocess.

`BBOB_PYHMS` names the folder of that environment, by default plantfit-pyhms in the temporary folder; it is made there
with `python3 -m venv` when it is missing and the package registry answers.
"""

import json
import os
import subprocess
import sys
import tempfile
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.bbob.suite import Run, seed_of

NEEDS = ("pyhms==1.0.0", "numpy<2", "coco-experiment==2.8.2")
ROOT = Path(__file__).resolve().parents[2]


class Missing(ImportError):
    """The environment could not be made; the sentence tells why."""


@lru_cache(maxsize=1)
def interpreter() -> Path:
    """The Python that has pyhms. Raises Missing."""
    folder = Path(os.environ.get("BBOB_PYHMS") or Path(tempfile.gettempdir()) / "plantfit-pyhms")
    python = folder / "bin" / "python"
    probe = [str(python), "-c", "import pyhms, cocoex"]
    if python.exists() and subprocess.run(probe, capture_output=True).returncode == 0:
        return python
    print(f"making an environment for pyhms in {folder}", flush=True)
    for command in (
        [sys.executable, "-m", "venv", str(folder)],
        [str(python), "-m", "pip", "install", "-q", *NEEDS],
        probe,
    ):
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=600)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise Missing(f"no environment for pyhms: {error}") from None
        if done.returncode != 0:
            raise Missing(f"no environment for pyhms: {(done.stderr.strip().splitlines() or ['it failed'])[-1]}")
    return python


def run_pyhms(runs: list[Run], seed: int, *, repaired: bool) -> float:
    """All runs in one subprocess, which gives back histories; processor seconds."""
    python, first = interpreter(), runs[0]
    function, dimension = first.problem.function, first.dimension
    task = {
        "function": function,
        "dimension": dimension,
        "budget": first.budget,
        "keep": first.keep,
        "repaired": repaired,
        "instances": [r.problem.instance for r in runs],
        "optima": [r.problem.optimum for r in runs],
        "seeds": [seed_of(seed, function, dimension, r.problem.instance) for r in runs],
    }
    with tempfile.TemporaryDirectory() as folder:
        given, out = Path(folder) / "task.json", Path(folder) / "out.npz"
        given.write_text(json.dumps(task))
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [str(python), "-m", "benchmarks.bbob.pyhms_worker", str(given), str(out)]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=ROOT)
        if done.returncode != 0:
            raise RuntimeError(f"pyhms failed: {done.stderr[-2000:]}")
        with np.load(out) as file:
            for k, run in enumerate(runs):
                run.evaluations = int(file["spent"][k])
                run.at, run.above = file[f"at{k}"].tolist(), file[f"above{k}"].tolist()
                run.best = min(run.above, default=np.inf)
                if run.keep:
                    run.points = [file[f"points{k}"]]
            return float(file["seconds"])
