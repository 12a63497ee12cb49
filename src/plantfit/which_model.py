"""Which of my models: finished answers of several models of the same data, compared."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.answer import Answer
from plantfit.errors import ModelError, RecordingError
from plantfit.findings.results.models_compared import ComparisonOfModels
from plantfit.findings.results.result import Result
from plantfit.first_look.baseline import baseline, without
from plantfit.first_look.data import Data, data_of
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording, Signal
from plantfit.report.case_page import write_case_page
from plantfit.report.pages.models_compared import models_page, models_rows
from plantfit.report.text import columns
from plantfit.trust.which_model.candidates import Candidate, candidate, folds
from plantfit.trust.which_model.common_data import Series, shared_data
from plantfit.trust.which_model.comparison import common_scales, compared, enough_unseen
from plantfit.trust.which_model.sentences import told_apart

if TYPE_CHECKING:
    import polars as pl


class ModelsCompared(Result[ComparisonOfModels]):
    """What `compare_models` found."""

    @property
    def best(self) -> str | None:
        """The model that predicts better than all others, None where the data do not tell it from one of them."""
        models = [m.name for m in self.typed.models if m.kind == "model"]
        ahead = [n for n in models if all(told_apart(self.typed, n, o) for o in models if o != n)]
        return ahead[0] if len(ahead) == 1 and len(models) > 1 else None

    def difference(self, first: str, second: str) -> tuple[float, float]:
        """RMSE of `second` less that of `first`, and the half width of its 95 % interval (NaN where it is not known).

        Raises ModelError for a pair that was not compared.
        """
        for p in self.typed.pairs:
            if {p.better, p.worse} == {first, second}:
                difference, half = (np.nan if v is None else v for v in (p.difference, p.half_width))
                return (difference if p.better == first else -difference), half
        raise ModelError(
            f"{first!r} and {second!r} were not compared; there are {[m.name for m in self.typed.models]}."
        )

    def to_frame(self) -> "pl.DataFrame":
        """A polars data frame, a row for each model: model, kind, parameters, effective, determined, rmse_fit,
        rmse_unseen, rmse_left_out, aicc and bic (above the least)."""
        import polars as pl

        rows = [
            {
                "model": m.name, "kind": m.kind, "parameters": m.free, "effective": m.effective,
                "determined": None if m.determined is None else m.determined.count,
                **{f"rmse_{k}": v for k, v in m.rmse}, "aicc": m.aicc, "bic": m.bic,
            }
            for m in self.typed.models
        ]  # fmt: skip
        return pl.DataFrame(
            rows, schema_overrides={"determined": pl.Int64, "rmse_unseen": pl.Float64, "rmse_left_out": pl.Float64}
        )

    def report(self, path: str | Path) -> Path:
        """Write the page with the table, all models over the measured outputs, and their residuals. Raises
        StoreError."""
        return write_case_page(models_page(self.typed), path)

    def table(self) -> str:
        """The table of models as text."""
        head, rows = models_rows(self.typed, ascii_only=True)
        return columns(head, rows, range(1, len(head)))


def compare_models(
    answers: Sequence[Answer] | Mapping[str, Answer], *, determined: bool = True, linear: bool = True
) -> ModelsCompared:
    """Say which of several models of the same data predicts better, and whether the data tell them apart.

    `answers` are what `fit` and `open_study` give, in a list (named by their problems) or a mapping of names to them.
    They are judged by the samples that none has seen; where no 10 samples are unseen, each is fitted again without each
    fifth of every recording, from its answer, and judged by what it says of that fifth. The uncertainty is that of the
    *difference*: of paired losses in blocks longer than their correlation time. Outputs are compared in the units of
    the first. With `determined` the parameters that the data determine are counted, which takes seconds for a model.
    With `linear` the best linear model without physics stands beside them (docs/first-look.md).

    Raises RecordingError where the answers are not of the same data, naming what differs, ModelError for no answer or
    names that repeat.
    """
    named = _named(answers)
    problems = {n: a.problem for n, a in named.items()}
    shared = shared_data(problems)
    again = not enough_unseen(shared.series)
    made: list[Candidate] = []
    for name, answer in named.items():
        own = candidate(name, answer.problem, np.asarray(answer.best.x), shared, again)
        made.append(replace(own, determined=_determined(answer)) if determined else own)
    if linear and (own := linear_candidate(problems[next(iter(problems))], shared.series, again)) is not None:
        made.append(own)
    scales, given = common_scales(list(problems.values()), shared.series, made)
    return ModelsCompared(compared(shared.series, made, scales, given))


def linear_candidate(problem: Problem, series: Sequence[Series], left_out: bool) -> Candidate | None:
    """The best linear model of every output from the inputs of a problem, simulated over the series; None where
    there is none to make: recordings at rest, of different sample times, too short, or without a moving input."""
    inputs = [n for n in getattr(problem.model, "inputs", {}) if n not in problem.outputs]
    if not inputs or any(e.steady for e in problem.experiments.values()):
        return None
    simulated: list[np.ndarray] = [np.zeros(0)] * len(series)
    unknown: list[np.ndarray] = [np.zeros(0)] * len(series)
    count, told, hidden = 0, [], folds(series)
    for output in dict.fromkeys(s.output for s in series):
        own = [k for k, s in enumerate(series) if s.output == output]
        try:
            period = float(np.median(np.diff(series[own[0]].t)))
            data = []
            for s in (series[k] for k in own):
                recording = problem.experiments[s.recording].recording
                measured = Recording(s.t, {**recording.signals, output: Signal(s.measured, s.unit)}, s.recording)
                even = np.allclose(np.diff(s.t), period, rtol=0.01, atol=0)
                data.append(data_of(measured, inputs, output, s.fitted, s.unseen, None if even else period))
            found = baseline(data)
        except RecordingError:
            return None
        count += found.chosen.count
        told.append(found.sentence)
        for k, d, y in zip(own, data, found.chosen.simulated, strict=True):
            simulated[k], unknown[k] = _back(d, y), np.full(len(series[k].t), np.nan)
        for fold in hidden if left_out else ():
            masks = [_onto(d, fold[k]) for k, d in zip(own, data, strict=True)]
            again = without(data, found.chosen, masks)
            for k, d, y in zip(
                own, data, again.simulated if again else [np.full(len(d.y), np.inf) for d in data], strict=True
            ):
                unknown[k][fold[k]] = _back(d, y)[fold[k]]
    sentence = told[0] if len(told) == 1 else "A linear model of each output"
    return Candidate(
        "linear", count, float(count), tuple(simulated), tuple(unknown) if left_out else None, "linear", None, sentence
    )


def _back(d: Data, y: np.ndarray) -> np.ndarray:
    """Values (n,) of the grid at the recording's own times."""
    return y if len(y) == len(d.at) else np.interp(d.at, d.period * np.arange(len(y)), y)


def _onto(d: Data, mask: np.ndarray) -> np.ndarray:
    """A mask (k,) of the recording's own samples on the grid."""
    if len(mask) == len(d.y):
        return mask
    near = np.clip(np.searchsorted(d.at, d.period * np.arange(len(d.y))), 0, len(mask) - 1)
    return mask[near]


def _named(answers: Sequence[Answer] | Mapping[str, Answer]) -> dict[str, Answer]:
    if not answers:
        raise ModelError("compare_models: there is no answer; give two or more of what fit or open_study gives.")
    if isinstance(answers, Mapping):
        return {str(n): a for n, a in answers.items()}
    names = [a.problem.name for a in answers]
    if len(set(names)) == len(names):
        return dict(zip(names, answers, strict=True))
    numbered = [n if names.count(n) == 1 else f"{n} ({1 + names[:k].count(n)})" for k, n in enumerate(names)]
    return dict(zip(numbered, answers, strict=True))


def _determined(answer: Answer) -> tuple[int, int]:
    free = [row["status"] for row in answer.findings["parameters"] if row["status"] != "fixed"]
    return free.count("determined"), len(free)
