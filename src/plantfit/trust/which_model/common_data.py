"""The samples that several problems have in common, and what differs where they have not."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit import units
from plantfit.errors import RecordingError
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.problem import Problem
from plantfit.trust.intervals.robust_or_classical import has_times

Place = tuple[str, str]
"""Recording and output."""
ROUNDING = 1e-9  # of the range of a signal: what a change of units may move


@dataclass(frozen=True)
class Series:
    """One output of one recording: `t` (n,) in s, `measured` (n,) in `unit`, the samples that are `fitted` and
    `unseen` (n,) bool."""

    recording: str
    output: str
    unit: str | None
    t: np.ndarray
    measured: np.ndarray
    fitted: np.ndarray
    unseen: np.ndarray
    timed: bool = True  # whether t are times, and not numbers of rows


@dataclass(frozen=True)
class Shared:
    """`series` of all, in names and units of the first problem; `recordings` by problem: common name -> own name;
    `factors` by problem and output: (factor, offset) from its own unit to the common one."""

    series: tuple[Series, ...]
    recordings: Mapping[str, Mapping[str, str]]
    factors: Mapping[str, Mapping[str, tuple[float, float]]]


def shared_data(problems: Mapping[str, Problem]) -> Shared:
    """The series that all problems explain.

    Recordings are the same where their samples are, whatever their names. Raises RecordingError with one sentence that
    names the first thing that differs: outputs, recordings, times, values, the fitted or the unseen part.
    """
    first, *others = problems
    base = problems[first]
    own = series_of(base)
    recordings, factors = {first: {n: n for n in base.experiments}}, {first: dict.fromkeys(base.outputs, (1.0, 0.0))}
    for name in others:
        factors[name] = _factors(first, base, name, problems[name])
        recordings[name] = _matched(first, base, name, problems[name])
        _same(first, own, name, series_of(problems[name]), recordings[name], factors[name])
    return Shared(tuple(own.values()), recordings, factors)


def series_of(problem: Problem) -> dict[Place, Series]:
    """The series of one problem by recording and output."""
    found = {}
    for name, experiment in problem.experiments.items():
        unseen = experiment.mask("validation")
        for output in problem.outputs:
            measured = (
                experiment.recording[output]
                if output in experiment.recording.signals
                else np.full(len(experiment.recording), np.nan)
            )
            fitted = np.zeros(len(measured), dtype=bool)
            if name in problem.data["index"]:
                fitted[problem.data["index"][name][output]] = True
            known = np.isfinite(measured)
            unit = problem.model.outputs[output] or (
                experiment.recording.signals[output].unit if output in experiment.recording.signals else None
            )
            found[name, output] = Series(
                name,
                output,
                unit,
                experiment.recording.t,
                measured,
                fitted & known,
                unseen & known & ~fitted,
                problem.in_time or has_times(experiment.recording),
            )
    return found


def _unlike(first: str, name: str, what: str) -> RecordingError:
    return RecordingError(f"{first} and {name} are not models of the same data: {what}.")


def _factors(first: str, base: Problem, name: str, problem: Problem) -> dict[str, tuple[float, float]]:
    if set(base.outputs) != set(problem.outputs):
        raise _unlike(
            first,
            name,
            f"the outputs are {', '.join(base.outputs)} and {', '.join(problem.outputs)}; give them the same names",
        )
    made = {}
    for output in base.outputs:
        to, own = base.model.outputs[output], problem.model.outputs[output]
        if to == own or to is None or own is None:
            made[output] = (1.0, 0.0)
            continue
        if not units.compatible(own, to):
            raise _unlike(first, name, f"{output} is in {to} and in {own}")
        made[output] = units.factor_offset(own, to)
    return made


def _matched(first: str, base: Problem, name: str, problem: Problem) -> dict[str, str]:
    """Own name of each recording of the first problem: the same name, else the same times."""
    if set(base.experiments) == set(problem.experiments):
        return {n: n for n in base.experiments}
    if len(base.experiments) != len(problem.experiments):
        counts = f"{_listed(base)} and {_listed(problem)}"
        raise _unlike(first, name, f"the recordings are {counts}; give both the same ones")
    left, found = dict(problem.experiments), {}
    for n, experiment in base.experiments.items():
        same = [
            m
            for m, e in left.items()
            if _alike(experiment.recording.t, e.recording.t) and _outputs_alike(base, experiment, e)
        ]
        chosen = n if n in left else same[0] if same else next(iter(left)) if len(left) == 1 else None
        if chosen is None:
            raise _unlike(first, name, f"recording {n!r} of {first} is none of {_listed(problem)} of {name}")
        found[n] = chosen
        left.pop(chosen)
    return found


def _outputs_alike(base: Problem, a: Experiment, b: Experiment) -> bool:
    both = [o for o in base.outputs if o in a.recording.signals and o in b.recording.signals]
    return all(np.array_equal(np.isfinite(a.recording[o]), np.isfinite(b.recording[o])) for o in both) and all(
        np.corrcoef(np.nan_to_num(a.recording[o]), np.nan_to_num(b.recording[o]))[0, 1] > 0.999999
        for o in both
        if np.nanstd(a.recording[o]) > 0 and np.nanstd(b.recording[o]) > 0
    )


def _same(
    first: str, own: Mapping[Place, Series], name: str, other: Mapping[Place, Series], recordings: Mapping[str, str],
    factors: Mapping[str, tuple[float, float]],
) -> None:  # fmt: skip
    for (recording, output), a in own.items():
        b = other[recordings[recording], output]
        where = f"recording {recording!r}"
        if len(a.t) != len(b.t):
            raise _unlike(first, name, f"{where} has {len(a.t)} samples in {first} and {len(b.t)} in {name}")
        if not _alike(a.t, b.t):
            k = int(np.argmax(np.abs(a.t - b.t)))
            raise _unlike(
                first, name, f"{where} has its sample {k} at {a.t[k]:g} s in {first} and at {b.t[k]:g} s in {name}"
            )
        factor, offset = factors[output]
        differ = ~np.isclose(
            a.measured, b.measured * factor + offset, rtol=0, atol=ROUNDING * _range(a.measured), equal_nan=True
        )
        if differ.any():
            with np.errstate(invalid="ignore"):
                off = np.abs(a.measured - (b.measured * factor + offset))[differ]
            by = f", by up to {np.nanmax(off):.3g} {a.unit or ''}".rstrip() if np.isfinite(off).any() else ""
            what = f"{output} of {where} differs in {int(differ.sum())} of {len(differ)} samples{by}"
            raise _unlike(first, name, f"{what}; give both the same file, column and cleaning steps")
        for part, x, y in (("fitted", a.fitted, b.fitted), ("unseen", a.unseen, b.unseen)):
            if not np.array_equal(x, y):
                counts = (
                    f"{int(x.sum())} samples of {output} of {where} are {part} in {first} and {int(y.sum())} in {name}"
                )
                raise _unlike(first, name, f"{counts}; give both the same split, fit, validate and skip")


def _alike(a: np.ndarray, b: np.ndarray) -> bool:
    return len(a) == len(b) and np.allclose(a, b, rtol=0, atol=ROUNDING * max(float(np.ptp(a)), 1e-300))


def _range(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.max(np.abs(known))) + 1e-300 if len(known) else 1.0


def _listed(problem: Problem) -> str:
    return ", ".join(problem.experiments)
