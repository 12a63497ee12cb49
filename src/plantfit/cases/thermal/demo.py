"""A constant offset, then drifting surroundings: what each says about gain, time constant and dead time."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file, residual, rms
from plantfit.cases.shared.followed import followed_figure
from plantfit.cases.shared.record import figure, record
from plantfit.fitting import Answer
from plantfit.trust.intervals.profile import Profile, profile
from plantfit.trust.validate.dead_time import DeadTime, dead_time

AUTHORS = "authors' first order with dead time"
OWN = "first order, dead time free, by scipy (own)"


def run(folder: str | Path, progress: Callable[[Any], None] | None = None) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`."""
    place = unpack("thermal", folder)
    slow = place / "drift.toml"
    fast = place / "faster_drift.toml"
    files = [place / "thermal.toml", slow, fast]
    answers = {
        label: fit_file(file, progress)
        for label, file in zip(("constant", "slow drift", "faster drift"), files, strict=True)
    }
    late = {n: dead_time(a.problem, a) for n, a in answers.items()}
    gain = {n: profile(a.problem, a, "K") for n, a in answers.items()}
    plain = answers["constant"]
    error = residual(plain, "y")
    figures = [
        figure("constant offset: RMSE", rms(error), "degC", 0.616, OWN),
        figure("slow drift: RMSE", rms(residual(answers["slow drift"], "y")), "degC"),
        figure("faster drift: RMSE", rms(residual(answers["faster drift"], "y")), "degC"),
        figure("constant offset: gain", plain.values["K"], "degC/%", 1.1591, AUTHORS),
        figure("constant offset: time constant", plain.values["tau"], "s", 35.463, AUTHORS),
        figure("constant offset: dead time", plain.values["L"], "s", 0.522, AUTHORS),
        figure("slow drift: dead time, upper end of the interval", late["slow drift"].interval[1], "s"),
    ]
    sentences = [*(f"{n.capitalize()}: {d.sentence}" for n, d in late.items()), *_sentences(answers, late, gain)]
    rows = [
        [
            n,
            str(a.problem.space.dimension),
            f"{rms(residual(a, 'y')):.3f}",
            _span(gain[n]),
            f"{a.values['tau']:.3g}",
            _span(late[n].profile),
        ]
        for n, a in answers.items()
    ]
    section = {
        "title": "What is left is drift",
        "sentences": sentences,
        "tables": [
            {
                "caption": "The same record, three views of the surroundings",
                "columns": [
                    "surroundings",
                    "free numbers",
                    "RMSE [degC]",
                    "gain [degC/%], 95 %",
                    "time constant [s]",
                    "dead time [s], 95 %",
                ],
                "rows": rows,
                "note": "Every interval holds if its model is right. Authors: gain 1.159, time constant 35.5 s, delay "
                "0.52 s.",
            }
        ],
        "figures": [
            {
                "figure": followed_figure(answers, "prbs", "y"),
                "label": "Measured, and simulated with each view of the surroundings.",
            }
        ],
    }
    return record(
        "thermal",
        "Thermal plant",
        figures,
        sentences,
        list(answers.values()),
        files,
        [section],
        "A dead time that is too small to see",
    )


def _sentences(answers: Mapping[str, Answer], late: Mapping[str, DeadTime], gain: Mapping[str, Profile]) -> list[str]:
    """What the three together say."""
    shares = [1.0 - (rms(residual(a, "y")) / rms(residual(answers["constant"], "y"))) ** 2 for a in answers.values()]
    told = [n for n, d in late.items() if d.determined]
    untold = [n for n in late if n not in told]
    ends = {n: d.interval[1] for n, d in late.items() if not d.profile.at_upper}
    top = f"; with {' and '.join(ends)} it is below {max(ends.values()):.2g} s" if ends else ""
    made = [
        f"Drift makes {100 * shares[1]:.0f} % of the mean square that a "
        f"constant offset leaves, {100 * shares[2]:.0f} % if it is faster."
    ]
    if told and untold:
        made.append(
            f"Whether there is a dead time depends on how the surroundings are taken (told with: {', '.join(told)}; "
            f"not with: {', '.join(untold)}), so this record does not tell it from zero{top}."
        )
    elif untold:
        made.append(f"However the surroundings are taken, the dead time cannot be told from zero{top}.")
    low, high = min(g.value for g in gain.values()), max(g.value for g in gain.values())
    made.append(f"The gain moves with that choice, too: {low:.3g} to {high:.3g} degC/%.")
    return made


def _span(p: Profile) -> str:
    """The value with its interval; a bound of the search is no end of it."""
    if p.at_upper:
        return f"{p.value:.3g} (not told)" if p.at_lower else f"{p.value:.3g} (above {p.low:.3g})"
    return f"{p.value:.3g} ({f'below {p.high:.3g}' if p.at_lower else f'{p.low:.3g} to {p.high:.3g}'})"
