"""`plantfit predict`: a simulation over a recording, beside what was measured."""

from plantfit.findings.record import Number, Printed, Record


class PredictedBands(Record):
    """Where plant and readings lie for all parameters that the data allow."""

    level: float
    held: dict[str, Number]
    """Share of the readings of an output that lie in its band."""
    scatters: list[str]
    """Parameters that scatter between recordings: these bands are those of another recording."""


class Predicted(Printed):
    """What `plantfit predict --json` prints; the signals themselves are in the file."""

    file: str
    recording: str
    parameters: dict[str, float]
    rmse: dict[str, Number]
    """Of each output over the recording, in its unit."""
    step_error: Number = None
    """Of the simulation, as a share of the spread of an output (1: that or more), where no steps made it exact to
    0.2 %."""
    bands: PredictedBands | None = None
    """With --bands."""
