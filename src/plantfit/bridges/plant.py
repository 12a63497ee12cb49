"""The plant of an answer as every target needs it: the model with its parameters, and how one recording begins and
goes."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import ModelError
from plantfit.models.model import Model
from plantfit.problem.measure.experiment import before_in_units
from plantfit.simulate.steps.vector import VectorModel, vectorise
from plantfit.simulate.straight_line import Lines, straight_line


@dataclass(frozen=True)
class Plant:
    """A `model` with parameters `p` by name and states `x0` as the recording begins, its `inputs` (N,) at times `t`
    (N,) in s, how each goes on between samples (`hold`) and its value `before` the first; `name` is a word that
    every language takes."""

    name: str
    vector: VectorModel
    model: Model
    p: dict[str, Any]
    x0: dict[str, float]
    hold: dict[str, str]
    before: dict[str, float]
    t: np.ndarray
    inputs: dict[str, np.ndarray]
    answer: Answer
    recording: str

    @property
    def delays(self) -> list[tuple[str, float]]:
        """Input and seconds of every delayed copy."""
        return [(d.input, float(self.p[d.parameter])) for d in self.model.delays]

    @property
    def story(self) -> list[str]:
        """Lines for a comment: what the file holds, and units. Names of users stand in them, so that each has one
        line and no more."""
        units = {**self.model.states, **self.model.inputs, **self.model.outputs}
        groups = {"inputs": self.model.inputs, "states": self.vector.states, "outputs": self.vector.outputs}
        rows = [
            f"{what}: {', '.join(f'{n} [{units[n]}]' if units[n] else n for n in names)}"
            for what, names in groups.items()
        ]
        lines = [
            f"The plant {self.answer.problem.name} as plantfit identified it from the recording {self.recording}.",
            *rows,
        ]
        return [one_line(line) for line in lines]

    def lines(self, what: str, language: str) -> Lines:
        """The rates or outputs (`what` "rate" or "output") as assignments of x[i], u[i] and p[i]. Raises ModelError
        for tables."""
        wrong = [n for n, v in self.p.items() if np.ndim(v)]
        if wrong:
            raise ModelError(
                f"Model {self.model.name!r} reads the table {wrong[0]!r}, which is "
                f"not written as {language} yet; export --to csv or control instead."
            )
        sizes = (len(self.vector.states), len(self.vector.channels), len(self.vector.parameters))
        names = [[f"{n}[{i}]" for i in range(size)] for n, size in zip("xup", sizes, strict=True)]
        return straight_line(self.vector, what, language, names)


def plant_of(answer: Answer, name: str | None = None, recording: str | None = None) -> Plant:
    """The plant of an answer as `recording` (by default the first) begins. Raises ModelError for what no target
    carries."""
    model, problem = answer.problem.model, answer.problem
    if not isinstance(model, Model) or not model.states:
        raise ModelError(
            "A regression or a static model has nothing to simulate; "
            "export --to csv is not for it either: see to_frame()."
        )
    if not model.smooth:
        raise ModelError(
            f"Model {model.name!r} has events, dry friction, backlash or late states, which cannot be exported "
            "yet; leave them out of the model to export it."
        )
    recording = recording or next(iter(problem.experiments))
    experiment = problem.experiments[recording]
    if experiment.steady:
        raise ModelError(f"Recording {recording!r} is steady; name another one, which moves in time, with --recording.")
    own = experiment.recording
    tree = problem.space.tree(answer.problem.space.physical(answer.z), recording)
    declared = {d.name: d.value for d in model.parameters}
    p = {d.name: np.asarray(tree.get(d.name, declared[d.name]), dtype=float) for d in model.parameters}
    inputs = {n: np.asarray(own[n], dtype=float) for n in model.inputs}
    first = {n: float(v[0]) for n, v in inputs.items()}
    seen = {
        n: float(own[n][np.flatnonzero(np.isfinite(own[n]))[0]]) if n in own.signals else 0.0 for n in model.outputs
    }
    x0 = {n: 0.0 for n in model.states}
    if model.initial_state is not None:
        x0 = {n: float(v) for n, v in model.initial_state(p, first, seen).items()}
    if experiment.initial_time is not None:  # where the states have come by the first sample
        there = problem.predictor.trajectories(tree, problem.data["drive"][recording])
        x0 = {n: float(there[n][0]) for n in model.states}
    before = {**first, **before_in_units(own, experiment.before, {**model.inputs})}
    simulator = problem.predictor.simulator
    straight = simulator.interpolated if simulator is not None else ()
    hold = {n: "linear" if n in straight else "previous" for n in model.inputs}
    return Plant(
        word_of(name or problem.name),
        vectorise(model),
        model,
        p,
        x0,
        hold,
        before,
        np.asarray(own.t),
        inputs,
        answer,
        recording,
    )


def word_of(name: str) -> str:
    """A name as a word that every language takes."""
    word = re.sub(r"\W", "_", name, flags=re.ASCII).strip("_") or "plant"
    return word if word[0].isalpha() else f"p_{word}"


def one_line(text: str) -> str:
    """A text of users without line breaks and control characters."""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())
