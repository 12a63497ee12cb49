"""Fit one study file of a demo."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.fitting import Answer, fit
from plantfit.spec import load


def fit_file(path: Path, progress: Callable[[Any], None] | None = None, method: str | None = None) -> Answer:
    """The answer of `method`, by default the first that a study file names, which then makes as many runs as the
    file says."""
    study = load(path)
    plan = study.plan
    runs, method = 1 if method else plan.runs, method or plan.methods[0]
    return fit(
        study.problem,
        method,
        runs=runs,
        budget=plan.budget,
        seed=plan.seed,
        settings=plan.settings.get(method),
        progress=progress,
        spec=study.text,
        command=f"plantfit run {path.name}",
    )


def residual(answer: Answer, output: str, recording: str | None = None) -> np.ndarray:
    """Simulated minus measured output (n,) over a whole recording, in the output's unit."""
    name = recording or next(iter(answer.problem.experiments))
    return answer.predict(name)[output] - answer.problem.experiments[name].recording[output]


def part(answer: Answer, which: str, recording: str | None = None) -> np.ndarray:
    """Samples (n,) bool of part "fit" or "validation"."""
    name = recording or next(iter(answer.problem.experiments))
    return answer.problem.experiments[name].mask(which)


def rms(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
