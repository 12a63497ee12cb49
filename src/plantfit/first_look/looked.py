"""The record of a first look: what each output answers to each input, and how far a linear model explains it."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from plantfit.errors import RecordingError
from plantfit.findings.record import Level
from plantfit.findings.results.first_look import ByPart, FirstLook, InputToOutput, LinearOrder, LookedOutput
from plantfit.findings.verdict import Sentence
from plantfit.first_look.baseline import Baseline, baseline
from plantfit.first_look.data import Data, data_of
from plantfit.first_look.delay import reaction_delay
from plantfit.first_look.frequency import frequency_response
from plantfit.first_look.linear import step_band
from plantfit.recording.record import Recording

MOST_STEP = 400  # samples of a step response
FOLLOWED = 0.5  # of the output, from which on a linear model shows that the output answers
PART = 0.7  # of a recording that is fitted, where nothing is said


def look(recording: Recording, inputs: Sequence[str], outputs: Sequence[str],
         fitted: Mapping[str, np.ndarray] | None = None,
         unseen: Mapping[str, np.ndarray] | None = None) -> FirstLook:  # fmt: skip
    """A first look at one recording.

    `fitted` and `unseen` (n,) bool by output; by default the first 70 % are fitted and the rest is unseen. Times in s,
    frequencies in Hz, phases in degrees. Raises RecordingError as `data_of` does.
    """
    n = len(recording)
    first = np.arange(n) < round(PART * n)
    made: list[LookedOutput] = []
    said: list[Sentence] = []
    for output in outputs:
        own = first if fitted is None else fitted[output]
        data = data_of(recording, inputs, output, own, ~first if unseen is None else unseen[output])
        found = baseline([data])
        unit = recording.signals[output].unit
        pairs = [_pair(data, k, name, recording.signals[name].unit, found, said) for k, name in enumerate(inputs)]
        said.append(_explains(output, unit, found))
        fit = found.chosen
        made.append(
            LookedOutput(
                output=output, unit=unit, t=(recording.t[0] + data.period * np.arange(len(data.y))).tolist(),
                measured=data.y.tolist(),
                simulated=fit.simulated[0].tolist(),
                part=np.where(data.fitted, "fit", np.where(data.unseen, "validation", "")).tolist(),
                order=fit.order, dead_times=dict(zip(inputs, fit.dead_times(), strict=True)), rmse=ByPart(**found.rmse),
                share=ByPart(**found.share), poles=[[float(p.real), float(p.imag)] for p in fit.poles],
                orders=[
                    LinearOrder(order=f.order, bic=b, rmse=float(np.sqrt(f.cost / data.fitted.sum())),
                                arx_rmse=f.arx_rmse)
                    for f, b in zip(found.fits, found.bic, strict=True)
                ],
                pairs=pairs,
            )
        )  # fmt: skip
    return FirstLook(recording=recording.name, verdict=said, outputs=made)


def _pair(data: Data, k: int, name: str, unit: str | None, found: Baseline, said: list[Sentence]) -> InputToOutput:
    delay, fit = reaction_delay(data, k), found.chosen
    count = int(min(MOST_STEP, max(20, len(data.y) // 4)))
    settled = _settles(found, count)
    middle, half = step_band([data], fit, k, settled)
    # few steps of a slow plant are seen by a model of the whole record alone
    followed = _told_share(found)[1] > FOLLOWED and bool(np.any(np.abs(middle) > half))
    row: dict[str, Any] = {
        "input": name, "unit": unit, "delay": delay.value, "lags": delay.lags.tolist(),
        "correlation": delay.correlation.tolist(),
        "bound": delay.bound, "step_t": (data.period * np.arange(settled)).tolist(), "step": middle.tolist(),
        "step_half": half.tolist(),
    }  # fmt: skip
    moves = np.ptp(data.inputs[:, k]) > 0
    if not moves:
        said.append(
            _said("warning", f"Input {name} never moves: nothing can be said of what {data.output} answers to it.")
        )
    elif delay.value is None:
        more = ", lag by lag; the linear model, which takes all lags together, has one" if followed else ""
        text = f"No reaction of {data.output} to {name} stands out of chance in the cross-correlation{more}."
        said.append(_said("info", text))
    else:
        when = f"after {delay.value:.3g} s" if delay.value > 0 else "within a sample"
        dead = fit.dead_times()[k]
        # a slow answer stands out of chance late
        if followed and delay.value > dead + 2 * data.period:
            when = f"{when} at the latest"
        text = (
            f"{data.output} reacts to {name} {when} (first lag of the "
            f"cross-correlation beyond chance, {'both' if delay.both else name} made white)"
            f"{f'; the linear model has a dead time of {dead:.3g} s' if when.endswith('latest') else ''}."
        )
        said.append(_said("info", text, delay=delay.value))
    try:
        h = frequency_response(data)[k]
    except RecordingError as error:
        said.append(_said("warning", str(error)))
        return InputToOutput(**row, f=[], gain=[], phase=[], radius=[], coherence=[], model_gain=[], model_phase=[])
    model = fit.response(k, h.f)
    seen = np.isfinite(h.response) & (h.coherence > 0.5)
    first = k == int(np.argmax(np.ptp(data.inputs, axis=0) > 0))  # coherence is with all inputs together: said once
    if moves and first and seen.any():
        low, high = h.f[seen].min(), h.f[seen].max()
        where = f"from {low:.3g} to {high:.3g} Hz" if low < high else f"at {low:.3g} Hz alone"
        text = f"Coherence of {data.output} with the inputs is above 0.5 {where}"
        share = np.mean(seen[(h.f >= h.f[seen].min()) & (h.f <= h.f[seen].max())])
        said.append(_said("info", text + (", with gaps." if share < 0.9 else ".")))
    elif moves and first:
        why = (
            "an eighth of the record, which it is computed of, shows too little of a slow answer or of few moves; "
            "the linear model takes the whole record"
            if followed
            else "noise, or no linear answer"
        )
        text = f"Coherence of {data.output} with the inputs is nowhere above 0.5: {why}."
        said.append(_said("info" if followed else "warning", text))
    return InputToOutput(
        **row, f=h.f.tolist(), gain=np.abs(h.response).tolist(),
        phase=np.degrees(np.unwrap(np.angle(h.response))).tolist(),
        radius=h.radius.tolist(), coherence=h.coherence.tolist(), model_gain=np.abs(model).tolist(),
        model_phase=np.degrees(np.unwrap(np.angle(model))).tolist(),
    )  # fmt: skip


def _settles(found: Baseline, most: int) -> int:
    """Samples over which the step response of the chosen model is worth showing."""
    slowest = float(np.max(np.abs(found.chosen.poles), initial=0.0))
    memory = 5.0 / -np.log(slowest) if 0 < slowest < 1 else most if slowest >= 1 else 5.0
    return int(np.clip(memory + 2 + max(found.chosen.shifts), 10, most))


def _told_share(found: Baseline) -> tuple[str, float]:
    """The part of the record that is told of, and the share of the output that the linear model explains there."""
    part = "unseen" if np.isfinite(found.share["unseen"]) else "fit"
    return part, found.share[part]


def _explains(output: str, unit: str | None, found: Baseline) -> Sentence:
    part, _ = _told_share(found)
    share, rmse = found.share[part], found.rmse[part]
    tail = f" {unit}" if unit not in (None, "", "1") else ""
    what = f"the {'unseen' if part == 'unseen' else 'fitted'} {output}"
    if share <= 0:
        text = (
            f"{found.sentence} explains nothing of {what}: its RMSE, "
            f"{rmse:.3g}{tail}, is no less than {output} spreads."
        )
        return _said("warning", text, rmse=rmse, share=share)
    text = (
        f"{found.sentence} explains {100 * share:.1f} % of {what}: "
        f"RMSE {rmse:.3g}{tail}, simulated from the inputs alone."
    )
    return _said("good" if share > 0.9 else "info", text, rmse=rmse, share=share)


def _said(level: Level, sentence: str, **figures: float) -> Sentence:
    return Sentence(level=level, sentence=sentence, figures={k: float(v) for k, v in figures.items()})
