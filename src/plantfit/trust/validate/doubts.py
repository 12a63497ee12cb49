"""What the verdict of a study means for a controller that is tuned on its model."""

from collections.abc import Iterator, Mapping
from typing import Any

from plantfit.trust.verdict.outputs import found_beside, noise_rows
from plantfit.trust.verdict.residuals import lacking
from plantfit.trust.verdict.unseen import failing
from plantfit.trust.verdict.words import Sentence, number, say, some

MUCH = 3.0  # times the sample-to-sample noise: what the model lacks is more than a correction
PROMISED = "what is promised below may not hold on the plant"


def doubts(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """Why the plant may be another one than those of the model that the data allow; nothing where the model holds."""
    if fails := failing(findings):
        yield say("bad", f"The model does not hold for unseen samples of {some(fails)}: {PROMISED}.")
    elif found := found_beside(findings):
        yield say("warning", f"{found}, and the model that is tuned on does not have it: {PROMISED}.")
    elif named := _named(findings):
        one = "it" if len(named) == 1 else "them"
        yield say(
            "warning", f"The model lacks {some(named)}, by its diagnosis: {PROMISED}. Tune on a model with {one}."
        )
    elif times := _left(findings):
        told = some([f"{number(ratio)} times the noise of {y}" for y, ratio in times.items()])
        text = f"The model lacks something: its residual is {told}, and not white. The plants below are those of this "
        yield say("warning", f"{text}model: {PROMISED}. Look at the verdict of the study first.")


def _named(findings: Mapping[str, Any]) -> list[str]:
    """What the diagnosis calls missing, the first of those that the record does not tell apart."""
    rounds = (findings.get("diagnosis") or {}).get("rounds", ())
    return [r["found"][0] for r in rounds if r["found"] and r.get("likely") in ("likely", "very likely")]


def _left(findings: Mapping[str, Any]) -> dict[str, float]:
    """By output of which the model lacks much, how many times its noise is left."""
    ratios: dict[str, float] = {}
    for row in noise_rows(findings):
        ratios[row["output"]] = max(ratios.get(row["output"], 0.0), row["ratio"])
    return {y: ratios[y] for y in lacking(findings) if ratios.get(y, 0.0) >= MUCH}


__all__ = ["doubts"]
