"""The tests of the residuals of every output of every recording."""

from collections.abc import Iterator, Mapping

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.findings.residuals import Cross, ResidualTest
from plantfit.problem.problem import Problem
from plantfit.trust.validate.residuals.curved import curved
from plantfit.trust.validate.residuals.one_stretch import one_stretch
from plantfit.trust.validate.residuals.residual_tests import (
    cross_correlation,
    explained_by_past,
    independent,
    measured_rows,
    whiteness,
)
from plantfit.trust.validate.residuals.sizes import sizes
from plantfit.trust.validate.residuals.turned import turned
from plantfit.trust.verdict.outputs import ROUNDING, TESTED, WHITE


def each_test(
    problem: Problem, predictions: Mapping[str, Mapping[str, np.ndarray]], one_size: bool = False
) -> Iterator[ResidualTest]:
    """Tests of measured less predicted fitted samples, by recording and output; predictions (n,) may be NaN.

    With `one_size` standard errors take the residuals of an output as of one size.
    """
    inputs = getattr(problem.model, "inputs", {})
    count, several = problem.space.dimension, len(problem.experiments) * len(problem.outputs)
    for name, experiment in problem.experiments.items():
        record, mask = experiment.recording, experiment.mask("fit")
        for output in problem.outputs:
            residual = np.where(mask, record[output] - predictions[name][output], np.nan)[mask]
            if np.isfinite(residual).sum() < TESTED or np.nanstd(residual) <= ROUNDING * np.nanmax(
                np.abs(record[output])
            ):
                continue
            rows = measured_rows(residual)
            residual, period = residual[rows], float(np.median(np.diff(record.t[mask][rows])))
            own, p_value = whiteness(residual)
            stretch, against, there = None, None, np.isfinite(residual)
            if p_value <= WHITE and problem.in_time:
                at = np.flatnonzero(mask)[rows][there]
                simulated = predictions[name][output][at]
                against = turned(record.t[at], record[output][at], simulated)
                stretch = (
                    None
                    if against
                    else one_stretch(record.t[at], residual[there], simulated, [record[i][at] for i in inputs])
                )
            ordered = problem.in_time and not experiment.steady
            driven = {} if ordered or p_value <= WHITE else {i: record[i][mask][rows] for i in inputs}
            follows = curved(residual, driven, count, several) if driven else None
            at_rest = one_size and driven and follows is None
            cross = {}
            for i in inputs:
                u = record[i][mask][rows]
                if np.std(u) == 0:
                    continue
                c = cross_correlation(residual, u)
                cross[i] = Cross(
                    lags_s=(c.lags * period).tolist(), values=c.values.tolist(), bound=c.bound,
                    independent=independent(c),
                    explained=explained_by_past(residual, u),
                )  # fmt: skip
            yield ResidualTest(
                recording=name,
                output=output,
                lags_s=(own.lags * period).tolist(),
                autocorrelation=own.values.tolist(),
                bound=own.bound,
                white=bool(p_value > WHITE),
                p_value=p_value,
                first=experiment.start_corrections.get(output),
                shared=experiment.shared_errors.get(output),
                cross=cross,
                stretch=stretch,
                turned=against,
                curved=follows,
                sizes=sizes(residual, predictions[name][output][mask][rows], several) if at_rest else None,
            )
