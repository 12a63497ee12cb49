"""A regression with every column that may be missing: what a diagnosis tries is a coefficient of it, exact and
compiled once."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.errors import ModelError
from plantfit.models.extensions.terms import term_names, with_terms
from plantfit.models.library.regression import LinearModel
from plantfit.problem.measure.experiment import in_units
from plantfit.problem.measure.filter_alike import filter_alike, of_columns
from plantfit.problem.problem import Problem
from plantfit.recording.record import Recording
from plantfit.trust.diagnosis.meter import Meter
from plantfit.trust.diagnosis.plant.carrier import Carrier, rows_of


@dataclass(frozen=True)
class Regression:
    """A regression before its columns are filtered: `model` and `recordings`, and the options of `filter_alike`
    (None: not filtered)."""

    model: LinearModel
    recordings: Mapping[str, Recording]
    filtered: Mapping[str, Any] | None = None

    @classmethod
    def of(cls, problem: Problem) -> "Regression":
        """That of a problem. Raises ModelError for one whose columns were filtered, as signals are gone then."""
        assert isinstance(problem.model, LinearModel)
        if of_columns(problem.model):
            raise ModelError(
                f"The columns of {problem.model.name!r} were filtered before the fit, and "
                "the signals that they are made of are not there: use `plantfit diagnose` "
                "on its study file, or give regression=plantfit.spec.before_filter(study)."
            )
        return cls(problem.model, {n: e.recording for n, e in problem.experiments.items()})

    def in_units(self) -> "Regression":
        """The same with recordings in the units of the model."""
        needs = {**self.model.signals, **self.model.outputs}
        return replace(self, recordings={n: in_units(r, needs) for n, r in self.recordings.items()})

    def problem(self, given: Problem, terms: Mapping[str, tuple[str, ...]]) -> Problem:
        """The problem with columns more, kind -> keys, of which whole recordings are fitted."""
        model = with_terms(self.model, {kind: {key: (-1.0, 1.0) for key in keys} for kind, keys in terms.items()})
        recordings = self.recordings
        if self.filtered is not None:
            model, recordings = filter_alike(model, recordings, **self.filtered)
        experiments = {
            n: replace(e, recording=recordings[n], fit=(-np.inf, np.inf), validate=None, skip=0.0)
            for n, e in given.experiments.items()
        }
        return Problem(model, experiments, given.space.parameters, scales=given.scales, name=given.name)

    def thinned(self, period: float) -> int:
        """Of how many samples one is independent of the one before as far as the filter goes, for steps of `period`
        s."""
        return 1 if self.filtered is None else max(1, round(0.5 / (float(self.filtered["cutoff"]) * period)))


def carrier_of_regression(
    problem: Problem,
    z: np.ndarray,
    regression: Regression,
    terms: Mapping[str, tuple[str, ...]],
    meter: Meter | None = None,
) -> Carrier:
    """A carrier at the cube point z (d,) with these columns, kind -> keys of a study file; each is an effect inside."""
    made = regression.in_units().problem(problem, terms)
    names = iter(term_names(regression.model, terms))
    inside = {(kind, key): (made.space.names.index(next(names)),) for kind, keys in terms.items() for key in keys}
    period = float(np.median(np.concatenate([np.diff(e.recording.t) for e in problem.experiments.values()])))
    own = problem.space.dimension
    return Carrier(
        made, problem, rows_of(problem), np.asarray(z, dtype=float), own, inside, {}, {}, {}, meter or Meter(),
        thin=regression.thinned(period),
    )  # fmt: skip
