"""How exact the simulation of the answer is, and what makes the same answer again."""

from typing import Any

from plantfit.findings.record import Number, Record


class SimulatedOutput(Record):
    """Errors of the simulation of one output against a tight solver, beside its residual."""

    unit: str | None = None
    max_error: Number = None
    rms_error: Number = None
    rms_residual: Number = None


class Forgets(Record):
    """A recording that the model does not follow and whose start it forgets."""

    recording: str
    growth: Number = None
    """So many times a small deviation at the first sample grows within it."""
    tenfold: Number = None
    """Seconds in which it grows tenfold."""


class Simulation(Record):
    """The stepper, and its check on the recording where it is least exact."""

    stepper: str = ""
    substeps: Any = None
    """Steps between two samples."""
    recording: str = ""
    """The one that was checked."""
    checked_with: str = ""
    """The tight solver."""
    checked_samples: int | None = None
    """So many of its samples were reached."""
    samples: int | None = None
    """So many there are."""
    checked_evaluations: int | None = None
    """Evaluations of the rate that the tight solver was allowed, where it took them all before the last sample."""
    outputs: dict[str, SimulatedOutput] = {}
    refused: str = ""
    """Why an independent solver could not follow the answer."""
    forgets: list[Forgets] = []
    """Of recordings that are followed badly (a fit below 50 %) those that forget their start, the soonest first."""


class Reproduction(Record):
    """What makes the same answer again."""

    spec: str | None = None
    """The study file."""
    seed: int | None = None
    versions: dict[str, str] = {}
    cpu: str = ""
    seconds: dict[str, Number] = {}
    """By stage: prepare, search, finish, trust, diagnosis."""
    command: str = ""
