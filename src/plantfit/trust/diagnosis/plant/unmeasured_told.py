"""What a diagnosis says of what nobody measured: a disturbance that wanders, slow drifts, a pattern that repeats, a
step at a moment."""

from typing import Any

import numpy as np

from plantfit.findings import diagnosis as records
from plantfit.trust.diagnosis.course import Diagnosis
from plantfit.trust.diagnosis.plant.carrier import rounded_to_series
from plantfit.trust.diagnosis.plant.cycles import Repeating
from plantfit.trust.diagnosis.plant.disturbance import Disturbed
from plantfit.trust.diagnosis.plant.slow_drift import Drifting
from plantfit.trust.diagnosis.plant.slow_mode import SlowMode
from plantfit.trust.diagnosis.plant.stepping.steps import StepAt, Stepping
from plantfit.trust.verdict.words import Sentence, estimate, interval, number, percent, plain_unit, say, some, with_unit
from plantfit.units import difference_of

MORE = 1.5  # times the sample-to-sample noise: what was found is not all, or stands for something else
MOST_VALUES = 6  # in a sentence


def wanders(d: Diagnosis, found: Disturbed) -> Sentence:
    """A disturbance on the output, and the parameters beside it."""
    walk, given = found.walk, d.carrier.given
    unit = plain_unit(difference_of(given.model.outputs[found.output]))
    longest = max(float(np.ptp(e.recording.t)) for e in given.experiments.values())
    time = rounded_to_series(0.1 * longest)
    moved = with_unit(walk.moves(time / found.period), unit)
    alone, y = len(found.additions) < len(d.end.additions), found.output
    noise, of = with_unit(walk.noise, unit), f"The residual of {y} as the model is" if alone else f"What is left of {y}"
    text = (
        f"{of} wanders by itself, by about {moved} in {time:g} s, beside noise of {noise}. That accounts for "
        f"{percent(walk.explains)} of it, and it follows no input: something that is not measured acts on {y}"
        f"{', and nothing else need be missing' if alone else ''}."
    )
    return say("warning", text + _allowed_for(d, found), explained=walk.explains)


def drifts(d: Diagnosis, found: Drifting) -> Sentence:
    """Slow drifts of outputs, and the parameters beside them."""
    alone, ys = len(found.additions) < len(d.end.additions), [s.output for s in found.drifts]
    units = d.carrier.given.model.outputs
    moved = [
        f"{f'{y} ' if len(ys) > 1 else ''}by up to {with_unit(s.moves, plain_unit(difference_of(units[y])))}"
        for y, s in zip(ys, found.drifts, strict=True)
    ]
    of = f"The residual of {some(ys)} as the model is" if alone else f"What is left of {some(ys)}"
    driven = bool(getattr(d.carrier.given.model, "inputs", None))
    slower = ", more slowly than the inputs move the plant" if driven else ""
    text = (
        f"{of} drifts slowly, {some(moved)}{slower}: a curve in time accounts for "
        f"{percent(found.explains)} of it and leaves the noise. Something that is not measured acts "
        f"there, or a sensor drifts{', and nothing else need be missing' if alone and driven else ''}."
    )
    if not driven:
        text += " Without inputs it cannot be told from an error of the equations that moves slowly."
    return say("warning", text + _allowed_for(d, found), explained=found.explains)


def repeats(d: Diagnosis, found: Repeating) -> Sentence:
    """A pattern that repeats every day, where it acts, and the parameters with it."""
    names = [f"what the sensor of {p.signal} shows" if p.kind == "sensor_cycle" else f"what moves {p.signal}"
             for p in found.places]  # fmt: skip
    where = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} or {names[-1]}"
    best, unit = found.places[0], output_unit(d)
    scaled = "scaled " if len(d.carrier.given.outputs) > 1 else ""
    later = "blocks left out" if found.unseen.blocks else "unseen data"
    text = (
        f"A pattern that repeats every {found.period / 3600:g} h in {where} explains {percent(found.explains)} of "
        f"what is left ({scaled}RMSE {number(found.rmse[0])} to {with_unit(found.rmse[1], unit)}; {later} "
        f"{number(found.unseen.base)} to {number(found.unseen.extended)})"
    )
    text += ", and this record cannot tell where it acts" if len(names) > 1 else ""
    rate = best.kind == "cycle"
    moves, peak = float(np.ptp(found.pattern)) * (3600 if rate else 1), int(np.argmax(found.pattern))
    size = with_unit(moves, plain_unit(best.unit).removesuffix("/s") + ("/h" if rate and best.unit else ""))
    of = f"the rate of {best.signal}" if rate else best.signal
    hour = peak * found.period / len(found.pattern) / 3600
    first = f" in {next(iter(d.carrier.given.experiments))}" if best.several else ""
    text += f". It moves {of} by {size}, and is highest about {hour:g} h after t = 0{first}. "
    text += (
        "Something that is not measured comes back every day, as sun, people or a schedule do, or the plant is another "
        "one at some hours"
    )
    if found.driven:
        one = len(found.driven) == 1
        text += (
            f"; {some(list(found.driven))} repeat{'s' if one else ''} as well, so that an error in what "
            f"{'it does' if one else 'they do'} may look alike"
        )
    text += "." + _allowed_for(d, found)
    if found.times > MORE:
        text += (
            f" {number(found.times)} times the sample-to-sample noise is left with it: it is not quite the same every "
            "day, or more is missing."
        )
    return say("warning", text, explained=found.explains)


def steps(d: Diagnosis, found: Stepping) -> Sentence:
    """A step at a moment, or several of which it is one, and the parameters with it."""
    unit, scaled = output_unit(d), "scaled " if len(d.carrier.given.outputs) > 1 else ""
    later = "blocks left out" if found.unseen.blocks else "unseen data"
    told = [_step(s) for s in found.steps]
    text = (
        f"{told[0][0].upper() if found.steps[0].place.kind != 'step' else told[0][0]}{told[0][1:]}. That explains "
        f"{percent(found.explains)} of what is left ({scaled}RMSE {number(found.rmse[0])} to "
        f"{with_unit(found.rmse[1], unit)}; {later} {number(found.unseen.base)} to {number(found.unseen.extended)})"
    )
    if len(told) > 1:
        text += f", and this record cannot tell it from another one: {'; or '.join(told[1:])}"
    text += ". Something happened to the plant or to its sensors there; look it up."
    if found.times > MORE:
        text += f" {number(found.times)} times the sample-to-sample noise is left with it: more is missing."
    return say("warning", text + _allowed_for(d, found), explained=found.explains)


def slow_mode(d: Diagnosis, found: SlowMode) -> Sentence:
    """A lag of an input to an output that the model lacks, what it may be, and the equation that adds it."""
    model, y, u = d.carrier.given.model, found.output, found.input
    unit = plain_unit(difference_of(model.outputs[y]))
    of = plain_unit(difference_of(model.inputs[u]))  # pyrefly: ignore[missing-attribute]  (no regression has modes)
    per = (
        None if unit is None or of is None else f"{unit or '1'}/{of}" if of.isidentifier() else f"{unit or '1'}/({of})"
    )
    gain, time = (
        estimate({"name": "x", "value": v, "standard_error": e, "unit": w}).removeprefix("x = ")
        for (v, e), w in ((found.gain, per), (found.time, "s"))
    )
    scaled = "scaled " if len(d.carrier.given.outputs) > 1 else ""
    later = "blocks left out" if found.unseen.blocks else "unseen data"
    text = (
        f"A slow mode of {y} that {u} drives is missing: a lag with a time constant of {time} and a gain of {gain} "
        f"explains {percent(found.explains)} of what is left ({scaled}RMSE {number(found.rmse[0])} to "
        f"{with_unit(found.rmse[1], output_unit(d))}; {later} {number(found.unseen.base)} to "
        f"{number(found.unseen.extended)}). No drift is needed for it. A part of the plant that stores and gives back "
        f"is missing, as a second RC pair of a cell or a second mass that takes up heat. Write a state for it: "
        f"s' = (g*{u} - s)/T, and add s to {y}; begin at g = {number(found.gain[0])} and T = {number(found.time[0])} s."
    )
    if beside := _allowed_for(d, found):
        text += f"{beside} These are of parts side by side: where one takes from the other, as a mass from a mass, the "
        text += "equations of both give other values."
    return say("warning", text, explained=found.explains)


def _step(s: StepAt) -> str:
    """What changes, when, and by how much."""
    at = f"t = {interval(*s.within, 's')}" if s.within[1] > s.within[0] else f"t = {number(s.at, 5)} s"
    row = {"name": "x", "value": s.size[0], "standard_error": s.size[1], "unit": plain_unit(s.place.unit)}
    if s.before is not None and s.behind is not None:
        ends = [
            estimate({"name": "x", "value": v, "standard_error": e, "unit": plain_unit(s.unit)}).removeprefix("x = ")
            for v, e in (s.before, s.behind)
        ]
        return f"{s.place.signal} changes at {at} from {ends[0]} to {ends[1]}"
    size = estimate({**row, "value": abs(s.size[0])}).removeprefix("x = ")
    more = "more" if s.size[0] > 0 else "less"
    what = (
        f"the sensor of {s.place.signal} shows" if s.place.kind == "sensor_step" else f"the rate of {s.place.signal} is"
    )
    return f"{what} {size} {more} from {at} on"


def wandering_record(d: Diagnosis) -> dict[str, Any] | None:
    found = d.disturbed
    if found is None:
        return None
    unit = plain_unit(difference_of(d.carrier.given.model.outputs[found.output]))
    walk, values = found.walk, [records.ValueBeside(**v) for v in _values_beside(d, found)]
    return records.Wandering(
        output=found.output, unit=unit, steps=walk.steps, period=found.period, noise=walk.noise,
        explained=walk.explains, values=values,
    ).plain()  # fmt: skip


def drifting_record(d: Diagnosis) -> dict[str, Any] | None:
    found = d.drifting
    if found is None:
        return None
    units = d.carrier.given.model.outputs
    outputs = [
        records.SlowDrift(
            output=s.output, unit=plain_unit(difference_of(units[s.output])), splines=s.count, moves=s.moves
        )
        for s in found.drifts
    ]
    values = [records.ValueBeside(**v) for v in _values_beside(d, found)]
    return records.Drifting(outputs=outputs, explained=found.explains, values=values).plain()


def repeating_record(d: Diagnosis) -> dict[str, Any] | None:
    found = d.repeating
    if found is None:
        return None
    places = [
        records.CyclePlace(name=p.name, kind=p.kind, signal=p.signal, parameter=p.parameter, unit=p.unit)
        for p in found.places
    ]
    return records.Repeating(
        places=places, period=found.period, explained=found.explains, pattern=list(found.pattern),
        driven=list(found.driven), rmse=found.rmse[0], rmse_with=found.rmse[1], unseen_rmse=found.unseen.base,
        unseen_rmse_with=found.unseen.extended, values=[records.ValueBeside(**v) for v in _values_beside(d, found)],
    ).plain()  # fmt: skip


def stepping_record(d: Diagnosis) -> dict[str, Any] | None:
    found = d.stepping
    if found is None:
        return None
    steps = []
    for s in found.steps:
        (before, before_error), (behind, behind_error) = s.before or (None, None), s.behind or (None, None)
        steps.append(
            records.StepFound(
                name=s.place.name, kind=s.place.kind, signal=s.place.signal, parameter=s.place.parameter,
                unit=s.place.unit, size=s.size[0], standard_error=s.size[1], at=s.at, at_low=s.within[0],
                at_high=s.within[1], before=before, before_error=before_error, behind=behind, behind_error=behind_error,
            )
        )  # fmt: skip
    return records.Stepping(
        steps=steps, explained=found.explains, rmse=found.rmse[0], rmse_with=found.rmse[1],
        unseen_rmse=found.unseen.base, unseen_rmse_with=found.unseen.extended,
        values=[records.ValueBeside(**v) for v in _values_beside(d, found)],
    ).plain()  # fmt: skip


def _allowed_for(d: Diagnosis, found: Disturbed | Drifting | Repeating | Stepping | SlowMode) -> str:
    """The parameters beside it, those that are known then."""
    own = [r for r in _values_beside(d, found) if r["name"] in d.carrier.given.space.names]
    known = [r for r in own if r["standard_error"] is not None and r["standard_error"] <= abs(r["value"])]
    shown = known[:MOST_VALUES]
    if not shown:
        return ""
    each = [estimate(r) for r in shown]
    return f" With that allowed for {', '.join(each[:-1])}{' and ' if len(each) > 1 else ''}{each[-1]}."


def _values_beside(d: Diagnosis, found: Disturbed | Drifting | Repeating | Stepping | SlowMode) -> list[dict[str, Any]]:
    units = dict(zip(d.carrier.given.space.names, (c.unit for c in d.carrier.given.space.coordinates), strict=True))
    units |= {a.parameter: a.unit for a in found.additions}
    return [{"name": n, "value": v, "standard_error": e, "unit": units.get(n)} for n, (v, e) in found.values.items()]


def output_unit(d: Diagnosis) -> str | None:
    given = d.carrier.given
    return given.model.outputs[given.outputs[0]] if len(given.outputs) == 1 else None
