"""`python -m benchmarks.diagnosis_cost`: what the whole diagnosis of the gear motor costs over its search, in one run.

Once as a user has it: `plantfit diagnose` over `plantfit run --no-diagnose`, both in new processes with warm caches, in
turns. Once inside one process: `diagnose` over `pf.fit` of the same study, whose models were compiled by a turn before.
Processor time; medians over turns of the ratio within a turn. Asked: at most ten.
"""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

SOURCE = Path(__file__).resolve().parent.parent / "src" / "plantfit" / "cases" / "gearmotor"
PLANTFIT = (sys.executable, "-c", "from plantfit.cli.start import run; run()")
ASKED = 10.0


def run(quick: bool) -> dict[str, float]:
    """Print both ratios and return them."""
    turns = 2 if quick else 5
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        for name in ("gearmotor.toml", "prbs.csv"):
            shutil.copy(next(SOURCE.rglob(name)), place / name)
        _commands(place)  # caches are filled
        commands = [_commands(place) for _ in range(turns)]
        inside = _inside(place / "gearmotor.toml", turns)
    figures = {}
    for name, pairs in (("new processes", commands), ("one process", inside)):
        search, diagnosis = (float(np.median([p[k] for p in pairs])) for k in (0, 1))
        figures[name] = float(np.median([b / a for a, b in pairs]))
        print(
            f"{name}: search {search:.2f} s, diagnosis {diagnosis:.2f} s of processor time, ratio {figures[name]:.1f} "
            f"(asked {ASKED:g})"
        )
    return figures


def _commands(place: Path) -> tuple[float, float]:
    (place / "plantfit.db").unlink(missing_ok=True)
    return _seconds(place, "run", "gearmotor.toml", "--no-diagnose"), _seconds(place, "diagnose", "gearmotor.toml")


def _seconds(place: Path, *words: str) -> float:
    """Processor time of a command and what it starts."""
    import resource

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([*PLANTFIT, *words], cwd=place, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _inside(spec: Path, turns: int) -> list[tuple[float, float]]:
    import plantfit as pf
    from plantfit.trust.diagnosis import diagnose

    found = []
    for _ in range(turns + 1):
        began = time.process_time()
        study = pf.load(spec)
        answer = pf.fit(study.problem, budget=study.plan.budget, runs=study.plan.runs, seed=study.plan.seed)
        between = time.process_time()
        diagnose(answer.problem, answer.best.x)
        found.append((between - began, time.process_time() - between))
    return found[1:]


if __name__ == "__main__":
    run("--quick" in sys.argv)
