"""A recording in three lines of text, and the words that such lines share."""

from collections.abc import Sequence
from typing import Any

import numpy as np

EVEN = 1e-3  # steps that differ by less than this share are called even


def listed(words: Sequence[str], most: int = 12) -> str:
    """Words with commas; the first few and a count where there are many."""
    return ", ".join(words) if len(words) <= most else f"{', '.join(words[:most])} and {len(words) - most} more"


def together(words: Sequence[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def either(words: Sequence[str]) -> str:
    """`a, b or c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} or {words[-1]}"


def span(t: np.ndarray) -> str:
    """From which time to which (s), as text."""
    return f"{t[0]:.6g} to {t[-1]:.6g} s"


def recording_text(recording: Any) -> str:
    """Of a `Recording`: how many samples at which times, the signals with units, and where it comes from."""
    t = recording.t
    steps = np.diff(t)
    period = ""
    if len(steps):
        middle = float(np.median(steps))
        even = float(np.max(np.abs(steps - middle))) <= EVEN * middle
        period = f", every {middle:.6g} s" if even else f", uneven: {steps.min():.4g} to {steps.max():.4g} s apart"
    signals = []
    for name, signal in recording.signals.items():
        missing = int(np.sum(np.isnan(signal.values)))
        signals.append(
            f"{name}{f' [{signal.unit}]' if signal.unit else ''}{f' ({missing} missing)' if missing else ''}"
        )
    later = f" ({len(recording.log) - 1} more steps in .log)" if len(recording.log) > 1 else ""
    origin = recording.log[0] if recording.log else "Made in Python."
    return "\n".join(
        [
            f"Recording {recording.name!r}: {len(t)} samples, {span(t)}{period}",
            f"  signals: {listed(signals)}",
            f"  {origin}{later}",
        ]
    )
