"""The static curve and the PRBS in one fit: what static_and_prbs.toml reaches on both."""

from typing import Any

import numpy as np

from plantfit.cases.shared.fitting import part, residual, rms
from plantfit.cases.shared.record import figure
from plantfit.fitting import Answer

SETTLING = 3.0  # s at the start of the second half that the reference leaves out as well
TOLERANCE = 38.0  # deg/s, 5 % of the top of the static curve


def joint_figures(answer: Answer) -> list[dict[str, Any]]:
    """Scores of one set of parameters on both records."""
    error, curve = residual(answer, "y", "prbs"), residual(answer, "settled", "curve")
    seen, late = part(answer, "fit", "prbs"), late_half(answer)
    u = answer.problem.experiments["curve"].recording["u"]
    near = np.abs(u) < 0.5
    return [
        figure("both records: RMSE on the fitted half of the PRBS", rms(error[seen]), "deg/s"),
        figure(
            "both records: RMSE on the unseen half, after 3 s, mean error removed",
            float(np.std(error[late])),
            "deg/s",
            5.38,
            "first-order model with dead time about the mean, PRBS alone",
        ),
        figure(
            "both records: static curve, -5 to 5 V, RMSE", rms(curve), "deg/s", TOLERANCE, "5 % of the top of the curve"
        ),
        figure("both records: static curve, largest error", float(np.max(np.abs(curve))), "deg/s"),
        figure(
            "both records: static curve below 0.5 V, mean error",
            float(np.mean(np.sign(u[near]) * curve[near])),
            "deg/s",
        ),
        figure(
            "both records: static curve above 0.5 V, mean error",
            float(np.mean(np.sign(u[~near]) * curve[~near])),
            "deg/s",
        ),
    ]


def late_half(answer: Answer) -> np.ndarray:
    """Samples (n,) bool of the PRBS's unseen half that are scored: `SETTLING` left out."""
    unseen, t = part(answer, "validation", "prbs"), answer.problem.experiments["prbs"].recording.t
    return unseen & (t >= t[unseen][0] + SETTLING)


def joint_sentence(answer: Answer) -> str:
    """What one set of parameters leaves of both records."""
    scales = answer.problem.scales
    return (
        f"`plantfit run static_and_prbs.toml` fits both records together and leaves {scales['y']:.1f} deg/s "
        f"of the one and {scales['settled']:.1f} deg/s of the static curve; by these the fit weighs them."
    )
