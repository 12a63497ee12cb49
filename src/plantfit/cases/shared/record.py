"""What a demo returns: figures beside their references, sentences, answers."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from plantfit.errors import SimulationError
from plantfit.fitting import Answer

FOUND = "What was found"


def figure(
    name: str, value: float, unit: str | None, reference: float | None = None, source: str = ""
) -> dict[str, Any]:
    """A number reached, with the number that others reached and where that stands. Raises SimulationError unless
    finite."""
    if not math.isfinite(value):
        raise SimulationError(
            f"The demo figure {name!r} is {value}; restore the study files and recordings of the demo and run it again."
        )
    return {"name": name, "value": float(value), "unit": unit, "reference": reference, "source": source}


def record(
    name: str,
    title: str,
    figures: Sequence[dict[str, Any]],
    sentences: Sequence[str],
    answers: Sequence[Answer],
    files: Sequence[Path],
    sections: Sequence[dict[str, Any]] = (),
    subtitle: str = "",
    pages: Sequence[Path] = (),
    found: Sequence[str] = (),
) -> dict[str, Any]:
    """The record that `registry.demos` describes; `found` are its first section."""
    first = [{"title": FOUND, "sentences": list(found)}] if found else []
    return {
        "name": name,
        "title": title,
        "subtitle": subtitle,
        "figures": list(figures),
        "sentences": list(sentences),
        "answers": list(answers),
        "files": list(files),
        "found": list(found),
        "sections": [*first, *sections],
        "pages": list(pages),
    }
