"""Section of the robot's page on its raw readings: speed from counts and from the pulse period, a Butterworth filter
before and after."""

from typing import Any

import numpy as np

import plantfit.recording as rec
from plantfit.cases.shared.panels import signals_figure
from plantfit.recording import Recording
from plantfit.recording.clean.sampling import with_signal
from plantfit.report.figures import style
from plantfit.rig.run import RigRun

PULSES, RATIO = 500, 43 / 9
CUTOFF = 200.0  # Hz, ours: the paper prints none
SHOWN = 0.15  # s that are drawn
FROM = 0.01  # s until the first pulses have come


def cleaned(run: RigRun) -> Recording:
    """The bench's readings with w_counts and w (rad/s), and w_low, I_low after a causal filter, w_both, I_both after
    a zero-phase one."""
    r = rec.counts_to_speed(run.recording, "N", "w_counts", PULSES, RATIO)
    r = rec.period_to_speed(r, "Tp", "w", PULSES, RATIO)
    low, both = (rec.lowpass(rec.lowpass(r, "w", CUTOFF, causal=c), "I", CUTOFF, causal=c) for c in (True, False))
    for end, filtered in (("low", low), ("both", both)):
        for name in ("w", "I"):
            r = with_signal(r, f"{name}_{end}", filtered[name], r.signals[name].unit, "filtered")
    return r


def signals_section(run: RigRun) -> dict[str, Any]:
    """What equations 5 and 16 make of the counts and periods, and the paper's filter, against the bench's exact
    signals."""
    r, exact = cleaned(run), run.exact
    step = 2 * np.pi * RATIO / PULSES / float(np.median(np.diff(r.t)))
    kinds = {"w_counts": "speed from counts (eq. 5)", "w": "speed from the pulse period (eq. 16)",
             "w_low": "the same, causal Butterworth",
             "w_both": "the same, zero-phase Butterworth", "I": "current, RMS", "I_low": "the same, causal Butterworth",
             "I_both": "the same, zero-phase Butterworth"}  # fmt: skip
    rows = []
    for name, said in kinds.items():
        error = r[name] - exact["i" if name.startswith("I") else "w"]
        early, settled = (np.sqrt(np.nanmean(error[part] ** 2)) for part in ((r.t > FROM) & (r.t < 0.1), r.t >= 0.1))
        rows.append([said, r.signals[name].unit or "", f"{early:.3g}", f"{settled:.3g}"])
    early = r.t <= SHOWN
    panels = [
        ("speed [rad/s]", {
            "from counts": (r["w_counts"][early], style.SERIES[1], 0.5),
            "from the period": (r["w"][early], style.MEASURED, 1.0),
            "Butterworth": (r["w_low"][early], style.SIMULATED, 1.6),
        }),
        ("current [A]", {
            "current, RMS": (r["I"][early], style.MEASURED, 1.0),
            "current, Butterworth": (r["I_low"][early], style.SIMULATED, 1.6),
        }),
    ]  # fmt: skip
    columns = ["signal", "unit", f"RMS error {FROM:g} to 0.1 s", "after 0.1 s"]
    return {
        "title": "Raw readings to speed and current (virtual bench)",
        "sentences": [
            f"A count more or less in {1e3 * float(np.median(np.diff(r.t))):g} ms is {step:.0f} "
            "rad/s; the period of the last pulse tells more, with the errors of the disc's slots.",
            "The paper filters both signals by a Butterworth low-pass and prints no cut-off; here order 2 "
            f"at {CUTOFF:g} Hz. It smooths the settled speed. While the motor runs up, the filter on line is "
            "late, which a fit would read as inertia and inductance: the fit below takes the raw readings.",
            "The same readings of a motor of your own constants: `plantfit rig robot_motor --study --exact`.",
        ],
        "tables": [{"caption": "Errors against the exact signals of the bench", "columns": columns, "rows": rows}],
        "figures": [
            {
                "figure": signals_figure(r.t, panels),
                "label": "Speed and current before and after the filter (the paper's figures 2, 3)",
            }
        ],
    }
