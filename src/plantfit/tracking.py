"""A finished study's filter over new samples as they come, with an alarm when the plant leaves what the study knows
of it."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import RecordingError, SearchError, SpaceError
from plantfit.estimate.filters.state_space import state_space
from plantfit.estimate.methods.levels import asked
from plantfit.estimate.watch.blocks import BlockFilter, shapes
from plantfit.estimate.watch.causes import FIRST, FOLLOWED, LATER, Causes, causes, onsets
from plantfit.estimate.watch.changes import Calibration, Change, Changes
from plantfit.estimators import Estimators, estimate_parameters, estimate_table
from plantfit.problem.measure.experiment import in_units
from plantfit.problem.measure.long_run import prewhitened_long_run
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.recording.told import either
from plantfit.report.numbers import significant
from plantfit.spec.study import Study
from plantfit.units import is_point

if TYPE_CHECKING:
    import polars as pl

LOOKS = 50  # at a record as long as the study's, by default
FEWEST = 10  # samples between looks


@dataclass(frozen=True)
class Alarm:
    """The plant has left what the study knows: noticed at `t`, in samples since `since` (s).

    `parameter` is the one whose change explains most, None where no parameter does; `from_value` and `to_value` in its
    unit; `alike` are others that explain as much as far as the samples tell, and `told` (s) is when later samples left
    fewer of them. `p` is the chance of such a look with a healthy plant, `allowed` what this look may have.
    """

    t: float
    since: float
    parameter: str | None
    unit: str | None
    from_value: float | None
    to_value: float | None
    alike: tuple[str, ...]
    factor: float
    p: float
    allowed: float
    told: float | None = None

    @property
    def sentence(self) -> str:
        """What is told."""
        chance = f"p = {self.p:.1g}" if self.p > 0 else "p below 1e-300"
        if self.parameter is None:
            return (
                f"ALARM at {self.t:.6g} s: since {self.since:.6g} s the innovations are {self.factor:.2g} times "
                f"as large as the study expects ({chance}), and no parameter explains it: look at the sensors."
            )
        unit = f" {self.unit}" if self.unit and self.unit != "1" else ""
        was, now = significant(self.from_value, 4, True), significant(self.to_value, 3, True)
        share = ""
        if self.from_value and not (self.unit and is_point(self.unit)):  # of 0 degC nothing is a share
            share = f", {100 * (self.to_value - self.from_value) / abs(self.from_value):+.0f} %"  # pyrefly: ignore[unsupported-operation]
        value = f"about {now}{unit} in place of {was}{unit}{share}"
        later = f"; samples up to {self.told:.6g} s tell it" if self.told is not None else ""
        if not self.alike:
            return (
                f"ALARM at {self.t:.6g} s: {self.parameter} has left what the study knows: since {self.since:.6g} s "
                f"{value} ({chance}{later})."
            )
        causes = either([self.parameter, *self.alike])
        return (
            f"ALARM at {self.t:.6g} s: the plant has left what the study knows since {self.since:.6g} s ({chance}). A "
            f"change of {causes} explains it, and the samples so far do not tell which; if it is {self.parameter}, it "
            f"is {value}."
        )


class Tracker:
    """The filter of a study on line: `feed` it recordings as they come, then `finish`.

    `rows` hold what is believed after each block of `length` samples, a mapping with "t", every state and parameter,
    "NAME_sd" of each, "nis" (mean square of the whitened innovations, about 1) and "alarm"; `alarms` the alarm, once
    there is one. The states are those of the filter that tracks the parameters.
    """

    def __init__(self, found: Estimators, every: float | None = None, false_alarm: float = 0.01):
        if not 0 < false_alarm < 1:
            raise SearchError(f"false_alarm = {false_alarm:g}; give a chance between 0 and 1, such as 0.01.")
        problem, scales = found.problem, found.scales
        if scales is None:
            raise SearchError("These estimates hold no levels of noise; give pf.track the answer in their place.")
        self.scales, self.period = scales, scales.period
        if every is not None and not every > 0:
            raise SearchError(f"every = {every:g}; give seconds above 0.")
        length = (
            max(FEWEST, round(scales.span / scales.period / LOOKS))
            if every is None
            else max(1, round(every / scales.period))
        )
        self.length, self.false_alarm = int(length), false_alarm
        self.problem, self.noise = problem, found.noise
        self.values = np.array([found.values[n] for n in problem.space.names])
        self.recording = next(n for n, e in problem.experiments.items() if np.any(e.mask("fit")))
        plant = state_space(problem, found.noise, (), self.recording)
        self._choose(found, plant)
        self.filter = self._filter(found)
        self.correlation = self.covariance / np.outer(self.size, self.size)
        self.calibration = self._calibrated()
        self.restart()

    def restart(self) -> None:
        """Forget all samples and begin anew, as with another record of the plant."""
        self.filter.reset()
        self.changes = Changes(self.correlation, self.tested, self.calibration, self.false_alarm)
        self.rows: list[dict[str, float]] = []
        self.alarms: list[Alarm] = []
        self._following: tuple[Change, int, int] | None = None
        self.samples = self.left_out = 0
        self._begun: float | None = None
        self._waiting: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._last = -math.inf

    def _choose(self, found: Estimators, plant: Any) -> None:
        """Which parameters are watched and tracked, and what the study knows of them."""
        space = self.problem.space
        enters = shapes(plant, self.values)
        decades = np.log(np.where(space.log, space.upper, 1.0) / np.where(space.log, space.lower, 1.0))
        box = 0.25 * np.where(space.log, self.values * decades, space.upper - space.lower)
        places, size, tested = [], [], []
        for i, c in enumerate(space.coordinates):
            if not enters[i] or c.recording not in (None, self.recording):
                continue
            error = math.sqrt(max(found.covariance[i, i], 0.0)) if np.isfinite(found.covariance[i, i]) else 0.0
            own = c.recording is None
            places.append(i)
            tested.append(own)
            # a value of one recording says little of a new one
            size.append(error if own and error > 0 else self._between(c.parameter, box[i]) if not own else box[i])
        if not any(tested):
            raise SpaceError(
                "No free parameter of the study enters its equations, so there is nothing to track; free one."
            )
        self.places, self.size, self.tested = places, np.array(size), np.array(tested)
        self.watched = [space.names[i] for i in places]
        known = found.covariance[np.ix_(places, places)]
        known = np.where(np.isfinite(known), known, 0.0)
        scale = np.sqrt(np.maximum(np.diag(known), 1e-300))
        self.covariance = known / np.outer(scale, scale) * np.outer(self.size, self.size)
        loose = ~self.tested | (np.diag(known) <= 0)
        self.covariance[loose] = 0.0
        self.covariance[:, loose] = 0.0
        self.covariance[loose, loose] = self.size[loose] ** 2

    def _between(self, parameter: str, box: float) -> float:
        own = [v for c, v in zip(self.problem.space.coordinates, self.values, strict=True) if c.parameter == parameter]
        return float(np.std(own, ddof=1)) if len(own) > 1 and np.std(own) > 0 else float(box)

    def _filter(self, found: Estimators) -> BlockFilter:
        space, model = self.problem.space, self.problem.model
        late = {d.parameter for d in model.delays}  # pyrefly: ignore[missing-attribute]  (watched, and no state of a filter)
        own = {c.name: c.parameter for c in space.coordinates}
        joint = [n for n, t in zip(self.watched, self.tested, strict=True) if t and own[n] not in late]
        at = dict(zip(space.names, self.values.tolist(), strict=True))
        table = estimate_table(found.answer.problem, None, {})
        told = asked(table, self.problem)
        prior, drift, self.wide = np.zeros(len(joint)), np.zeros(len(joint)), np.zeros(len(joint))
        given = told.spreads(self.problem, joint, at)[1]
        for k, name in enumerate(joint):
            i = space.names.index(name)
            low, high, v = space.lower[i], space.upper[i], self.values[i]
            edge = 1e-3 * (high - low)
            slope = 1.0 / v if space.log[i] else (high - low) / (max(v - low, edge) * max(high - v, edge))
            self.wide[k] = 0.25 * math.log(high / low) if space.log[i] else 1.5
            prior[k] = min(self.size[self.watched.index(name)] * slope, self.wide[k])
            drift[k] = given.get(name, prior[k] / math.sqrt(self.scales.span))
        first = [max(float(found.noise.initial.get(n, 0.0)), self.scales.spread[n]) for n in model.states]  # pyrefly: ignore[missing-attribute]
        return BlockFilter(
            self.problem,
            found.noise,
            self.values,
            self.places,
            self.size,
            joint,
            prior,
            drift,
            np.diag(first),
            self.recording,
            self.length,
        )

    def _calibrated(self) -> Calibration:
        """How innovations and scores of the study's own recordings scatter."""
        scores, squares, index, number, own = [], [], [], 0, np.zeros(len(self.watched))
        count = 0
        own_values = any(c.recording is not None for c in self.problem.space.coordinates)
        for name, experiment in self.problem.experiments.items():
            mask = experiment.mask("fit")
            if not np.any(mask) or (own_values and name != self.recording):
                continue
            stop = int(np.flatnonzero(mask)[-1]) + 1
            t, u, y = self._arrays(experiment.recording)
            t, u, y = t[:stop], u[:stop], np.where(mask[:, None], y, np.nan)[:stop]
            self.filter.reset()
            early = self._early(t, float(t[0]))
            self.filter.rows.remember(t[early], u[early])
            t, u, y = t[~early], u[~early], y[~early]
            stop = len(t)
            for k in range(0, stop, self.length):
                block = self.filter.run(
                    t[k : min(k + self.length, stop)], u[k : min(k + self.length, stop)], y[k : k + self.length]
                )
                if k == 0:
                    continue  # the first states are not known
                scores.append(block.scores)
                squares.append(np.sum(block.white**2, axis=1) - block.measured)
                index.append(number + k + np.arange(len(block.t)))
                own += np.diag(block.information)
                count += int(np.sum(block.measured))
            number += stop + self.length
        self.filter.reset()
        if count < 2 * FEWEST:
            return Calibration(np.ones(len(self.watched)), 1.0, 1.0, max(count, 5.0))
        s, z, at = np.concatenate(scores), np.concatenate(squares), np.concatenate(index)
        spread = np.diag(prewhitened_long_run(s, at))
        colour = np.maximum(1.0, np.where(own > 0, spread / np.where(own > 0, own, 1.0), 1.0))
        level = max(1.0, 1.0 + float(np.sum(z)) / count)
        heavy = max(1.0, float(prewhitened_long_run((z - np.mean(z))[:, None], at)[0, 0]) / (2.0 * count))
        return Calibration(colour, level, heavy, max(5.0, count / heavy))

    def _arrays(self, recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (n,), inputs (n, inputs) and outputs (n, m) in the model's units, NaN for outputs that are not
        measured."""
        model, signals = self.problem.model, dict(recording.signals)
        there = [n for n in model.outputs if n in signals]
        if not there:
            raise RecordingError(
                f"Recording {recording.name!r} has none of the outputs {list(model.outputs)}, and "
                f"nothing can be tracked; it has {list(signals)}. Name the columns as in the study file."
            )
        for n in model.outputs:
            if n not in signals:
                signals[n] = Signal(np.full(len(recording), np.nan), model.outputs[n])
        given = in_units(Recording(recording.t, signals, recording.name, recording.log), self.problem.needs)
        u = np.stack([given[n] for n in model.inputs], axis=1) if model.inputs else np.zeros((len(given), 0))  # pyrefly: ignore[missing-attribute]
        return np.asarray(given.t, dtype=float), u, np.stack([given[n] for n in model.outputs], axis=1)

    def _early(self, t: np.ndarray, begun: float) -> np.ndarray:
        """Which samples (n,) come before the inputs of a dead time ago are known: they are remembered, and the
        filter begins after them."""
        return t < begun + self.filter.rows.longest

    def feed(self, recording: Recording) -> list[Alarm]:
        """The next samples; alarms that they raise.

        Rows in which an input has no value are left out, so that inputs hold what they had. Raises RecordingError for
        times that do not grow, for an input without any value and for outputs that are all missing.
        """
        if len(recording) == 0:
            return []
        t, u, y = self._arrays(recording)
        if t[0] <= self._last or np.any(np.diff(t) <= 0):
            at = t[0] if t[0] <= self._last else t[1:][np.diff(t) <= 0][0]
            raise RecordingError(
                f"A sample at {at:.6g} s came after one at "
                f"{max(self._last, t[0]):.6g} s; give samples in order of time."
            )
        known = np.all(np.isfinite(u), axis=1)
        if not np.any(known) and self.samples == 0:
            lost = list(self.problem.model.inputs)[int(np.argmax(~np.isfinite(u[0])))]  # pyrefly: ignore[missing-attribute]
            raise RecordingError(
                f"Recording {recording.name!r}: input {lost!r} has no value in any "
                f"of its {len(t)} rows, and a filter needs one; check the column."
            )
        self._last = float(t[-1])
        self.left_out += int(np.sum(~known))
        t, u, y = t[known], u[known], y[known]
        self.samples += len(t)
        if len(t):
            self._begun = float(t[0]) if self._begun is None else self._begun
            early = self._early(t, self._begun)
            self.filter.rows.remember(t[early], u[early])
            t, u, y = t[~early], u[~early], y[~early]
        self._waiting.append((t, u, y))
        t, u, y = (np.concatenate([w[k] for w in self._waiting]) for k in range(3))
        whole, raised = len(t) // self.length * self.length, []
        for k in range(0, whole, self.length):
            part = slice(k, k + self.length)
            raised += self._block(t[part], u[part], y[part])
        self._waiting = [(t[whole:], u[whole:], y[whole:])] if whole < len(t) else []
        return raised

    def finish(self) -> list[Alarm]:
        """Work off the samples of a block that is not full."""
        waiting, self._waiting = self._waiting, []
        return [a for t, u, y in waiting if len(t) for a in self._block(t, u, y)]

    def _block(self, t: np.ndarray, u: np.ndarray, y: np.ndarray) -> list[Alarm]:
        first = self.filter.carry is None
        block = self.filter.run(t, u, y)
        if not np.all(np.isfinite(block.white)):
            raise RecordingError(
                f"The filter lost the plant between {t[0]:.6g} and {t[-1]:.6g} s; give the study more process noise."
            )
        squares, measured = float(np.sum(block.white**2)), int(np.sum(block.measured))
        raised: list[Alarm] = []
        if self._following is not None:
            raised = self._told_later()
        if not first and not self.alarms:  # the first block shows where the states begin
            change = self.changes.look(
                float(t[0]), float(t[-1]), np.sum(block.scores, axis=0), block.information, squares, measured
            )
            if change is not None:
                raised = [self._alarm(change)]
                self.alarms += raised
                self.filter.open(self.wide)
        self.rows.append(self._row(block, squares / max(measured, 1)))
        return raised

    def _alarm(self, change: Change) -> Alarm:
        window = sum(block.t[0] >= change.since for block in self.filter.past)
        # a change that is small is seen long after it began
        blocks = min(2 * window + 1, self.changes.looks, len(self.filter.past))
        self._following = change, blocks, FOLLOWED
        if not change.scored:
            return Alarm(change.t, change.since, None, None, None, None, (), change.factor, change.p, change.allowed)
        found = self._causes(blocks, FIRST)
        if len(found.places) == 1:
            self._following = None
        return self._alarm_of(change, found)

    def _causes(self, blocks: int, share: float) -> Causes:
        """What explains the innovations of the last blocks, of which one at least is behind the change."""
        t = np.concatenate([block.t for block in list(self.filter.past)[-blocks:]])
        times = onsets(t)
        white, slopes = self.filter.since(blocks, times)
        space, at = self.problem.space, self.places
        value = self.values[at]
        # a time constant or a mass keeps its sign
        low = np.where(space.lower[at] >= 0, -value, -np.inf)
        high = np.where(space.upper[at] <= 0, -value, np.inf)
        tested = [int(j) for j in np.flatnonzero(self.tested)]
        noise = max(self.calibration.level, float(np.max(self.calibration.colour[self.tested])))
        return causes(white, slopes, times, tested, (low / self.size, high / self.size), noise, share)

    def _alarm_of(self, change: Change, found: Causes, told: float | None = None) -> Alarm:
        k, *others = found.places
        c = self.problem.space.coordinates[self.places[k]]
        value = float(self.values[self.places[k]])
        now = value + found.change[0] * float(self.size[k])
        alike = tuple(self.watched[j] for j in others)
        since = change.since if alike else found.since[0]
        return Alarm(change.t, since, c.name, c.unit, value, now, alike, change.factor, change.p, change.allowed, told)

    def _told_later(self) -> list[Alarm]:
        """The alarm once more where samples behind it have told its cause."""
        assert self._following is not None
        change, blocks, left = self._following
        blocks = min(blocks + 1, len(self.filter.past))
        self._following = (change, blocks, left - 1) if left > 1 else None
        found = self._causes(blocks, LATER)
        before = self.alarms[0]
        if before.parameter is None and not found.clear:
            return []
        fewer = before.parameter is None or len(found.places) < 1 + len(before.alike)
        if len(found.places) > 1 and not (left == 1 and fewer):
            return []
        self._following = None
        self.alarms = [self._alarm_of(change, found, float(self.filter.past[-1].t[-1]))]
        return self.alarms

    def _row(self, block: Any, nis: float) -> dict[str, float]:
        plant = self.filter.tracked
        n, sd = plant.states, np.sqrt(np.sum(block.root**2, axis=1))
        names = [plant.space.names[i] for i in plant.joint]
        s, step = block.mean[n:], 1e-6
        values = np.asarray(plant.physical(s))
        slope = (np.asarray(plant.physical(s + step)) - np.asarray(plant.physical(s - step))) / (2 * step)
        row = {"t": float(block.t[-1])}
        for name, v, e in zip(plant.model.states, block.mean[:n], sd[:n], strict=True):
            row |= {name: float(v), f"{name}_sd": float(e)}
        for name, v, e in zip(names, values, np.abs(slope) * sd[n:], strict=True):
            row |= {name: float(v), f"{name}_sd": float(e)}
        return row | {"nis": nis, "alarm": float(bool(self.alarms))}

    @property
    def units(self) -> dict[str, str | None]:
        """The unit of every column of `rows`."""
        plant = self.filter.tracked
        found: dict[str, str | None] = {"t": "s"}
        own = dict(plant.model.states) | {plant.space.names[i]: plant.space.coordinates[i].unit for i in plant.joint}
        for name, unit in own.items():
            found |= {name: unit, f"{name}_sd": unit}
        return found | {"nis": None, "alarm": None}

    @property
    def sentence(self) -> str:
        """How it ended."""
        lost = f", {self.left_out} rows without an input left out" if self.left_out else ""
        told = f"{self.samples} samples{lost}, a look every {self.length} ({self.length * self.period:.3g} s)"
        if self.alarms:
            return f"{self.alarms[0].sentence} {told[:1].upper()}{told[1:]}."
        return (
            f"No alarm: the plant is what the study knows of it ({told}; a healthy plant raises an "
            f"alarm with a chance of at most {100 * self.false_alarm:g} %, however long it runs)."
        )

    def to_frame(self) -> "pl.DataFrame":
        """The rows as a polars data frame."""
        import polars as pl

        return pl.DataFrame(self.rows)


def track(
    study: Study | Answer | Problem | Estimators,
    *,
    every: float | None = None,
    false_alarm: float = 0.01,
    progress: Callable[[str], None] | None = None,
    table: Mapping[str, Any] | None = None,
) -> Tracker:
    """A tracker of a study: its filter on line, which raises an alarm when the plant leaves what the study knows of it.

    Noise levels are those of the study's [estimate] table (`table`), found by maximum likelihood where it gives ranges
    or none. A look is made every `every` seconds (default: a fiftieth of the study's record, 10 samples at least).
    `false_alarm` is the chance that a healthy plant ever raises an alarm (docs/kalman.md). Dead times are held at their
    values, and watched. Raises as `estimate_parameters`.
    """
    if isinstance(study, Estimators) and study.scales is None:
        study = study.answer  # generalised least squares alone knows no noise of the plant
    if not isinstance(study, Estimators):
        study = estimate_parameters(study, progress=progress, table=table, methods=["maximum likelihood"])
    if progress is not None:
        progress("preparing the filter")
    return Tracker(study, every, false_alarm)


__all__ = ["Alarm", "Tracker", "track"]
