"""All that the demo found, for its tables and figures."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from plantfit.cases.double_pendulum.fits.fit_law import predicted, rmse_of
from plantfit.cases.double_pendulum.fits.laws import Fitted
from plantfit.cases.double_pendulum.fits.runs import Run
from plantfit.cases.double_pendulum.reference import reference_torque
from plantfit.trust.validate.cross_validation import Choice, LeftOut
from plantfit.trust.validate.windows import Windows

Scores = Mapping[str, float]  # "joint 1", "joint 2", "both"


@dataclass(frozen=True)
class Results:
    """By law: `left_out` (by run) and `fitted` to all runs. By published model and run: `published`, `alike`
    (filtered alike), `windows` and `angles`, which have "ours" besides, of the runs left out. `errors` are the
    chosen law's standard errors."""

    runs: Mapping[str, Run]
    left_out: Mapping[str, Mapping[str, LeftOut[Fitted]]]
    choice: Choice
    fitted: Mapping[str, Fitted]
    published: Mapping[str, Mapping[str, Scores]]
    alike: Mapping[str, Mapping[str, Scores]]
    windows: Mapping[str, Mapping[str, Windows]]
    angles: Mapping[str, Mapping[str, Scores]]
    errors: Mapping[str, float]

    @property
    def best(self) -> Mapping[str, LeftOut[Fitted]]:
        return self.left_out[self.choice.best]

    @property
    def final(self) -> Fitted:
        return self.fitted[self.choice.best]


def torque_over_all(fitted: Fitted, runs: Mapping[str, Run]) -> Scores:
    """RMSE (N m) over all runs in one, each at its own fitted encoder zeros where the law has them."""
    errors = []
    for name, run in runs.items():
        at = run.shifted(fitted.zeros[name]) if fitted.zeros else run
        errors.append(predicted(fitted, at) - reference_torque(run.raw))
    return rmse_of(np.concatenate(errors, axis=1))
