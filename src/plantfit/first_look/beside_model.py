"""The best linear model beside a grey box that leaves much: does what is missing look linear, and does it oscillate?"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from plantfit.errors import RecordingError
from plantfit.first_look.baseline import Baseline, baseline
from plantfit.first_look.data import Data, data_of
from plantfit.first_look.linear import LinearFit, fit_linear
from plantfit.models.model import Model
from plantfit.problem.problem import Problem
from plantfit.recording.record import Signal

# a linear model says something from that many times the noise on, and that part of the grey box's RMSE
NOISE, CLOSER = (1.5, 0.8)
ALIKE = 1.1  # times the least RMSE of any order: more states do no better
DAMPED = 0.7  # damping ratio from which on nobody sees an oscillation
FAST = 0.8  # of the Nyquist frequency: poles beyond it are noise
LONGEST = 20_000  # samples of a recording beyond which it takes long
SLOW = 0.5  # of the shortest recording: periods above are those of disturbances
ORDERS = (1, 2, 3)
FOLLOWED = 0.1  # of the spread of what a grey box gives, that a linear model may leave of it
LASTS = 3.0  # times, by which a swing may fade or grow over a record that still counts as one that does neither

# periods and damping ratios that are the same: shares, and of small damping ratios a difference
SAME_PERIOD, SAME_DAMPING, SMALL_DAMPING = 0.05, 0.2, 0.02

_ENTER = (
    "what is missing is how inputs or outputs enter, as an output that an input or a rate acts on directly (a "
    "capacitor's voltage with a resistance in series), or an input that acts on one rate more."
)

# recording -> its fitted and its unseen samples (n,) bool, and what the grey box gives there (n,)
Used = Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Oscillation:
    """The slowest pair of poles that is seen to oscillate: `period` in s and `damping` ratio."""

    period: float
    damping: float

    @property
    def lag(self) -> float:
        """T in T v' = r - v, s, with which x' = v oscillates so where x' = r is a lag of first order."""
        return self.period * np.sqrt(1.0 - self.damping**2) / (4.0 * np.pi * self.damping)

    def like(self, other: "Oscillation") -> bool:
        """Whether two oscillate alike."""
        apart = abs(self.damping - other.damping)
        return abs(self.period / other.period - 1.0) <= SAME_PERIOD and apart <= max(
            SMALL_DAMPING, SAME_DAMPING * other.damping
        )


def linear_beside(
    problem: Problem, output: str, used: Used, rmse: tuple[float, float], noise: float, box: str = "this one"
) -> str:
    """A sentence where a linear model follows an output to its noise, and the grey box does not; else "".

    `box` is what the sentence calls the grey box. Its RMSE on fitted and unseen samples (NaN where there are none) and
    the noise are in the output's unit.
    """
    model, period = problem.model, {float(np.median(np.diff(e.recording.t))) for e in problem.experiments.values()}
    assert isinstance(model, Model)
    inputs, grid = [n for n in model.inputs if n not in problem.outputs], None if len(period) == 1 else min(period)
    if not inputs or any(len(e.recording) > LONGEST for e in problem.experiments.values()):
        return ""
    try:
        records = [
            data_of(e.recording, inputs, output, *used[name][:2], grid) for name, e in problem.experiments.items()
        ]
        best = baseline(records, ORDERS)
    except RecordingError:
        return ""
    least = min(_rmse(records, fit, "fit") for fit in best.fits)
    for fit in best.fits:  # the fewest states that do, and leave hardly more than more states would
        own = [_rmse(records, fit, part) for part in ("fit", "unseen")]
        if own[0] <= ALIKE * least and all(
            v <= min(NOISE * noise, CLOSER * mine) for v, mine in zip(own, rmse, strict=True) if np.isfinite(mine)
        ):
            break
    else:
        return ""
    rested = fit_linear([replace(d, rested=True) for d in records], fit.order, fit.shifts, begin=fit)
    found = replace(best, chosen=fit)
    wave, length = oscillation(found), min(d.period * len(d.y) for d in records)
    unit = "" if model.outputs[output] in (None, "", "1") else f" {model.outputs[output]}"
    unseen = f", on unseen data {own[1]:.3g} and {rmse[1]:.3g}" if np.isfinite(rmse[1]) else ""
    text = f"{found.sentence} follows {output} with an RMSE of {own[0]:.3g}{unit}, {box} with {rmse[0]:.3g}{unseen}:"
    swing = _lasting(fit, max(len(d.y) for d in records))
    # inputs that moved it would move it from rest as well
    moved = rested is not None and _rmse(records, rested, "fit") <= NOISE * max(noise, own[0])
    if swing is not None and swing <= SLOW * length and not moved:
        return f"{text} {_by_itself(swing)}"
    if (
        rested is None
        or _rmse(records, rested, "fit") > CLOSER * rmse[0]
        or (wave is not None and wave.period > SLOW * length)
    ):
        return ""  # modes that no input moves imitate a disturbance
    gains, own = _gains(records, found, inputs), _of_the_box(problem, output, inputs, used, found, grid)
    return f"{text} what is missing is mostly linear. {_what(model, found, gains, own)}".strip()


def _of_the_box(
    problem: Problem, output: str, inputs: Sequence[str], used: Used, found: Baseline, grid: float | None
) -> Oscillation | Literal["none", "not told"]:
    """How the grey box itself oscillates, by the same look at what it gives in place of what was measured."""
    records = []
    try:
        for name, e in problem.experiments.items():
            fitted, unseen, simulated = used[name]
            given = replace(e.recording, signals={**e.recording.signals, output: Signal(simulated)})
            records.append(data_of(given, inputs, output, fitted, unseen, grid))
    except RecordingError:  # it does not move
        return "none"
    fit = fit_linear(records, found.chosen.order, found.chosen.shifts)
    if fit is None or _rmse(records, fit, "fit") > FOLLOWED * _spread(records):
        return "not told"  # the grey box is not linear here
    return oscillation(replace(found, chosen=fit)) or "none"


def _spread(records: Sequence[Data]) -> float:
    """Standard deviation of the fitted samples of all records."""
    return float(np.std(np.concatenate([d.y[d.fitted] for d in records])))


def _lasting(fit: LinearFit, samples: int) -> float | None:
    """The period, s, of the slowest pair of poles that neither fades nor grows over so many samples; None without."""
    angles = [
        float(np.angle(z))
        for z in fit.poles
        if z.imag > 0 and samples * abs(np.log(abs(z))) < np.log(LASTS) and np.angle(z) < FAST * np.pi
    ]
    return 2.0 * np.pi / min(angles) * fit.period if angles else None


def _by_itself(period: float) -> str:
    """What is to be said of a swing that no input moves."""
    return (
        f"what it has more is a swing with a period of {period:.3g} s that lasts throughout and that no input moves. "
        "Something that comes back acts on the plant and is not recorded, or the plant still swings from before the "
        "record; measure it and make it an input."
    )


def _rmse(records: Sequence[Data], fit: LinearFit, part: str) -> float:
    """RMSE of a linear model on the fitted or unseen samples of all records; NaN where there are none."""
    masks = [d.fitted if part == "fit" else d.unseen for d in records]
    errors = np.concatenate([(y - d.y)[m] for y, d, m in zip(fit.simulated, records, masks, strict=True)])
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else float("nan")


def _gains(records: Sequence[Data], found: Baseline, inputs: Sequence[str]) -> dict[str, float]:
    """Static gains from the inputs that move; of one that never does nothing is known."""
    gains = zip(inputs, found.chosen.gains, strict=True)
    return {u: float(g) for k, (u, g) in enumerate(gains) if any(np.ptp(d.inputs[:, k]) > 0 for d in records)}


def _what(
    model: Model, found: Baseline, gains: Mapping[str, float], box: Oscillation | Literal["none", "not told"]
) -> str:
    """What the poles and gains of the linear model say about the equations, beside how the `box` oscillates."""
    own = tuple(s for s in model.states if s not in {b.state for b in model.backlashes})
    wave, order = oscillation(found), found.chosen.order
    if wave is None:
        if order > len(own):
            return f"The model has {_states(len(own))}; write one more."
        told = [f"from {u} is {gain:.3g}" for u, gain in gains.items()]
        return f"Its static gain {', '.join(told)}; see whether equations and bounds allow that." if told else ""
    text = f"It oscillates with a period of {wave.period:.3g} s and a damping ratio of {wave.damping:.2g}"
    if len(own) != 1:
        return f"{text}{_beside(wave, box)}"
    x = own[0]
    return (
        f"{text}, which one state cannot. Let the rate of {x} have inertia: {x}' = v and v' = (r - v)/T, where r is "
        f"what stands for {x}' "
        f"now and T is about {wave.lag:.2g} s."
    )


def _beside(wave: Oscillation, box: Oscillation | Literal["none", "not told"]) -> str:
    """How the oscillation of the linear model compares with that of the grey box, and what follows from it."""
    if box == "not told":
        return "; see whether the equations can oscillate so."
    if box == "none":
        return "; this model does not, with the values that were found. See whether its equations and bounds allow it."
    if wave.like(box):
        return f", as this model does. So its states are right: {_ENTER}"
    return (
        f"; this model, with the values that were found, with {box.period:.3g} s and {box.damping:.2g}. See whether "
        f"its equations and bounds allow the first; if they do, {_ENTER}"
    )


def _states(count: int) -> str:
    return f"{count} state{'s' * (count != 1)}" if count else "no state"


def oscillation(found: Baseline) -> Oscillation | None:
    """The slowest pair of poles of a linear model whose oscillation can be seen; None where there is none."""
    pairs = []
    for z in found.chosen.poles:
        if z.imag > 0 and abs(z) < 1.0 and np.angle(z) < FAST * np.pi:
            s = np.log(z) / found.chosen.period
            damping = float(-s.real / abs(s))
            if damping < DAMPED:
                pairs.append(Oscillation(float(2.0 * np.pi / s.imag), damping))
    return max(pairs, key=lambda pair: pair.period, default=None)
