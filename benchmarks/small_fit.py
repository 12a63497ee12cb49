"""`python -m benchmarks.small_fit`: a small fit against `import jax`, both in the same process, with a warm cache.

The heater's first-order model, 571 samples: choosing the steps, search, finish and judging. `plantfit`'s own imports
are told apart.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ASKED = 2.5  # times `import jax`
STUDY = Path(__file__).resolve().parent.parent / "src" / "plantfit" / "cases" / "heater" / "first_order.toml"

_FIT = """
import json, sys, time
marks = [time.perf_counter()]
def mark():
    marks.append(time.perf_counter())
import jax
mark()
from plantfit import spec
from plantfit.optimize import minimise
from plantfit.stages import Answer, finish, prepare
mark()
study = spec.load(sys.argv[1])
mark()
prepared = prepare(study.problem)
mark()
runs = minimise(prepared.objective, "auto", budget=study.plan.budget, seed=study.plan.seed)
mark()
problem, runs = finish(prepared.problem, runs)
mark()
findings = Answer(problem, runs, 1).findings
mark()
names = ("import jax", "import plantfit", "read", "prepare", "search", "finish", "judge")
print(json.dumps({n: b - a for n, a, b in zip(names, marks, marks[1:])}))
"""


def run(quick: bool) -> dict[str, float]:
    """Print the table and return the figures: medians over processes."""
    with tempfile.TemporaryDirectory() as cache:
        cold = _fit(cache)
        warm = [_fit(cache) for _ in range(3 if quick else 7)]
    ratios = sorted(_ratio(w) for w in warm)
    print(f"{'':18}{'cold':>8}{'warm':>8}  s (first order, 571 samples)")
    for name in cold:
        print(f"{name:18}{cold[name]:8.3f}{_median([w[name] for w in warm]):8.3f}")
    ratio = _median(ratios)
    print(
        f"prepare + search + finish + judge over import jax: {ratio:.2f} ({ratios[0]:.2f} to {ratios[-1]:.2f}); asked: "
        f"at most {ASKED}"
    )
    return {
        "small_fit_over_import_jax": ratio,
        "small_fit_finish_over_search": _median([w["finish"] / w["search"] for w in warm]),
    }


def _ratio(seconds: dict[str, float]) -> float:
    return sum(seconds[n] for n in ("prepare", "search", "finish", "judge")) / seconds["import jax"]


def _median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def _fit(cache: str) -> dict[str, float]:
    done = subprocess.run(
        [sys.executable, "-c", _FIT, str(STUDY)],
        check=True,
        capture_output=True,
        text=True,
        env={**os.environ, "PLANTFIT_CACHE": cache},
    )
    return json.loads(done.stdout)


if __name__ == "__main__":
    run(os.environ.get("QUICK", "") not in ("", "0"))
