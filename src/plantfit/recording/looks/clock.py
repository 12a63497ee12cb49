"""Looks at the times of a recording."""

from collections.abc import Iterator

import numpy as np

from plantfit.recording.looks.look import Look
from plantfit.recording.record import Recording

# median periods from which on a step is a gap; share of steps that are off by a tenth, from which it is said
GAP, SHARE = (1.5, 0.01)


def clock_looks(recording: Recording) -> Iterator[Look]:
    """Gaps and uneven steps of the clock."""
    t = recording.t
    steps = np.diff(t)
    if len(steps) < 10:
        return
    period = float(np.median(steps))
    gaps = np.flatnonzero(steps > GAP * period)
    uneven = float(np.mean(np.abs(steps - period) > 0.1 * period))
    if len(gaps) and len(gaps) <= 0.05 * len(steps):
        longest = int(gaps[np.argmax(steps[gaps])])
        yield Look(
            "gaps", "info", recording.name, None,
            f"The clock of {recording.name} has {len(gaps)} {'gap' if len(gaps) == 1 else 'gaps'}: samples are "
            f"{period:.4g} s apart, and "
            f"{steps[longest]:.4g} s at t = {t[longest]:.4g} s. Inputs are held over it.",
            float(t[gaps[0]]), float(t[gaps[-1] + 1]), figures={"gaps": len(gaps), "longest": float(steps[longest])},
        )  # fmt: skip
    elif uneven > SHARE:
        yield Look(
            "irregular", "info", recording.name, None,
            f"The clock of {recording.name} is uneven: {100 * uneven:.0f} % of the steps differ by more than a tenth "
            f"from {period:.4g} s "
            f"({steps.min():.4g} to {steps.max():.4g} s).",
            float(t[0]), float(t[-1]), figures={"share": uneven},
        )  # fmt: skip
