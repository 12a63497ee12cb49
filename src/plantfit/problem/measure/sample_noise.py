"""The noise of a signal from sample to sample."""

import numpy as np


def white_part(values: np.ndarray) -> float:
    """Standard deviation of the part of a signal or residual (n,) that changes from sample to sample, in its unit; NaN
    below three samples.

    From second differences (von Neumann's idea of 1941 taken to second order); an estimate of measurement noise that
    slow model errors do not raise.
    """
    second = np.diff(values, 2)
    second = second[np.isfinite(second)]
    return float(np.sqrt(np.mean(second**2) / 6.0)) if len(second) else float("nan")
