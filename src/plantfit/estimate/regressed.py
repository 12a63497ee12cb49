"""A regression problem by instrumental variables beside plain least squares: all its recordings, held coefficients,
unseen samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from plantfit.errors import SearchError
from plantfit.estimate.comparison import SURE, Comparison, compare_estimates
from plantfit.estimate.estimate import Estimate
from plantfit.estimate.instrumental import instrumental_variables
from plantfit.models.library.regression import LinearModel
from plantfit.problem import Experiment, Problem
from plantfit.recording.record import Recording

LABELS = ("plain least squares", "instrumental variables")
APART = 1000  # sample numbers between recordings: no error of one reaches into the next


@dataclass(frozen=True)
class Regressed:
    """`estimate` by instrumental variables (None without instruments), plain `least_squares` on the same rows, and
    their test `bias`.

    `held` are coefficients that were given, `units` those of all. `rmse` is that of "fit" and "validation" samples by
    output, of the instrumental variables' estimate where there is one. `recordings` are plain records of outputs
    measured and explained, as the findings of a fit have them.
    """

    estimate: Estimate | None
    least_squares: Estimate
    bias: Comparison | None
    held: Mapping[str, float]
    units: Mapping[str, str | None]
    rmse: Mapping[str, Mapping[str, float]]
    rows: int
    recordings: tuple[Mapping[str, Any], ...] = field(default=(), repr=False)

    @property
    def best(self) -> Estimate:
        """The estimate to use: by instrumental variables, where there are instruments."""
        return self.least_squares if self.estimate is None else self.estimate

    @property
    def values(self) -> dict[str, float]:
        """Coefficients by name, the held ones too."""
        return {**self.held, **self.best.named}

    @property
    def record(self) -> dict[str, Any]:
        """JSON types: parameters with both estimates, 95 % intervals and on how many independent errors these rest
        (`degrees`), the test of their difference, errors by output."""

        def one(e: Estimate, k: int) -> dict[str, float | None]:
            numbers = {"value": e.values[k], "standard_error": e.standard_error[k], "low": e.low[k], "high": e.high[k]}
            degrees = None if e.degrees is None or not np.isfinite(e.degrees[k]) else float(e.degrees[k])
            return {**{n: float(v) for n, v in numbers.items()}, "degrees": degrees}

        rows = []
        for k, name in enumerate(self.best.names):
            row: dict[str, Any] = {"name": name, "unit": self.units[name], "least_squares": one(self.least_squares, k)}
            rows.append(row | {"instrumental_variables": None if self.estimate is None else one(self.estimate, k)})
        bias = self.bias
        test = None if bias is None else {
            "statistic": bias.statistic, "degrees": bias.degrees, "p_value": bias.p_value,
            "differs": bias.p_value < SURE,
            "sentence": bias.sentence,
        }  # fmt: skip
        return {
            "parameters": rows, "held": dict(self.held), "durbin_wu_hausman": test,
            "rmse": {p: dict(v) for p, v in self.rmse.items()},
            "rows": self.rows, "order_of_whitening": self.best.order,
        }  # fmt: skip


def regress(problem: Problem, instruments: Mapping[str, Recording] | None = None) -> Regressed:
    """The coefficients of a problem whose model is a `LinearModel`, from all its fitted samples.

    `instruments` has for each recording one of the same samples with the signals that the model reads, free of the
    errors of the measurement, as `InverseDynamics.columns` makes them of a reference motion; without it there is plain
    least squares alone, whose errors are robust to correlation. Parameters held by a value are subtracted first where
    they are coefficients themselves.

    Raises SearchError for a model that is no regression, for what is held or tied otherwise, and for instruments of
    other samples.
    """
    model = problem.model
    if not isinstance(model, LinearModel):
        raise SearchError(f"{model.name!r} is simulated and no regression; fit it, or leave instruments out.")
    names, held = tuple(model.coefficients), _held(problem, model)
    free = [k for k, n in enumerate(names) if n not in held]
    if not free:
        raise SearchError(f"All coefficients of {model.name!r} are held; leave the value of one out.")
    known = np.array([held.get(n, 0.0) for n in names])
    x, y, z, index = _rows(problem, model, instruments)
    target, chosen = y - x @ known, tuple(names[k] for k in free)
    plain = instrumental_variables(x[..., free], target, x[..., free], chosen, index=index, whiten=False)
    estimate = None if z is None else instrumental_variables(x[..., free], target, z[..., free], chosen, index=index)
    bias = None if estimate is None else compare_estimates(plain, estimate, LABELS)
    best = known.copy()
    best[free] = (plain if estimate is None else estimate).values
    told = tuple(_explained(model, name, e, best) for name, e in problem.experiments.items())
    return Regressed(estimate, plain, bias, held, dict(model.coefficients), _rmse(told), len(x), told)


def _held(problem: Problem, model: LinearModel) -> dict[str, float]:
    held = {}
    for name, p in problem.space.parameters.items():
        if p.per_recording or p.tied is not None:
            what = "its own in every recording" if p.per_recording else f"tied to {p.tied!r}"
            raise SearchError(
                f"Parameter {name!r} is {what}, and a regression has one number for all recordings; leave that out."
            )
        if p.value is None:
            continue
        if name not in model.coefficients:
            raise SearchError(
                f"Parameter {name!r} is held, but it is none of the coefficients "
                f"{list(model.coefficients)} that the regression has; hold one of these."
            )
        held[name] = float(p.value)
    return held


def _rows(problem: Problem, model: LinearModel, instruments: Mapping[str, Recording] | None) -> Any:
    """Columns (N, m, k), targets (N, m), instruments like the columns or None, and sample numbers (N,) of all fitted
    samples."""
    parts, first = [], 0
    for name, experiment in problem.experiments.items():
        kept = np.flatnonzero(experiment.mask("fit"))
        x, y = _of(model, experiment.recording)
        z = None
        if instruments is not None:
            moved = instruments.get(name)
            if moved is None or len(moved) != len(experiment.recording):
                raise SearchError(
                    f"Recording {name!r} has no instruments of its {len(experiment.recording)} samples; give them."
                )
            z = _of(model, moved)[0]
        kept = kept[np.isfinite(y[kept]).all(axis=1) & np.isfinite((x if z is None else x + z)[kept]).all(axis=(1, 2))]
        parts.append((x[kept], y[kept], x[kept] if z is None else z[kept], first + kept))
        first += len(experiment.recording) + APART
    x, y, z, index = (np.concatenate([p[k] for p in parts]) for k in range(4))
    return x, y, None if instruments is None else z, index


def _of(model: LinearModel, recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    blocks = model.blocks({n: recording[n] for n in model.signals})
    return np.stack([blocks[o] for o in model.outputs], axis=1), np.stack(
        [recording[o] for o in model.outputs], axis=-1
    )


def _explained(model: LinearModel, name: str, experiment: Experiment, values: np.ndarray) -> dict[str, Any]:
    """One recording as the findings of a fit have it."""
    x, y = _of(model, experiment.recording)
    part = np.where(experiment.mask("fit"), "fit", np.where(experiment.mask("validation"), "validation", "")).tolist()
    outputs = {
        o: {"unit": unit, "measured": y[:, k].tolist(), "simulated": (x @ values)[:, k].tolist(), "part": part}
        for k, (o, unit) in enumerate(model.outputs.items())
    }
    return {
        "name": name,
        "log": list(experiment.recording.log),
        "t": experiment.recording.t.tolist(),
        "inputs": {},
        "outputs": outputs,
    }


def _rmse(recordings: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """By part and output; parts without samples are left out."""
    found: dict[str, dict[str, float]] = {}
    for part in ("fit", "validation"):
        for o in recordings[0]["outputs"]:
            own = [r["outputs"][o] for r in recordings]
            errors = np.concatenate(
                [np.subtract(w["measured"], w["simulated"])[np.array(w["part"]) == part] for w in own]
            )
            if len(errors):
                found.setdefault(part, {})[o] = float(np.sqrt(np.nanmean(errors**2)))
    return found
