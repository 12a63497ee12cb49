"""`plantfit look`: what outputs answer to inputs, without equations."""

from typing import Literal

from plantfit.findings.record import Number, Printed, Record, Samples
from plantfit.findings.verdict import Sentence


class ByPart(Record):
    """A figure of fitted and of unseen samples."""

    fit: Number
    unseen: Number


class LinearOrder(Record):
    """The linear model of one order."""

    order: int
    bic: Number
    """Above the least."""
    rmse: Number
    arx_rmse: Number


class InputToOutput(Record):
    """What an output answers to an input; lists of a frequency response are empty where there is none."""

    input: str
    unit: str | None
    delay: Number
    """s until the first reaction; None where none stands out of chance."""
    lags: Samples
    """s"""
    correlation: Samples
    bound: Number
    """Which 1 % of records without a reaction leave anywhere."""
    step_t: Samples
    """s"""
    step: Samples
    """Answer of the linear model to a step by 1."""
    step_half: Samples
    """Half width of its 95 % band."""
    f: Samples
    """Hz"""
    gain: Samples
    phase: Samples
    """Degrees."""
    radius: Samples
    """Of the 95 % circle around the response."""
    coherence: Samples
    model_gain: Samples
    model_phase: Samples


class LookedOutput(Record):
    """One output and the linear model of it."""

    output: str
    unit: str | None
    t: Samples
    measured: Samples
    simulated: Samples
    part: list[Literal["fit", "validation", ""]]
    order: int
    dead_times: dict[str, Number]
    """s, by input."""
    rmse: ByPart
    share: ByPart
    """Of the variance that is explained."""
    poles: list[list[float]]
    """Real and imaginary part."""
    orders: list[LinearOrder]
    pairs: list[InputToOutput]


class FirstLook(Printed):
    """What `plantfit.first_look.look` finds."""

    recording: str
    verdict: list[Sentence]
    outputs: list[LookedOutput]
    written: str | None = None
    """The page; `--json` alone."""
