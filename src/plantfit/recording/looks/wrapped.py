"""Whether a signal begins anew at the end of its range, as an angle of 0 to 360 degrees or a counter of 16 bits."""

import numpy as np

from plantfit.recording.clean.outliers import inline
from plantfit.recording.clean.wraps import wraps_of
from plantfit.recording.looks.look import MARKED, Look
from plantfit.recording.record import Recording


def wrapped_look(recording: Recording, name: str) -> Look | None:
    """That a signal leaps from one end of its range to the other and goes on there; None where it does not."""
    good = np.isfinite(recording[name])
    times, unit = recording.t[good], recording.signals[name].unit
    found = wraps_of(recording[name][good], unit)
    if found is None:
        return None
    period, at = found
    bare = unit in (None, "", "1")
    told = f"{period:.6g}" if bare else f"{period:.6g} {unit}"
    once = "once" if len(at) == 1 else f"{len(at)} times"
    step = inline({"step": "unwrap", "signal": name, "period": float(f"{period:.9g}") if bare else told})
    return Look(
        "wrapped", "warning", recording.name, name,
        f"{name} leaps by {told} {once}, first at t = {times[at[0]]:.4g} s, and goes on there: an angle or a counter "
        "that began anew.",
        float(times[at[0]]), float(times[at[-1]]), f"clean = [{step}]",
        {"period": period, "times": len(at)}, times[at][:MARKED].tolist(),
    )  # fmt: skip
