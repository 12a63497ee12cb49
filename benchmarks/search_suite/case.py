"""One identification problem of the suite: equations, a box, and data made from parameters that the search never
sees."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

import plantfit as pf
from plantfit.space import Parameter

FINER = 8  # times the steps of the fit with which the data are made

Drives = Mapping[str, tuple[np.ndarray, Mapping[str, np.ndarray]]]  # recording -> times (n,), inputs by name, (n,) each


@dataclass(frozen=True, eq=False)
class Case:
    """What a user would write, and `truth` and `noise` from which the data are made.

    `drives` makes times and inputs of every recording from a generator; `noise` is the standard deviation of each
    output in its unit, 0 for a perfect fit. `truth` maps the names of coordinates to values; a value outside the bounds
    puts the optimum on one. `scales` are needed where there are several outputs, so that the cost of the search is the
    cost of the truth.
    """

    name: str
    family: str
    sentence: str
    equations: str
    outputs: Mapping[str, str | None]
    parameters: Mapping[str, Parameter]
    truth: Mapping[str, float]
    noise: Mapping[str, float]
    drives: Callable[[np.random.Generator], Drives]
    inputs: Mapping[str, str | None] = field(default_factory=dict)
    states: Mapping[str, Any] = field(default_factory=dict)
    constants: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, Any] = field(default_factory=dict)
    scales: Mapping[str, float] | None = None
    hold: Mapping[str, str] | None = None
    stepper: str = "exponential"
    substeps: int = 1
    seed: int = 0
    check_units: bool = True

    @property
    def perfect(self) -> bool:
        return not any(self.noise.values())

    def problem(self) -> pf.Problem:
        """The problem with its data; steps of the simulation are fixed, so that the cost is one function."""
        return _problem(self)

    def _made(
        self, recordings: Mapping[str, pf.Recording], substeps: int, parameters: Mapping[str, Parameter]
    ) -> pf.Problem:
        model = pf.equations(
            self.equations, name=self.name, inputs=dict(self.inputs), states=dict(self.states),
            outputs=dict(self.outputs),
            constants=dict(self.constants), tables=dict(self.tables),
            parameters={n: {"unit": p.unit} for n, p in parameters.items() if n not in self.tables},
            check=self.check_units,
        )  # fmt: skip
        return pf.Problem(
            model, dict(recordings), dict(parameters), scales=self.scales, hold=dict(self.hold or {}),
            stepper=self.stepper,
            substeps=substeps, name=self.name,
        )  # fmt: skip


@lru_cache(maxsize=4)
def _problem(case: Case) -> pf.Problem:
    rng = np.random.default_rng([case.seed, *case.name.encode()])
    drives = case.drives(rng)
    still = {
        name: _recording(case, name, t, inputs, {o: np.zeros(len(t)) for o in case.outputs})
        for name, (t, inputs) in drives.items()
    }
    source = case._made(still, FINER * case.substeps, case.parameters)
    values = source.space.vector(case.truth)
    recordings = {}
    for name, (t, inputs) in drives.items():
        clean = source.predict(values, name)
        noisy = {o: np.asarray(clean[o]) + case.noise[o] * rng.standard_normal(len(t)) for o in case.outputs}
        recordings[name] = _recording(case, name, t, inputs, noisy)
    return case._made(recordings, case.substeps, case.parameters)


def _recording(
    case: Case, name: str, t: np.ndarray, inputs: Mapping[str, np.ndarray], outputs: Mapping[str, np.ndarray]
) -> pf.Recording:
    signals = {n: pf.Signal(v, case.inputs[n]) for n, v in inputs.items()}
    return pf.Recording(t, {**signals, **{o: pf.Signal(v, case.outputs[o]) for o, v in outputs.items()}}, name)
