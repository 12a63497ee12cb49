"""How long the first answer takes: `plantfit --help`, and a second fit of the same shape."""

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

_FIT = """
import time, numpy as np
started = time.perf_counter()
from benchmarks.plant import model, record
from plantfit.problem import Problem
from plantfit.recording.record import Recording, Signal
t, u = record(2000)
problem = Problem(model(), Recording(t, {"u": Signal(u), "y": Signal(np.sin(t))}), substeps=2)
z = np.full(problem.space.dimension, 0.5)
imported = time.perf_counter()
problem.costs(z[None, :]); problem.value_and_gradient(z); problem.residuals_and_jacobian(z)
print(time.perf_counter() - imported, imported - started)
"""


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures."""
    script = Path(sys.executable).with_name("plantfit")
    helps = sorted(_seconds([str(script), "--help"]) for _ in range(3 if quick else 9))
    with tempfile.TemporaryDirectory() as cache:
        cold, _ = _fit(cache)
        warm = sorted(_fit(cache) for _ in range(1 if quick else 5))
    again, imports = warm[len(warm) // 2]
    print(f"plantfit --help {helps[len(helps) // 2]:.2f} s; imports and set-up of a fit {imports:.2f} s")
    print(f"compile phase {cold:.2f} s in an empty cache, {again:.2f} s in a new process with the cache kept")
    return {"help_seconds": helps[len(helps) // 2], "compile_cold_seconds": cold, "second_compile_over_first": again / cold}


def _seconds(command: list[str]) -> float:
    started = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - started


def _fit(cache: str) -> tuple[float, float]:
    done = subprocess.run(
        [sys.executable, "-c", _FIT], check=True, capture_output=True, text=True, env={**os.environ, "PLANTFIT_CACHE": cache}
    )
    first, second = done.stdout.split()
    return float(first), float(second)
