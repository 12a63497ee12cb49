"""A problem in three lines of text."""

from typing import Any

import numpy as np

from plantfit.problem.measure.experiment import Experiment
from plantfit.recording.told import listed, span
from plantfit.simulate.simulator import ADAPTIVE


def problem_text(problem: Any) -> str:
    """Of a `Problem`: the model with its parameters, the recordings with what is fitted and kept unseen, the outputs
    with their inputs."""
    held = [n for n, p in problem.space.parameters.items() if p.value is not None]
    kept = f"; held: {listed(held)}" if held else ""
    reads = {n: u for n, u in problem.predictor.needs.items() if n not in problem.outputs}
    recordings = listed([f"{n} ({_parts(e)})" for n, e in problem.experiments.items()], 4)
    return "\n".join(
        [
            f"Problem {problem.name!r}: model {problem.model.name!r}, {problem.space.dimension} free: "
            f"{listed(problem.space.names)}{kept}",
            f"  recordings: {recordings}",
            f"  outputs: {listed([_with_unit(problem, o) for o in problem.outputs])}; "
            f"inputs: {listed([_with_unit(problem, n) for n in reads]) or 'none'}",
        ]
    )


def steps_text(stepper: str | None, substeps: float) -> str:
    """How long steps are: "4 step(s) a sample" or "adaptive steps of fineness 2"."""
    return f"adaptive steps of fineness {substeps}" if stepper == ADAPTIVE else f"{substeps} step(s) a sample"


def _parts(experiment: Experiment) -> str:
    """How many samples over which time, and how many of them are fitted and kept unseen."""
    if experiment.steady:
        return f"{len(experiment.recording)} samples at rest"
    fitted, unseen = (int(np.sum(experiment.mask(part))) for part in ("fit", "validation"))
    shares = [f"{count} {word}" for count, word in ((fitted, "fitted"), (unseen, "unseen")) if count]
    return f"{len(experiment.recording)} samples, {span(experiment.recording.t)}: {', '.join(shares) or 'none used'}"


def _with_unit(problem: Any, name: str) -> str:
    unit = problem.predictor.needs[name]
    for experiment in problem.experiments.values():
        unit = unit or experiment.recording.signals[name].unit
    return f"{name} [{unit}]" if unit else name
