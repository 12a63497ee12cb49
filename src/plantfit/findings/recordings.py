"""What was measured and simulated, how far apart the two are, and how outputs are weighted."""

from typing import Literal

from pydantic import model_validator

from plantfit.findings.record import Number, Record, Values

Part = Literal["fit", "validation", ""]


class Input(Record):
    """A signal that drives the model."""

    unit: str | None = None
    values: Values


class Output(Record):
    """A signal that the model predicts."""

    unit: str | None = None
    measured: Values
    simulated: Values
    part: list[Part] = []
    """Of every sample: fitted, kept unseen, or neither."""


class Recording(Record):
    """Signals over the times `t`, in seconds."""

    name: str
    log: list[str] = []
    """What was done to it, a sentence a step."""
    t: list[float]
    timed: bool = True
    """False where rows of a model without time have numbers, and no times."""
    inputs: dict[str, Input] = {}
    outputs: dict[str, Output] = {}

    @model_validator(mode="after")
    def _lengths_agree(self) -> "Recording":
        n = len(self.t)
        lengths = {f"input {name!r}": len(signal.values) for name, signal in self.inputs.items()}
        for name, output in self.outputs.items():
            lengths |= {f"measured {name!r}": len(output.measured), f"simulated {name!r}": len(output.simulated)}
            if output.part:
                lengths[f"part of {name!r}"] = len(output.part)
        for what, length in lengths.items():
            if length != n:
                raise ValueError(f"{what} has {length} values but t has {n}")
        return self


class Score(Record):
    """How far simulated and measured samples of one output are apart; root mean square and mean in its unit."""

    recording: str
    output: str
    unit: str | None = None
    part: Literal["fit", "validation"]
    n: int
    """Samples."""
    rmse: Number = None
    bias: Number = None
    fit_percent: Number = None
    """100 (1 - |error| / |measured - mean|); none where the output never moves."""
    foretold: Number = None
    """Of unseen samples that are followed worse than fitted ones: the RMSE that noise and the uncertainty of the
    parameters foretell for a model that is right, exceeded in 1 %; none where residuals or records allow no such
    figure."""
    started: Number = None
    """Of unseen samples that are followed worse than fitted ones, in a recording whose simulation begins at first
    measured values: the RMSE if it began at these less their noise, which is estimated from the unseen samples; none
    where noise is no part of it, and where residuals speak against the model."""
    spare: Number = None
    """Of fitted samples that are no more than the free parameters: how many they are beyond the parameters that
    follow them (by leverage). 0: they are followed whatever they are, which shows nothing."""


class Weight(Record):
    """The residual of an output that counts as 1, in its unit, and `who` chose it in words."""

    output: str
    unit: str | None = None
    scale: Number
    chosen: Literal["given", "unit", "spread", "residuals"]
    who: str = ""
    rounds: int = 0
    """Of estimating it from the residuals."""
    settled: bool = True
    """Whether the last round changed nothing."""
    few: bool = False
    """Whether it is the least scale, of an output with no more samples than there are free parameters."""
