"""`python -m benchmarks.startup`: how long a command takes from its start to its end, over `import jax` in the same
run.

Every turn starts each command once in a new process, one after another, so that other work on the machine falls on all
of them alike; a figure is the median over turns of the ratio within a turn. Modules are kept as bytecode, as after an
install. "Empty" is a run with an empty cache folder, else the cache is warm. "Small run" looks for nothing that is
missing in the model (`--no-diagnose`), which is a row of its own. The study is the heater's first-order model, 571
samples, from CSV to report.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

HEATER = Path(__file__).resolve().parent.parent / "src" / "plantfit" / "cases" / "heater"
ASKED = {"wrong file": 0.6, "check": 2.0, "small run": 4.0, "small run, empty cache": 8.0}  # times `import jax`
BASE = "import jax"

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
    """Print the tables and return the figures."""
    figures = commands(3 if quick else 9)
    with tempfile.TemporaryDirectory() as cache:
        cold, _ = _fit(cache)
        warm = sorted(_fit(cache) for _ in range(1 if quick else 5))
    again, imports = _median(warm)
    print(f"from Python: imports and set-up of a fit {imports:.2f} s")
    print(f"compile phase {cold:.2f} s in an empty cache, {again:.2f} s in a new process with the cache kept")
    return {**figures, "compile_cold_seconds": cold, "second_compile_over_first": again / cold}


def commands(turns: int) -> dict[str, float]:
    """Print what commands take over `import jax`, and return the figures."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for name in ("first_order.toml", "step_test.csv"):
            shutil.copy(HEATER / name, place / name)
        text = (place / "first_order.toml").read_text("utf-8")
        (place / "wrong.toml").write_text(text.replace("[search]", "[serch]"), "utf-8")
        calls = _calls(place)
        for call in calls.values():  # bytecode and caches are made
            call()
        seconds = [{name: call() for name, call in calls.items()} for _ in range(turns)]
    print(
        f"{'':24}{'s':>8}{'s of CPU':>10}{'over import jax, CPU':>22}{'asked':>7} "
        f" (medians of {turns} turns; in brackets the quartiles)"
    )
    figures: dict[str, float] = {"help_seconds": _median([turn["plantfit --help"][0] for turn in seconds])}
    for name in calls:
        wall, cpu = (_median([turn[name][k] for turn in seconds]) for k in (0, 1))
        ratios, of_cpu = (sorted(turn[name][k] / turn[BASE][k] for turn in seconds) for k in (0, 1))
        spread = f"({ratios[len(ratios) // 4]:.2f} to {ratios[-1 - len(ratios) // 4]:.2f})"
        print(
            f"{name:24}{wall:8.2f}{cpu:10.2f}{_median(ratios):6.2f} {spread} "
            f"{_median(of_cpu):6.2f}{ASKED.get(name, ''):>8}"
        )
        if name != BASE:
            figures[f"{name.replace('plantfit --', '').replace(',', '').replace(' ', '_')}_over_import_jax"] = _median(
                ratios
            )
    return figures


def _calls(place: Path) -> Mapping[str, Callable[[], tuple[float, float]]]:
    """By name what starts a new process and gives its seconds and those of its CPU."""
    script = str(Path(sys.executable).with_name("plantfit"))
    whole = [script, "run", "first_order.toml", "--store", "runs.db", "--out", "report.html"]
    run = [*whole, "--no-diagnose"]

    def timed(command: Sequence[str], code: int = 0, empty: bool = False) -> Callable[[], tuple[float, float]]:
        return lambda: _seconds(command, place, code, empty)

    return {
        BASE: timed([sys.executable, "-c", "import jax"]),
        "import plantfit": timed([sys.executable, "-c", "import plantfit"]),
        "plantfit --help": timed([script, "--help"]),
        "wrong file": timed([script, "check", "wrong.toml"], code=7),
        "check": timed([script, "check", "first_order.toml"]),
        "small run": timed(run),
        "small run, empty cache": timed(run, empty=True),
        "small run and diagnosis": timed(whole),
    }


def _seconds(command: Sequence[str], folder: Path, code: int, empty: bool) -> tuple[float, float]:
    """Seconds and seconds of CPU of a command that ends with `code`."""
    cache = folder / "cache"
    if empty:
        cache = folder / "empty"
        shutil.rmtree(cache, ignore_errors=True)
    environment = {**os.environ, "PLANTFIT_CACHE": str(cache)}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before, started = os.times(), time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment)
    wall, after = time.perf_counter() - started, os.times()
    if done.returncode != code:
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}, not {code}: {done.stderr}")
    return wall, after.children_user + after.children_system - before.children_user - before.children_system


def _median(values: Sequence):
    return sorted(values)[len(values) // 2]


def _fit(cache: str) -> tuple[float, float]:
    done = subprocess.run(
        [sys.executable, "-c", _FIT],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PLANTFIT_CACHE": cache},
    )
    first, second = done.stdout.split()
    return float(first), float(second)


if __name__ == "__main__":
    commands(3 if os.environ.get("QUICK", "") not in ("", "0") else 9)
