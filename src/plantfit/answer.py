"""An answer: the parameters that a fit found, what they are worth, and what they predict."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import PlantfitError, RecordingError, SpaceError
from plantfit.optimize.contract import RunResult
from plantfit.problem.measure.experiment import Experiment
from plantfit.problem.new_recording import begun_off, predict_over
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.recording.told import listed
from plantfit.report import answer_html, fit_plot, summary_text, write_report
from plantfit.trust.assess import assess
from plantfit.trust.intervals.bands import Band, bands
from plantfit.trust.intervals.first_values import outputs_begun_at
from plantfit.trust.intervals.linearised import linearise
from plantfit.trust.intervals.plausible import plausible
from plantfit.trust.stated_errors.shared_error import SharedError

if TYPE_CHECKING:
    import plotly.graph_objects as go
    import polars as pl

    from plantfit.trust.diagnosis.plant.timeless.regression import Regression

MOST_SHOWN = 20  # parameters in a repr, which has to fit on a screen

Signals = dict[str, dict[str, np.ndarray]]


@dataclass(frozen=True, repr=False, eq=False)
class ParameterMatrix:
    """A symmetric matrix (d, d) with a row and a column for each free parameter.

    `units` (d,) are those of the parameters: an entry of a covariance has the product of two of them, one of a
    correlation none. Entries are NaN where a parameter has no standard error. Two names in brackets give one entry:
    `answer.correlation["K", "tau"]`.
    """

    names: tuple[str, ...]
    units: tuple[str | None, ...]
    matrix: np.ndarray

    def __getitem__(self, pair: tuple[str, str]) -> float:
        """The entry of two parameters. Raises PlantfitError for a name that has no row."""
        names = pair if isinstance(pair, tuple) else (pair,)
        unknown = [n for n in names if n not in self.names]
        if unknown or len(names) != 2:
            raise PlantfitError(f"There is no entry {pair!r}; give two of the names {list(self.names)}.")
        return float(self.matrix[self.names.index(names[0]), self.names.index(names[1])])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.matrix, dtype=dtype) if copy is not False else np.asarray(self.matrix, dtype=dtype)

    def to_frame(self) -> "pl.DataFrame":
        """A polars data frame: the names under "parameter", then a column for each of them."""
        import polars as pl

        return pl.DataFrame({"parameter": list(self.names), **{n: self.matrix[:, k] for k, n in enumerate(self.names)}})

    def __repr__(self) -> str:
        shown = self.names[:8]
        width = max([9, *map(len, shown)])
        head = " ".join(["".ljust(width), *(n.rjust(width) for n in shown)])
        rows = [
            " ".join([n.ljust(width), *(f"{v:.3g}".rjust(width) for v in row[:8])])
            for n, row in zip(shown, self.matrix, strict=False)
        ]
        more = [f"and {len(self.names) - 8} more"] if len(self.names) > 8 else []
        return "\n".join([head, *rows, *more])


@dataclass(frozen=True, repr=False)
class Answer:
    """The best parameters, every run, and what they are worth.

    `problem` is the final problem, `runs` are the seeded runs brought to their end on it. `findings` and all that is
    read from it are made when first asked for. Shared `errors` widen the intervals there: to first order, or by so many
    `draws` (docs/uncertainty.md).

    An answer can be pickled; findings that were made travel with it. It cannot be pickled where a model is made of
    functions that are local to another function or lambdas (ModelError); equations as text and library models can.
    """

    problem: Problem
    runs: Sequence[RunResult]
    seed: int
    spec: str | None = None
    command: str = ""
    seconds: Mapping[str, float] = field(default_factory=dict)
    errors: Sequence[SharedError] = ()
    draws: int | None = None

    # what was found

    @property
    def best(self) -> RunResult:
        """The run of the lowest cost; its `x` (d,) is a point of the unit cube."""
        return min(self.runs, key=lambda r: r.cost)

    @property
    def z(self) -> np.ndarray:
        """The point of the unit cube (d,) that `values` are at: that of `best`, or of another estimator."""
        own = self.problem.own_estimate
        return np.asarray(self.best.x if own is None else own.z)

    @property
    def by_least_squares(self) -> "Answer":
        """The same answer by least squares alone; itself where it is that (docs/study-file.md, `estimator`)."""
        return self if self.problem.own_estimate is None else replace(self, problem=self.problem.with_answer(None))

    @property
    def values(self) -> dict[str, float]:
        """Free parameters by coordinate name ("R", "R[train]", "k[3]"), in their units."""
        return dict(zip(self.problem.space.names, self._vector.tolist(), strict=True))

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard errors of `values` by name, in their units; NaN where the findings give none: the data do not
        determine the value."""
        rows = {row["name"]: row["standard_error"] for row in self.findings["parameters"]}
        return {n: float("nan") if rows[n] is None else float(rows[n]) for n in self.problem.space.names}

    @property
    def covariance(self) -> ParameterMatrix:
        """Covariance (d, d) of `values` in products of their units: `correlation` times the standard errors.

        Variances are the squares of `standard_errors`. Stated `errors` of instruments are not in it.
        """
        errors = np.array(list(self.standard_errors.values()))
        return self._named(self._correlation * np.outer(errors, errors))

    @property
    def correlation(self) -> ParameterMatrix:
        """Correlation (d, d) of `values`, that of the problem linearised at the answer; NaN where there is no standard
        error.

        It is that of the noise also where recordings scatter; draws of plants (`bands`) have that of the scatter as
        well.
        """
        return self._named(self._correlation)

    @cached_property
    def findings(self) -> dict[str, Any]:
        """What was found, as JSON types (`plantfit.findings.Findings`), made when first asked for (seconds)."""
        started = time.perf_counter()
        record = assess(
            self.problem, self.runs, seed=self.seed, spec=self.spec, command=self.command, seconds=self.seconds,
            errors=self.errors, draws=self.draws,
        )  # fmt: skip
        record["reproduction"]["seconds"]["trust"] = time.perf_counter() - started
        return record

    def diagnose(
        self, *, whole: bool = False, progress: Callable[[str], None] | None = None,
        stop: Callable[[], bool] | None = None,
        regression: "Regression | None" = None,
    ) -> dict[str, Any] | None:  # fmt: skip
        """Look for what is missing in the model (docs/diagnosis.md), and give section "diagnosis" of the findings.

        Findings, verdict and report say it from then on. It is made where the residual is above its noise or not white,
        and takes at most twice the evaluations of the search; None where there is nothing to look for, and for
        recordings over time beside others at rest. With `whole` everything is tried, whatever the residual
        is. Of a regression that was filtered before the fit `regression` is what it was before
        (`plantfit.spec.before_filter`). `progress` is told what is being tried; the diagnosis ends where `stop` says
        True, and the findings then say that it was stopped. Raises ModelError only with `whole`, for
        recordings over time beside others at rest.
        """
        from plantfit.first_look import linear_beside
        from plantfit.trust.diagnosis import with_diagnosis

        started = time.perf_counter()
        made = with_diagnosis(
            self.problem,
            self.runs,
            self.findings,
            whole=whole,
            progress=progress,
            stop=stop,
            linear=linear_beside,
            regression=regression,
        )
        if made is not self.findings:
            seconds = {**made["reproduction"]["seconds"], "diagnosis": time.perf_counter() - started}
            made["reproduction"] = {**made["reproduction"], "seconds": seconds}
            self.__dict__["findings"] = made  # where cached_property keeps it
        return made["diagnosis"]

    # what it predicts

    @cached_property
    def simulated(self) -> Signals:
        """Simulated outputs: recording -> output -> array (n,) over its times, in units of the output."""
        return {name: self.problem.predict(self._vector, name) for name in self.problem.experiments}

    @property
    def residuals(self) -> Signals:
        """Measured minus simulated outputs, as `simulated`; NaN where nothing was measured."""
        measured = {name: e.recording for name, e in self.problem.experiments.items()}
        return {
            name: {o: measured[name][o] - y for o, y in outputs.items()} for name, outputs in self.simulated.items()
        }

    def predict(
        self, recording: str | Recording | Experiment | None = None, *, values: Mapping[str, Any] | None = None
    ) -> dict[str, np.ndarray]:
        """Every output (n,), in its unit, over a recording: the first or a named one of the problem, or a new one.

        A new recording needs the inputs of the model, in units that can be converted, and a measured value of an output
        where the model begins at one; its steps are as fine as its inputs ask for (`problem.new_recording`). An
        Experiment says how it begins. `values` are other values of parameters by name, in their units; a parameter with
        a value per recording needs one for a recording that is new. Raises RecordingError, UnitError and SpaceError.
        """
        if recording is None:
            recording = next(iter(self.problem.experiments))
        return predict_over(self.problem, self._vector, recording, values)

    def bands(
        self,
        recording: str | Recording | Experiment | None = None,
        *,
        level: float = 0.95,
        draws: int = 200,
        seed: int = 1,
    ) -> dict[str, Band]:
        """Where every output lies over a recording (as `predict` takes it) at `level`, for all parameters that the data
        allow.

        `draws` plants are drawn from the covariance of the answer or by the likelihood where they leave something open;
        readings scatter about them as the residuals of the fit do, and so does the first one, where the model begins at
        it and it was not fitted. Where recordings of the plant scatter, the plants are those of another recording (the
        parameters with "scatter" in the findings). Same seed, same bands. Raises what `predict` raises, SpaceError for
        a level or a number of draws that cannot be, and SearchError where hardly a draw is a plant.
        """
        if not 0.5 <= level <= 0.999 or not 20 <= draws <= 20_000:
            raise SpaceError(f"level {level:g} and {draws} draws cannot be; give 0.5 to 0.999, and 20 to 20000.")
        if recording is None:
            recording = next(iter(self.problem.experiments))
        drawn = plausible(self.problem, self.z, self.findings["parameters"], draws, seed)
        noise = self.score("fit")
        begun = [o for o in outputs_begun_at(self.problem, self.z) if noise.get(o, 0.0) > 0]
        if not begun or begun_off(self.problem, recording, {}) is None:
            return bands(lambda v: predict_over(self.problem, v, recording, None), drawn.values, noise, level)
        # the plant begins beside what is measured first, by the noise of that reading; the answer begins there
        off = np.random.default_rng(seed).standard_normal((len(drawn.values), len(begun)))
        off *= np.array([noise[o] for o in begun]) * (np.arange(len(off)) > 0)[:, None]

        def predict(place: int) -> dict[str, np.ndarray]:
            moved = begun_off(self.problem, recording, dict(zip(begun, off[place].tolist(), strict=True)))
            assert moved is not None
            return moved.outputs(drawn.values[place], {})

        return bands(predict, np.arange(len(drawn.values)), noise, level)

    def score(self, part: str = "validation") -> dict[str, float]:
        """RMSE of every output, in its unit, on part "fit" or "validation", over all recordings."""
        rows = [s for s in self.findings["scores"] if s["part"] == part]
        result = {}
        for output in self.problem.outputs:
            own = [s for s in rows if s["output"] == output]
            if own:
                total = sum(s["n"] for s in own)
                # None: it cannot be simulated there
                squares = [np.nan if s["rmse"] is None else s["n"] * s["rmse"] ** 2 for s in own]
                result[output] = float(np.sqrt(sum(squares) / total))
        return result

    # how it is shown

    @property
    def verdict(self) -> str:
        """The verdict as lines of text."""
        return "\n".join(f"{v['level']:>8}: {v['sentence']}" for v in self.findings["verdict"])

    def summary(self) -> str:
        """Verdict, scores and parameters as text for a terminal, about 100 characters wide."""
        return summary_text(self.findings)

    def report(self, path: str | Path) -> Path:
        """Write the HTML report to `path` and return it. Raises StoreError where it cannot be written."""
        return write_report(self.findings, path)

    def to_frame(self) -> "pl.DataFrame":
        """A polars data frame, one row for each parameter, fixed ones at the end.

        Columns: parameter, value, unit, standard_error, low and high (the 95 % interval), status, lower_bound,
        upper_bound (of the search), open ("lower", "upper", "both": ends of the interval that the data do not set).
        Null where there is none.
        """
        import polars as pl

        text, number = pl.String, pl.Float64
        columns = {
            "value": number, "unit": text, "standard_error": number, "low": number, "high": number, "status": text,
            "lower_bound": number, "upper_bound": number, "open": text,
        }  # fmt: skip
        rows = self.findings["parameters"]
        named = pl.Series("parameter", [row["name"] for row in rows], text)
        return pl.DataFrame([named, *(pl.Series(c, [row.get(c) for row in rows], kind) for c, kind in columns.items())])

    def plot(self, recording: str | None = None) -> "go.Figure":
        """A plotly figure of one recording, the first by default: measured and simulated outputs, residuals, inputs.

        Raises RecordingError for a name that is none of the problem's.
        """
        known = list(self.problem.experiments)
        if recording is not None and recording not in known:
            raise RecordingError(f"There is no recording {recording!r}; there are {known}.")
        return fit_plot(self.findings, recording or known[0])

    def __repr__(self) -> str:
        best, names = self.best, self.problem.space.names
        made = "findings" in self.__dict__
        errors = self.standard_errors if made else {}
        units = [c.unit for c in self.problem.space.coordinates]
        head = (
            f"Answer {self.problem.name!r}: {best.method}, {len(self.runs)} run{'s' * (len(self.runs) > 1)}, cost "
            f"{best.cost:.6g}"
        )
        rows = []
        for name, unit, value in list(zip(names, units, self._vector, strict=True))[:MOST_SHOWN]:
            spread = f" +- {errors[name]:.2g}" if np.isfinite(errors.get(name, np.nan)) else ""
            rows.append(f"  {name} = {value:.6g}{spread}{f' {unit}' if unit else ''}")
        if len(names) > MOST_SHOWN:
            rows.append(f"  and {len(names) - MOST_SHOWN} more")
        counts = [v["level"] for v in self.findings["verdict"]] if made else []
        told = listed([f"{counts.count(level)} {level}" for level in dict.fromkeys(counts)])
        last = (
            f"verdict: {told}; print(answer.summary())"
            if made
            else "print(answer.summary()) says what the values are worth"
        )
        return "\n".join([head, *rows, last])

    def _repr_html_(self) -> str:
        """Verdict and parameters for a notebook."""
        return answer_html(self.findings)

    @cached_property
    def _vector(self) -> np.ndarray:
        """The values (d,) in their units."""
        return np.asarray(self.problem.space.physical(self.z))

    @cached_property
    def _correlation(self) -> np.ndarray:
        local = linearise(self.problem, self.z).covariance
        known = np.isfinite(list(self.standard_errors.values()))
        with np.errstate(all="ignore"):
            size = np.sqrt(np.diag(local))
            found = np.where(known[:, None] & known[None, :], 0.5 * (local + local.T) / np.outer(size, size), np.nan)
        np.fill_diagonal(found, np.where(known, 1.0, np.nan))
        return found

    def _named(self, matrix: np.ndarray) -> ParameterMatrix:
        space, matrix = self.problem.space, matrix.copy()
        matrix.flags.writeable = False
        return ParameterMatrix(space.names, tuple(c.unit for c in space.coordinates), matrix)
