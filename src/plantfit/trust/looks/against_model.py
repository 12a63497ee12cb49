"""All looks at the recordings of a problem: `problem_looks` runs those at clock and signals (`recording/looks/`) and
those of packages.

Those against the model are made here: length and period against the bounds of its times, and rest at the start.
"""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from plantfit import units
from plantfit.models.model import Model
from plantfit.native.kept_programs import kept
from plantfit.problem.measure.experiment import Experiment, before_in_units
from plantfit.problem.measure.sample_noise import white_part
from plantfit.problem.problem import Problem
from plantfit.recording.looks import Look, clock_looks, feedback_look, signal_looks
from plantfit.recording.looks.of_packages import looks_of_packages
from plantfit.recording.record import Recording
from plantfit.trust.looks.misreadings import misread, misreadings
from plantfit.trust.verdict.words import some

OTHERS = (("ms", 1e-3), ("us", 1e-6), ("min", 60.0), ("h", 3600.0))  # units that a time column called s may be in
SETTLES = 3.0  # times its noise, by which an output moves while its input rests
FAR = 10.0  # times a bound: not sampled badly, but in another unit
DENSE = 0.1  # of the steps of a clock that are as short or shorter where samples are dense
RESTING, MOVES = 10, 8.0  # samples before the first move of an input, and standard errors of the slope over them
LIKE, TO_SD = 5.0, 1.4826  # standard deviations, of others' median, up to which a single sample is followed as they are
SHARES = (0.31, 0.64)  # of the box: where a model is looked at for what holds whatever its parameters are
YEAR = 31_557_600.0  # s
LASTS, APART = 1000.0 * YEAR, 1e-12  # s, of a whole record, and from sample to sample: beyond them the unit is wrong
STILL = 1e-3  # of a state: a model that moves less during the samples at rest is at rest itself


def problem_looks(problem: Problem, determined: Collection[str] = ()) -> list[Look]:
    """All looks at the recordings of a problem that is simulated over time; none for regressions. Of static models
    and steady records it is only said where an input and an output are one column.

    Only inputs of the model and outputs that are fitted are looked at. Of the parameters that the data have
    `determined` nobody says that the data cannot tell them. A function that makes another kind of look is called here.
    """
    model = problem.model
    if not isinstance(model, Model):
        return []
    if not problem.in_time:
        return [look for name in problem.experiments for look in _same_in(problem, model, name)]
    found: list[Look] = []
    steps = misreadings(problem)
    conditions = _conditions(problem, model)
    for name, e in problem.experiments.items():
        if e.steady:
            found += _same_in(problem, model, name)
            continue
        recording = Recording(e.recording.t, e.recording.signals, name, e.recording.log)
        found += [*_scale(recording), *clock_looks(recording)]
        settles = any(_moves(recording[y]) for y in problem.outputs)
        for u in model.inputs:
            found += [
                look
                for look in signal_looks(recording, u, measured=False, settles=settles)
                if not (_stepped(e, model, look) or (look.kind == "constant" and u in conditions))
            ]
        for y in problem.outputs:
            found += signal_looks(recording, y, measured=True)
        for signal, measured in (*((u, False) for u in model.inputs), *((y, True) for y in problem.outputs)):
            found += looks_of_packages(recording, signal, measured)
        off = {s.signal: misread(e, s) for s in steps if s.recording == name}
        pairs = ((u, y) for u in model.inputs for y in problem.outputs)
        for u, y in pairs:
            if (look := _same(recording, u, y) or feedback_look(recording, u, y, off.get(u, 0.0))) is not None:
                found.append(look)
        found += _times(problem, recording, determined)
        found += _stays(problem, model, recording)
        if not any(_steps_at_start(e, model, u) for u in e.before) and (
            set(model.inputs) <= set(e.before) or _begins_at_rest(problem, model, recording)
        ):
            found += _start(problem, model, recording)
    return [_one_shift(look, found, model) for look in found]


def _one_shift(look: Look, found: Sequence[Look], model: Model) -> Look:
    """A look that tells how to free the clock of an input, with one range for all outputs and recordings, in place of
    a dead time of that input."""
    shifts = [k.figures.get("late") or 0.0 for k in found if k.kind == "feedback" and k.signal == look.signal]
    if look.kind != "feedback" or not look.write:
        return look
    most = max(shifts)
    write = f"clock_shift = {{ {look.signal} = [{-2 * most:.3g}, {2 * most:.3g}] }}"
    own = next((d.parameter for d in model.delays if d.input == look.signal), None)
    told = f"{write} under [model]{f' in place of {own}' if own else ''}"
    return replace(look, write=write, sentence=look.sentence.replace(f"{look.write} under [model]", told))


def _same_in(problem: Problem, model: Model, name: str) -> Iterator[Look]:
    """Inputs of one recording that have the values of an output."""
    recording = problem.experiments[name].recording
    named = Recording(recording.t, recording.signals, name, recording.log)
    for u in model.inputs:
        yield from (look for y in problem.outputs if (look := _same(named, u, y)) is not None)


def _same(recording: Recording, u: str, y: str) -> Look | None:
    """That an input has the values of an output, as from one column for both."""
    a, b = recording[u], recording[y]
    if np.ptp(np.nan_to_num(a)) == 0 or not np.array_equal(a, b, equal_nan=True):
        return None
    text = (
        f"{u} is {y} in {recording.name}, sample by sample. A model that makes {y} of {u} is given what it is to "
        f"follow, and how well it does says nothing: was another column meant for {u}?"
    )
    return Look("same", "warning", recording.name, u, text, float(recording.t[0]), float(recording.t[-1]))


def not_followed(looks: Sequence[Look], problem: Problem, z: np.ndarray) -> list[Look]:
    """The looks, without single samples that the model at the cube point z (d,) follows as well as it follows others: a
    peak that it makes itself, as of a dose or a pulse, is no outlier."""
    if not any(look.kind == "spikes" for look in looks):
        return list(looks)
    values, found = problem.space.physical(np.asarray(z, dtype=float)), []
    for look in looks:
        if look.kind == "spikes" and look.signal in problem.outputs:
            record = problem.experiments[look.recording].recording
            residual = np.asarray(problem.predict(values, look.recording)[look.signal]) - record[look.signal]
            marked = np.isin(record.t, look.times)
            others = np.abs(residual[~marked & np.isfinite(residual)])
            if len(others) and np.all(np.abs(residual[marked]) <= LIKE * TO_SD * np.median(others)):
                continue
        found.append(look)
    return found


def _stepped(e: Experiment, model: Model, look: Look) -> bool:
    """Whether an input that never moves was another before the record."""
    return look.kind == "constant" and look.signal is not None and _steps_at_start(e, model, look.signal)


def _steps_at_start(e: Experiment, model: Model, u: str) -> bool:
    """Whether the record begins with a step of this input."""
    return u in e.before and before_in_units(e.recording, e.before, model.inputs)[u] != e.recording[u][0]


def _conditions(problem: Problem, model: Model) -> set[str]:
    """Inputs that rest in every recording, and not at one value in all: as a dose or a concentration, they are what
    recordings differ in, which tells what they do."""
    found = set()
    for u in model.inputs:
        values = [e.recording[u][np.isfinite(e.recording[u])] for e in problem.experiments.values()]
        levels = [v for v in values if len(v)]
        if all(np.ptp(v) == 0 for v in levels) and len({float(v[0]) for v in levels}) > 1:
            found.add(u)
    return found


def _moves(y: np.ndarray) -> bool:
    """Whether a signal moves by more than it jumps from sample to sample."""
    y = y[np.isfinite(y)]
    return len(y) >= RESTING and float(np.std(y)) > SETTLES * float(np.std(np.diff(y))) / np.sqrt(2.0)


def _time_bounds(problem: Problem) -> Iterator[tuple[str, float, float, bool]]:
    """Parameters that are times: name, bounds (s), whether it is a dead time."""
    late = {d.parameter for d in getattr(problem.model, "delays", ())}
    for c in problem.space.coordinates:
        if c.unit and units.compatible(c.unit, "s"):
            factor = units.factor_offset(c.unit, "s")[0]
            yield c.name, c.lower * factor, c.upper * factor, c.parameter in late


def _times(problem: Problem, recording: Recording, determined: Collection[str]) -> Iterator[Look]:
    """Times that lie between two samples, or beyond the record, of every recording."""
    if len(recording.t) < 2:
        return
    every = [e.recording.t for e in problem.experiments.values() if len(e.recording.t) > 1]
    length, period = max(float(np.ptp(t)) for t in every), min(_spacing(t) for t in every)
    own, ends = _spacing(recording.t), (float(recording.t[0]), float(recording.t[-1]))
    for name, low, high, late in _time_bounds(problem):
        if name in determined:
            continue
        if high <= period:
            what, figure = f"samples are {own:.4g} s apart, and {name} is at most {high:.4g} s", own
            kind, end = "sampled slowly", "what it does lies between two samples"
        elif low >= length and not late:
            figure = float(np.ptp(recording.t))
            what = f"the record is {figure:.4g} s long, and {name} is at least {low:.4g} s"
            kind, end = "short", "it ends before that shows"
        else:
            continue
        text = f"In {recording.name} {what}: {end}."
        write = ""
        other = next((u for u, f in OTHERS if period * f < 0.5 * high and length * f > max(2.0 * low, 0.0)), None)
        far = period >= FAR * high or length <= low / FAR
        if far and other is not None and _plausible(problem, length, period, dict(OTHERS)[other]):
            text += f" Is the time in {other}? It would fit the bounds of all times then."
            write = f'time_unit = "{other}"'
            kind = "time unit"
        yield Look(
            kind, "warning", recording.name, None, text, *ends, write, {"seconds": figure, "low": low, "high": high}
        )
        return


def _spacing(t: np.ndarray) -> float:
    """How far samples are apart where they are dense: an uneven clock is fast where something happens."""
    return float(np.quantile(np.diff(t), DENSE))


def _plausible(problem: Problem, length: float, period: float, factor: float) -> bool:
    return all(
        high > period * factor and (late or low < length * factor) for _, low, high, late in _time_bounds(problem)
    )


def _start(problem: Problem, model: Model, recording: Recording) -> Iterator[Look]:
    """Outputs that move before any input has moved, where the states begin at fixed numbers."""
    fixed = _fixed_states(problem, model, recording)
    if not model.inputs or not fixed:
        return
    moves = [np.flatnonzero(np.diff(recording[u])) for u in model.inputs]
    first = min((int(m[0]) + 1 for m in moves if len(m)), default=len(recording))
    if first < RESTING or first == len(recording):
        return
    t = recording.t[:first]
    for y in problem.outputs:
        values = recording[y][:first]
        if not np.all(np.isfinite(values)):
            continue
        noise = white_part(recording[y])
        centred = t - t.mean()
        slope = float(centred @ values / (centred @ centred))
        error = noise / float(np.sqrt(centred @ centred))
        moved = abs(slope) * float(np.ptp(t))
        if abs(slope) > MOVES * error and moved > 0.02 * float(np.ptp(recording[y])):
            unit = f" {model.outputs[y]}" if model.outputs[y] not in (None, "", "1") else ""
            own = y if y in fixed else fixed[0]
            yield Look(
                "not at rest", "info", recording.name, y,
                f"{y} moves by {moved:.3g}{unit} in the first {np.ptp(t):.3g} s of {recording.name}, before any "
                f"input does: the plant was not at rest, and the model begins at fixed values of {', '.join(fixed)}.",
                float(t[0]), float(t[-1]), f'initial = "{own}_start", with bounds under [parameters.{own}_start]',
                {"moved": moved},
            )  # fmt: skip


def _scale(recording: Recording) -> Iterator[Look]:
    """A time that nobody records over, as of milliseconds in a column that is called hours."""
    t = recording.t
    if len(t) < RESTING:
        return
    length, period = float(t[-1] - t[0]), float(np.median(np.diff(t)))
    if length <= LASTS and period >= APART:
        return
    lasts = f"{recording.name} lasts {length / YEAR:.3g} years"
    told = lasts if length > LASTS else f"Samples of {recording.name} are {period:.3g} s apart"
    text = f"{told}: is the unit of its time another one? Write it as time_unit under [recording.{recording.name}]."
    yield Look("time scale", "warning", recording.name, None, text, float(t[0]), float(t[-1]))


def _stays(problem: Problem, model: Model, recording: Recording) -> Iterator[Look]:
    """That nothing ever moves the model, as of an oscillator that begins at zero, while outputs move."""
    if not model.states or any(np.ptp(recording[u]) != 0 for u in model.inputs):
        return
    moved = [y for y in problem.outputs if _moves(recording[y])]
    fixed = _fixed_states(problem, model, recording)
    if not moved or len(fixed) < len(model.states) or not _begins_at_rest(problem, model, recording, 0.0):
        return
    for share in SHARES:  # events and terms of time may move it later
        values = problem.space.physical(np.full(problem.space.dimension, share))
        if any(np.ptp(y) != 0.0 for y in problem.predict(values, recording.name).values()):
            return
    _, at = next(_beginnings(problem, model, recording))
    where = some([f"{s} = {float(at[s]):g}" for s in model.states], most=4)
    inputs = " and its inputs stay as they are" if model.inputs else ""
    one = next((s for s in model.states if s in moved), next(iter(model.states)))
    text = (
        f"The model stays where it begins in {recording.name}: at {where} its rates are zero{inputs}, whatever the "
        f"parameters are, while {some(moved)} {'moves' if len(moved) == 1 else 'move'}. Say where it begins, by "
        f"`initial` of each state that does not begin there: a measured output, or a parameter."
    )
    write = f'initial = "{one}_start", with bounds under [parameters.{one}_start]'
    yield Look(
        "at rest", "warning", recording.name, moved[0], text, float(recording.t[0]), float(recording.t[-1]), write
    )


def _begins_at_rest(problem: Problem, model: Model, recording: Recording, still: float = STILL) -> bool:
    """Whether the model itself rests at its initial values under the first sample's inputs, but for a share `still` of
    them; one that moves foretells that outputs do."""
    if model.derivative is None:
        return False
    moves = [int(m[0]) + 1 for u in model.inputs if len(m := np.flatnonzero(np.diff(recording[u])))]
    seconds = float(recording.t[min(moves, default=len(recording)) - 1] - recording.t[0])
    derivative = kept(model.derivative, "derivative", model)
    for p, x in _beginnings(problem, model, recording):
        u = _first_inputs(model, recording)
        late = {d.channel: u[d.input] for d in model.delays} | {d.channel: x[d.state] for d in model.state_delays}
        rates = derivative(x, u | late, p)
        if any(abs(float(rates[s])) * seconds > still * abs(float(x[s])) for s in model.states):
            return False
    return True


def _first_inputs(model: Model, recording: Recording) -> dict[str, float]:
    return {u: recording[u][0] for u in model.inputs} | {"t": recording.t[0]}


def _beginnings(
    problem: Problem, model: Model, recording: Recording
) -> Iterator[tuple[dict[str, Any], dict[str, float]]]:
    """Parameters and initial values of the states at two places of the box, where outputs are measured as
    differently."""
    space = problem.space
    for share in SHARES:
        p = space.tree(np.asarray(space.physical(np.full(space.dimension, share))), recording.name)
        if model.initial_state is None:
            yield p, dict.fromkeys(model.states, 0.0)
        else:
            yield p, dict(model.initial_state(p, _first_inputs(model, recording), dict.fromkeys(model.outputs, share)))


def _fixed_states(problem: Problem, model: Model, recording: Recording) -> list[str]:
    """States whose initial value depends on no free parameter and on nothing measured."""
    one, other = (x for _, x in _beginnings(problem, model, recording))
    return [s for s in model.states if float(one[s]) == float(other[s])]


__all__ = ["not_followed", "problem_looks"]
