"""Fit the staircase of January by a table and by a linear model, predict the recordings of June; then the same
within June."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.cases.exchanger.halves import between_levels, refitted
from plantfit.cases.exchanger.sections import levels_section, map_section, unseen_section
from plantfit.cases.shared.files import unpack
from plantfit.cases.shared.fitting import fit_file, part, residual, rms
from plantfit.cases.shared.record import figure, record
from plantfit.fitting import Answer
from plantfit.recording.clean.levels import levels
from plantfit.recording.record import Recording

FILES = ("table.toml", "linear.toml", "june.toml", "june_linear.toml")
BEFORE = 30.0  # s ahead of a step whose mean error is taken off


def run(folder: str | Path, progress: Callable[[Any], None] | None = None) -> dict[str, Any]:
    """See `plantfit.cases.shared.registry.demos`."""
    place = unpack("exchanger", folder)
    files = [place / name for name in FILES]
    table, linear, june, june_linear = answers = [fit_file(file, progress) for file in files]
    halves = between_levels(files[0])
    record_of = {n: e.recording for n, e in table.problem.experiments.items()}
    own = refitted(record_of["january"])
    scores = {
        "January, on january, fitted": (whole(table, "january"), whole(linear, "january")),
        "January, on june_stairs, unseen": (whole(table, "june_stairs"), whole(linear, "june_stairs")),
        "January, on june_prbs, unseen": (whole(table, "june_prbs"), whole(linear, "june_prbs")),
        "June, on june_stairs, fitted half": _part(june, june_linear, "stairs", "fit"),
        "June, on june_stairs, unseen half": _part(june, june_linear, "stairs", "validation"),
        "June, on june_prbs, fitted half": _part(june, june_linear, "prbs", "fit"),
        "June, on june_prbs, unseen half": _part(june, june_linear, "prbs", "validation"),
    }
    steps = {
        n: (after_steps(table, n), after_steps(linear, n), after_steps(None, n, record_of[n]))
        for n in ("june_stairs", "june_prbs")
    }
    unseen = np.concatenate([residual(halves, "y", n) for n, e in halves.problem.experiments.items() if e.fit is None])
    fitted = rms(scores["January, on january, fitted"][0])
    by_level = levels_section(record_of["january"], own)
    figures = [
        figure("staircase of January, one table model", fitted, "degC", 4.76, "one linear model (own)"),
        figure(
            "staircase, a model for each level", rms(_all(own)), "degC", 0.365, "a model refitted at each level (own)"
        ),
        figure("staircase, levels left out of the fit", rms(unseen), "degC"),
        *(
            figure(f"models of {name}: table", rms(a), "degC", rms(b), "linear model, fitted to the same samples")
            for name, (a, b) in scores.items()
            if "fitted" not in name
        ),
        *(
            figure(
                f"models of January, on {name}, change after a step: table",
                rms(a),
                "degC",
                rms(b),
                "linear model of January",
            )
            for name, (a, b, _) in steps.items()
        ),
    ]
    sections = [unseen_section(table, linear, scores, steps, rms(unseen)), by_level, map_section(record_of, table)]
    sentences = [*sections[0]["sentences"], *by_level["sentences"]]
    title = "Plate heat exchanger"
    return record(
        "exchanger",
        title,
        figures,
        sentences,
        answers,
        files,
        sections,
        "Three recordings of half a year, one table model",
    )


def whole(answer: Answer, name: str) -> np.ndarray:
    """Simulated minus measured temperature (n,) of a recording."""
    return residual(answer, "y", name)


def _part(table: Answer, linear: Answer, name: str, which: str) -> tuple[np.ndarray, np.ndarray]:
    mask = part(table, which, name)
    return residual(table, "y", name)[mask], residual(linear, "y", name)[mask]


def after_steps(answer: Answer | None, name: str, recording: Recording | None = None) -> np.ndarray:
    """Error (m,) after each step, less its mean over the 30 s before; without an answer that of "nothing changes"."""
    if answer is None:
        assert recording is not None
        error = -recording["y"]
    else:
        recording, error = answer.problem.experiments[name].recording, residual(answer, "y", name)
    t, made = recording.t, []
    for piece in levels(recording, "u")[1:]:
        ahead = (t >= piece.t[0] - BEFORE) & (t < piece.t[0])
        made.append(error[(t >= piece.t[0]) & (t <= piece.t[-1])] - error[ahead].mean())
    return np.concatenate(made)


def _all(answer: Answer) -> np.ndarray:
    return np.concatenate([residual(answer, "y", n) for n in answer.problem.experiments])
