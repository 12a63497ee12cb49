"""From an answer to the next experiment: `design` finds the input that tells most within limits."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import ModelError, SpecError
from plantfit.findings.record import Values
from plantfit.findings.results.next_experiment import (
    DesignedInput,
    ErrorsAfter,
    Level,
    NextExperiment,
    OutputWithoutLimit,
    SignalLimit,
)
from plantfit.models.model import Model
from plantfit.problem.evaluate.points import residuals_and_jacobian
from plantfit.problem.problem import Problem
from plantfit.recording.clean.sampling import usual_period
from plantfit.recording.record import Recording, Signal
from plantfit.trust.experiment.criteria import KINDS, Difference, Precision
from plantfit.trust.experiment.designed import Designed, Limits, designed, errors_after, errors_if_known, gains
from plantfit.trust.experiment.told import difference_sentences, precision_sentences
from plantfit.trust.experiment.trial_record import TrialRecord
from plantfit.trust.finish.unknown_noise import few_samples, unknown_noise
from plantfit.trust.intervals.covariance import errors_at
from plantfit.trust.intervals.linearised import named_blocks
from plantfit.trust.intervals.plausible import plausible
from plantfit.units import in_unit, per_second

MOST_COORDINATES = 60
MOST_SAMPLES = 200_000
RUN_AWAY = 30.0  # times the range that an output had in the recordings
SAME_LEVEL = 0.005  # of the range of an input: levels that are told as one
MORE = 1.5  # times, beyond which something else than unlike sizes of errors makes variances larger
# of a value, of its typical size or of a quarter of bounds of both signs: a standard error above it determines nothing
OPEN = 0.5

Range = tuple[float | str | None, float | str | None]


@dataclass(frozen=True, eq=False)
class ExperimentDesign:
    """A designed input: `recording` holds the inputs to play, `typed` all figures, `record` the same as JSON types,
    `verdict` its sentences."""

    answer: Answer
    goal: Precision | Difference
    limits: Limits
    found: Designed
    recording: Recording
    against: Answer | None = None

    @property
    def t(self) -> np.ndarray:
        """Times (N,) in s."""
        return self.recording.t

    @property
    def record(self) -> dict[str, Any]:
        """Everything but the signals, as JSON types."""
        return self.typed.plain()

    @cached_property
    def typed(self) -> NextExperiment:
        """Everything but the signals (docs/next-experiment.md)."""
        one = self._one
        trial, model = one.trial, one.trial.model
        told = trial.told(self.found.best.u)
        figures: dict[str, Any] = {}
        if isinstance(self.goal, Difference):
            figures["distance"] = self.goal.distance(told, self.goal.other.trial.told(self.found.best.u))
            figures["against"] = self.against.problem.name if self.against else None
        signals: dict[str, Values] = {n: [float(np.min(y)), float(np.max(y))] for n, y in told.signals.items()}
        seen: dict[str, Values] = {n: list(_seen(trial.problem, n)) for n in model.outputs}
        went: dict[str, Values] = {n: list(_went(trial.problem, n)) for n in model.inputs}
        sides = {n: _without_limit(self.limits.signals.get(n)) for n in model.outputs}
        made = NextExperiment(
            name=self.answer.problem.name,
            samples=len(self.t),
            period=float(np.median(np.diff(self.t))),
            seconds=float(np.median(np.diff(self.t))) * len(self.t),
            inputs=[
                DesignedInput(name=n, unit=u, low=float(self.limits.low[k]), high=float(self.limits.high[k]),
                              slew=self.limits.slew[k], seen=went[n])
                for k, (n, u) in enumerate(model.inputs.items())
            ],
            limits={n: SignalLimit(low=lo, high=hi, reached=signals[n], unit=_unit_of(model, n))
                    for n, (lo, hi) in self.limits.signals.items()},
            outputs=[OutputWithoutLimit(name=n, unit=model.outputs[n], seen=seen[n], reached=signals[n], open=side)
                     for n, side in sides.items() if side],
            criterion="difference" if isinstance(self.goal, Difference) else "A" if one.criterion == "A" else "D",
            chosen=[trial.problem.space.names[i] for i in np.flatnonzero(one.chosen)] if not np.all(one.chosen) else [],
            plants=len(trial.plants),
            scatters=[r["name"] for r in self.answer.findings["parameters"] if r.get("scatter")]
            if len(trial.plants) > 1
            else [],
            noise=dict(trial.noise),
            inflation=one.inflation,
            unlike=one.unlike,
            correlated=one.inflation > MORE * one.unlike and _correlated(self.answer.findings),
            widened=[r["name"] for r in self.answer.findings["parameters"] if r.get("scatter")],
            kind=self.found.best.kind,
            shape=self.found.best.name,
            compared=gains(self.found),
            tried=self.found.tried,
            levels=self._levels() if at_once(model) else [],
            parameters=self._rows(told),
            **figures,
        )  # fmt: skip
        say = difference_sentences if isinstance(self.goal, Difference) else precision_sentences
        return made.having(verdict=say(made))

    @property
    def verdict(self) -> list[dict[str, str]]:
        """Sentences with a level, good, info or warning."""
        return self.record["verdict"]

    @property
    def _one(self) -> Precision:
        return self.goal if isinstance(self.goal, Precision) else self.goal.one

    def _levels(self) -> list[Level]:
        """The input as levels, each with its samples; the lowest first."""
        wide = self.limits.high - self.limits.low
        near = self.limits.low + np.round((self.found.best.u - self.limits.low) / wide / SAME_LEVEL) * SAME_LEVEL * wide
        values, counts = np.unique(near, axis=0, return_counts=True)
        return [Level(values=v.tolist(), samples=int(n)) for v, n in zip(values, counts, strict=True)]

    def _rows(self, told: Any) -> list[ErrorsAfter]:
        """Standard errors of each parameter: now, with the new recording beside the old ones, and with it alone."""
        one, space = self._one, self._one.trial.problem.space
        now = {r["name"]: r["standard_error"] for r in self.answer.findings["parameters"]}
        then, worst = errors_after(one, told)
        alone, _ = errors_after(one, told, before=False)
        known = errors_if_known(one, told)
        rows = []
        for k, i in enumerate(one.shared):
            c = space.coordinates[i]
            value, width = abs(float(one.trial.plants[0][i])), c.upper - c.lower
            size = max(value, c.typical, width / 4 if c.lower < 0 < c.upper else 0.0)
            rows.append(
                ErrorsAfter(
                    name=c.name, unit=c.unit, value=float(one.trial.plants[0][i]), now=_number(now.get(c.name)),
                    then=_number(then[k], width), worst=_number(worst[k], width), alone=_number(alone[k], width),
                    open=bool(then[k] > OPEN * size), if_known=_number(known[k], width),
                    alone_open=bool(known[k] > OPEN * size),
                )
            )  # fmt: skip
        return rows

    def predicted(self) -> dict[str, np.ndarray]:
        """What the study's model says of the outputs (N,) under this input, by name in their units."""
        trial = self._one.trial
        told, n = trial.told(self.found.best.u), len(self.t)
        return {
            o: told.course[0][k * n : (k + 1) * n] * trial.noise[o] for k, o in enumerate(trial.problem.model.outputs)
        }

    def __repr__(self) -> str:
        r = self.typed
        much = f"{r.samples} samples" if r.levels else f"{r.seconds:g} s"
        head = f"Input of {much} for {r.name}: {', '.join(i.name for i in r.inputs)}"
        return "\n".join([head, *(f"  {v.level}: {v.sentence}" for v in r.verdict)])


def design(
    answer: Answer,
    *,
    inputs: Mapping[str, Range] | None = None,
    duration: float | str | None = None,
    rate: float | str | None = None,
    hold: float | str | None = None,
    slew: Mapping[str, float | str] | None = None,
    limits: Mapping[str, Range] | None = None,
    criterion: str = "D",
    parameters: Sequence[str] = (),
    against: Answer | None = None,
    alone: bool = False,
    noise: Mapping[str, float | str] | None = None,
    draws: int = 8,
    budget: int = 3000,
    seed: int = 1,
    progress: Callable[[int, int, float], None] | None = None,
) -> ExperimentDesign:
    """The input that tells most about an answer's parameters, or apart two models, within limits; as good on other
    plants that the data allow as on the best fit.

    `inputs`: (low, high) of each, by default what was seen in the recordings; `duration` (s), `rate` (Hz) and `hold`
    (s: the least time that a level lasts) by default those of the longest recording, and a sample; `slew` per second;
    `limits` (low, high) of outputs and states, None for no limit. Numbers are in the study's units, texts have their
    own ("80 degC"). `criterion` "D" makes the ellipsoid of all parameters small, "A" their mean square relative error,
    or that of `parameters` alone. `against` is the answer of another model of the same inputs and outputs: the input
    then tells the two apart. With `alone` the study's own recordings do not count. `noise` (standard deviation) is by
    default that of the residuals of each output. `progress` is told (tried, budget, cost). Same seed, same input.
    Raises SpecError, UnitError, ModelError and SearchError.
    """
    problem, model = answer.problem, _model(answer)
    if criterion not in KINDS:
        raise SpecError(
            f"There is no criterion {criterion!r}; use {' or '.join(map(repr, KINDS))}, or name parameters."
        )
    if not 0 <= draws <= 200:
        raise SpecError(f"draws is {draws}; give 0 to 200.")
    if budget < 100:
        raise SpecError(f"budget is {budget}; give at least 100 inputs to try.")
    t, period = _times(problem, duration, rate)
    known = {*model.outputs, *model.states}
    signals = {
        n: _range(f"limit {n}", r, problem.needs.get(n) or _unit_of(model, n))
        for n, r in _named("limits", limits, known).items()
    }
    low, high = _input_ranges(problem, model, inputs)
    rates = {n: None if (unit := problem.needs[n]) is None else per_second(unit) for n in model.inputs}
    slews = {n: in_unit(f"slew {n}", v, rates[n]) for n, v in _named("slew", slew, set(model.inputs)).items()}
    if any(not v > 0 for v in slews.values()):
        raise SpecError(f"slew is {next(v for v in slews.values() if not v > 0):g}; give a positive change per second.")
    held = 1 if hold is None else max(1, round(in_unit("hold", hold, "s") / period))
    bench = Limits(
        low, high, np.array([slews.get(n, np.inf) for n in model.inputs]), held, signals, _far(problem, signals)
    )
    chosen = _chosen(problem, parameters)
    letter = "A" if parameters else criterion
    one = _goal(answer, t, draws, seed, letter, chosen, alone, noise, tuple({**signals, **model.outputs}))
    goal: Precision | Difference = one
    if against is not None:
        _check_alike(model, _model(against))
        everything = np.ones(against.problem.space.dimension, dtype=bool)
        goal = Difference(one, _goal(against, t, 0, seed, "D", everything, alone, one.trial.noise, ()))
    tell = (lambda tried, cost: progress(tried, budget, cost)) if progress else (lambda tried, cost: None)
    found = designed(goal, bench, budget=budget, seed=seed, tell=tell)
    values = {n: Signal(found.best.u[:, k], problem.needs[n]) for k, n in enumerate(model.inputs)}
    said = (
        f"Designed by plantfit for {problem.name}: {len(t)} samples "
        f"at {1 / period:g} Hz ({len(t) * period:g} s), seed {seed}."
    )
    return ExperimentDesign(answer, goal, bench, found, Recording(t, values, f"{problem.name}-next", (said,)), against)


def _model(answer: Answer) -> Model:
    model = answer.problem.model
    if not isinstance(model, Model):
        raise ModelError("A regression has no inputs over time to design; identify a model with states.")
    if not model.inputs:
        raise ModelError(f"The model {model.name!r} has no input, so there is none to design.")
    if answer.problem.space.dimension > MOST_COORDINATES:
        raise ModelError(
            f"{answer.problem.name!r} has {answer.problem.space.dimension} free values, and inputs "
            f"are designed for up to {MOST_COORDINATES}; hold the entries of tables at their values."
        )
    return model


def at_once(model: Model) -> bool:
    """Whether a model follows its inputs at once, so that the order and the times of samples do not count."""
    timed = model.text is None or re.search(r"\bt\b", model.text) is not None
    return model.derivative is None and model.smooth and not model.delays and not timed


def _times(problem: Problem, duration: float | str | None, rate: float | str | None) -> tuple[np.ndarray, float]:
    """Times (N,) of the new recording, and their distance (s)."""
    longest = max((e.recording for e in problem.experiments.values()), key=lambda r: float(r.t[-1] - r.t[0]))
    period = usual_period(longest) if rate is None else 1.0 / _positive("rate", in_unit("rate", rate, "Hz"))
    seconds = (
        float(longest.t[-1] - longest.t[0]) + period
        if duration is None
        else _positive("duration", in_unit("duration", duration, "s"))
    )
    n = round(seconds / period)
    if not 16 <= n <= MOST_SAMPLES:
        fit = seconds / (60 if n < 16 else 0.5 * MOST_SAMPLES)
        raise SpecError(
            f"{seconds:g} s at {1 / period:g} Hz are {n} samples; an input is designed for 16 to {MOST_SAMPLES:,}. "
            f"Give another rate, such as --rate {1 / fit:.1g}Hz, or another --duration."
        )
    return np.arange(n) * period, period


def _positive(what: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0):
        raise SpecError(f"{what} is {value:g}; give a number above 0.")
    return value


def _named(what: str, given: Mapping[str, Any] | None, known: set[str]) -> dict[str, Any]:
    for name in given or {}:
        if name not in known:
            raise SpecError(f"{what} names {name!r}; there are {', '.join(sorted(known))}.")
    return dict(given or {})


def _range(what: str, given: Range, unit: str | None) -> tuple[float, float]:
    if isinstance(given, str) or len(tuple(given)) != 2:
        raise SpecError(f"{what} is {given!r}; give two numbers (low, high), None where there is no limit.")
    low, high = (
        missing if v is None else in_unit(what, v, unit) for v, missing in zip(given, (-np.inf, np.inf), strict=True)
    )
    if not low < high:
        raise SpecError(f"{what} is from {low:g} to {high:g}; give the lower one first.")
    return low, high


def _input_ranges(problem: Problem, model: Model, given: Mapping[str, Range] | None) -> tuple[np.ndarray, np.ndarray]:
    asked = _named("inputs", given, set(model.inputs))
    found = []
    for name, unit in model.inputs.items():
        seen = np.concatenate([e.recording[name] for e in problem.experiments.values()])
        low, high = float(np.min(seen)), float(np.max(seen))
        if name in asked:
            ends = _range(f"input {name}", asked[name], problem.needs[name])
            low, high = (own if np.isfinite(own) else here for own, here in zip(ends, (low, high), strict=True))
        if not low < high:
            raise SpecError(
                f"The input {name!r} was {low:g} {unit or ''} in all recordings; say from where to where it may go."
            )
        found.append((low, high))
    return tuple(np.array(found, dtype=float).T)


def _without_limit(limit: tuple[float | None, float | None] | None) -> Literal["lower", "upper", "both"] | None:
    """The sides to which an output has no limit, None where it has both."""
    low, high = limit or (None, None)
    free = [side for side, v in (("lower", low), ("upper", high)) if v is None or not np.isfinite(v)]
    return None if not free else "both" if len(free) == 2 else "lower" if free[0] == "lower" else "upper"


def _seen(problem: Problem, signal: str) -> tuple[float, float]:
    """Lowest and highest value of a signal in all recordings; of one that never moves a thousandth of it to each
    side."""
    low, high = _went(problem, signal)
    return (low, high) if low < high else (low - 1e-3 * abs(low) - 1e-9, high + 1e-3 * abs(high) + 1e-9)


def _went(problem: Problem, signal: str) -> tuple[float, float]:
    """Lowest and highest value of a signal in all recordings."""
    y = np.concatenate([e.recording[signal] for e in problem.experiments.values()])
    return float(np.nanmin(y)), float(np.nanmax(y))


def _far(problem: Problem, limited: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Where outputs without limits are taken to run away."""
    found = {}
    for name in problem.outputs:
        if name not in limited:
            low, high = _seen(problem, name)
            found[name] = low - RUN_AWAY * (high - low), high + RUN_AWAY * (high - low)
    return found


def _chosen(problem: Problem, parameters: Sequence[str]) -> np.ndarray:
    """Which coordinates (d,) count."""
    names = list(problem.space.names)
    for name in parameters:
        if name not in names:
            raise SpecError(f"There is no free parameter {name!r}; there are {', '.join(names)}.")
    return np.array([not parameters or n in parameters for n in names], dtype=bool)


def _check_alike(one: Model, other: Model) -> None:
    for what in ("inputs", "outputs"):
        a, b = dict(getattr(one, what)), dict(getattr(other, what))
        if a != b:
            raise ModelError(
                f"The two models have the {what} {', '.join(f'{n} [{u}]' for n, u in a.items())} and "
                f"{', '.join(f'{n} [{u}]' for n, u in b.items())}; models are told apart by equal ones."
            )


def _goal(
    answer: Answer, t: np.ndarray, draws: int, seed: int, criterion: str, chosen: np.ndarray, alone: bool,
    noise: Mapping[str, Any] | None, watched: tuple[str, ...],
) -> Precision:  # fmt: skip
    problem, z = answer.problem, answer.z
    outputs = problem.model.outputs
    given = {
        n: in_unit(f"noise {n}", v, problem.needs[n], difference=True)
        for n, v in _named("noise", noise, set(outputs)).items()
    }
    if unknown := [n for n in unknown_noise(problem) if n not in given]:
        raise SpecError(
            f"Nothing shows how large the errors of {unknown[0]} are: it has no more samples "
            f"than there are free parameters. Give its noise, as in --noise {unknown[0]}=0.1."
        )
    levels = _noise(problem, z) | given
    rows = answer.findings["parameters"]
    plants = plausible(problem, z, rows, draws, seed).values if draws else np.asarray(problem.space.physical(z))[None]
    errors = np.array(
        [np.nan if (e := {r["name"]: r["standard_error"] for r in rows}[n]) is None else e for n in problem.space.names]
    )
    information = _information(problem, z, levels)
    inflation, unlike = _inflation(information, errors), _unlike(problem, z, levels, information)
    trial = TrialRecord(problem, plants, t, levels, errors, watched)
    begins = np.array([trial.begins[n] for n in trial.model.inputs])
    bits = np.random.default_rng(0).random((len(t) // 8 + 1, len(begins)))
    seen = np.array([np.ptp(problem.experiments[trial.recording].recording[n]) for n in trial.model.inputs])
    trial = trial.refined([begins + np.repeat(bits, 8, axis=0)[: len(t)] * seen])
    known = np.zeros_like(information) if alone else information / inflation
    return Precision(trial, known, inflation, criterion, chosen, unlike)


def _noise(problem: Problem, z: np.ndarray) -> dict[str, float]:
    """Standard deviation of the errors of each output, in its unit."""
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    blocks = named_blocks(problem)
    errors = errors_at(residuals, jacobian, [b for _, _, b in blocks])
    found = {}
    for output in problem.outputs:
        own = [residuals[b.rows] for _, o, b in blocks if o == output]
        level = float(np.sqrt(errors[output].mean_square(np.concatenate(own)))) if own else 0.0
        found[output] = max(level, 1e-9) * problem.scales[output]
    return found


def _information(problem: Problem, z: np.ndarray, levels: Mapping[str, float]) -> np.ndarray:
    """Information (d, d) of the study's own recordings in the parameters' units, as if their errors were white.

    Their size is that of the residuals; of outputs with few samples, which may be followed exactly, that of `levels` in
    their units.
    """
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    jacobian = jacobian / problem.space.slopes(z)
    found, few = np.zeros((jacobian.shape[1],) * 2), few_samples(problem)
    for _, output, block in named_blocks(problem):
        r, j = residuals[block.rows], jacobian[block.rows]
        size = (levels[output] / problem.scales[output]) ** 2 if output in few else float(np.mean(r**2))
        found += j.T @ j / max(size, 1e-300)
    return found


def _inflation(information: np.ndarray, errors: np.ndarray) -> float:
    """How many times larger the variances of an answer are than those of white errors: the median over its
    parameters, at least 1."""
    on = np.isfinite(errors) & (errors > 0)
    if not np.any(on):
        return 1.0
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(size, size)
    white = np.sqrt(np.maximum(np.diag(np.linalg.pinv(scaled, rcond=1e-12, hermitian=True)), 1e-300)) / size
    return float(max(1.0, np.median((errors[on] / white[on]) ** 2)))


def _correlated(findings: Mapping[str, Any]) -> bool:
    """Whether a test of a study finds its residuals correlated."""
    return any(not test["white"] for test in (*findings["residual_tests"], *findings["short_recordings"]))


def _unlike(problem: Problem, z: np.ndarray, levels: Mapping[str, float], information: np.ndarray) -> float:
    """How many times larger variances are because errors are larger where parameters are told, if no two errors have
    to do with each other: the median over the parameters, at least 1 (White, Econometrica 48 (1980) 817)."""
    residuals, jacobian = residuals_and_jacobian(problem.unsmoothed, z)
    jacobian = jacobian / problem.space.slopes(z)
    met, few = np.zeros_like(information), few_samples(problem)
    for _, output, block in named_blocks(problem):
        r, j = residuals[block.rows], jacobian[block.rows]
        size = (levels[output] / problem.scales[output]) ** 2 if output in few else float(np.mean(r**2))
        own = j * r[:, None] if output not in few else j * np.sqrt(size)
        met += own.T @ own / max(size, 1e-300) ** 2
    by = np.sqrt(np.maximum(np.diag(information), 1e-300))
    inverse = np.linalg.pinv(information / np.outer(by, by), rcond=1e-12, hermitian=True)
    white, own = np.diag(inverse), np.diag(inverse @ (met / np.outer(by, by)) @ inverse)
    on = white > 0
    return float(max(1.0, np.median(own[on] / white[on]))) if np.any(on) else 1.0


def _unit_of(model: Model, name: str) -> str | None:
    if name in model.outputs:
        return model.outputs[name]
    state: Any = model.states[name]
    return getattr(state, "unit", state)


def _number(value: float | None, width: float = np.inf) -> float | None:
    """A standard error; None where it is as good as unknown."""
    return None if value is None or not np.isfinite(value) or value > 2.0 * width else float(value)
