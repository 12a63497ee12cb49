"""What the verdict says about the weights of several outputs, and who chose them."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from plantfit.trust.verdict.words import Sentence, say, some, with_unit

LISTED = 8  # outputs in one sentence
EXACT = 99.9  # percent of fit, from which on an output may be followed as exactly as one wants


def weight_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """One sentence on the residuals that count as 1, where there are several outputs, the user gave one, or errors
    cannot be told."""
    rows = findings.get("weights", ())
    if len(rows) < 2 and not any(row["chosen"] == "given" or row.get("few") for row in rows):
        return
    told = [f"{row['output']} {with_unit(row['scale'], row['unit'])} ({row['who']})" for row in rows[:LISTED]]
    more = f" and {len(rows) - LISTED} more" if len(rows) > LISTED else ""
    changing = any(not row["settled"] for row in rows)
    text = f"Residuals that count as 1: {', '.join(told)}{more}."
    if changing:
        exact = _followed(findings, rows)
        text += (
            f" Give a scale for {some(exact)}: it can be followed exactly, so that its weight grows without end."
            if exact
            else " They still change after these rounds: the outputs pull the parameters to different places, as where "
            "the model lacks something. Give scales of your own, or find what is missing."
        )
    few = [row["output"] for row in rows if row.get("few")]
    if few:
        names, fix, scales = (
            ", ".join(few[:LISTED]),
            *(("it fixes", "a scale") if len(few) == 1 else ("they fix", "scales")),
        )
        text += f" Nothing shows how large the errors of {names} are, so that {fix} no parameter."
        text += f" Give {scales} for {names} if you know the size of the errors."
    yield say("warning" if changing or few else "info", text)


def _followed(findings: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Outputs whose fitted samples are followed so well that their weight may grow without end."""
    fits: dict[str, list[float]] = {}
    for row in findings.get("scores", ()):
        if row["part"] == "fit" and row.get("fit_percent") is not None:
            fits.setdefault(row["output"], []).append(row["fit_percent"])
    return [row["output"] for row in rows if min(fits.get(row["output"], [100.0])) >= EXACT]
