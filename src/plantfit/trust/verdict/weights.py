"""What the verdict says about the weights of several outputs, and who chose them."""

from collections.abc import Iterator, Mapping
from typing import Any

from plantfit.trust.verdict.words import Sentence, say, with_unit

LISTED = 8  # outputs in one sentence


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
        text += " Give scales where an output can be followed exactly: its weight grows without end."
    few = [row["output"] for row in rows if row.get("few")]
    if few:
        names, fix, scales = (
            ", ".join(few[:LISTED]),
            *(("it fixes", "a scale") if len(few) == 1 else ("they fix", "scales")),
        )
        text += f" Nothing shows how large the errors of {names} are, so that {fix} no parameter."
        text += f" Give {scales} for {names} if you know the size of the errors."
    yield say("warning" if changing or few else "info", text)
