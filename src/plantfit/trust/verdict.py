"""The verdict: plain sentences, each with its number, from the findings record."""

from collections.abc import Iterator, Mapping
from typing import Any

from plantfit.optimize.contract import RunResult
from plantfit.trust.verdict_fit import fit_sentences, noise_sentences, residual_sentences, unseen_sentences
from plantfit.trust.verdict_parameters import parameter_sentences
from plantfit.trust.verdict_uncertainty import uncertainty_sentences
from plantfit.trust.words import Sentence, number, say, with_unit

Findings = Mapping[str, Any]


def sentences(findings: Findings, best: RunResult) -> list[Sentence]:
    """The verdict in the order in which a reader needs it."""
    return [
        *fit_sentences(findings),
        *unseen_sentences(findings),
        *_agreement(findings, best),
        *parameter_sentences(findings),
        *uncertainty_sentences(findings),
        *_combinations(findings),
        *residual_sentences(findings),
        *noise_sentences(findings),
        *_steps(findings),
        *_failures(findings),
    ]


def _agreement(findings: Findings, best: RunResult) -> Iterator[Sentence]:
    extra = best.extra
    if "basin_hits" in extra and "starts" in extra:
        hits, starts = int(extra["basin_hits"]), int(extra["starts"])
        level = "good" if hits >= 3 else "warning"
        if starts == 0:
            yield say("warning", "No local search came to its end within the budget: give a larger one.")
            return
        text = f"{hits} of {starts} local searches from different starts ended in the best optimum"
        text += "." if hits >= 3 else ": a better one may exist; give a larger budget."
        yield say(level, text, hits=hits, starts=starts)
    runs = findings["runs"]
    if len(runs) > 1 and findings["basins"]:
        top = findings["basins"][0]
        level = "good" if top["share"] >= 0.5 else "warning"
        yield say(
            level, f"{top['runs']} of {len(runs)} runs agree on the best cost, {number(top['cost'])}.", runs=top["runs"], of=len(runs)
        )


def _combinations(findings: Findings) -> Iterator[Sentence]:
    for c in findings["combinations"]:
        if len(c["weights"]) > 1:
            yield say("warning", c["sentence"], relative_sd=c["relative_sd"])


def _steps(findings: Findings) -> Iterator[Sentence]:
    checked = findings["simulation"].get("recording")
    where = f" in {checked}, the least exact recording," if checked and len(findings["recordings"]) > 1 else ""
    for name, o in findings["simulation"].get("outputs", {}).items():
        if not o["rms_residual"]:
            continue
        share = o["rms_error"] / o["rms_residual"]
        level = "good" if share < 0.05 else "warning"
        end = "negligible" if share < 0.05 else "not negligible: ask for more substeps"
        text = (
            f"The simulation of {name} is exact to {with_unit(o['max_error'], o['unit'])} at worst{where} "
            f"({findings['simulation']['checked_with']}), {100 * share:.2g} % of the residual: {end}."
        )
        yield say(level, text, max_error=o["max_error"], share=share)


def _failures(findings: Findings) -> Iterator[Sentence]:
    failed = sum(r["failures"] for r in findings["runs"])
    tried = sum(r["evaluations"] for r in findings["runs"])
    if failed:
        yield say("info", f"{failed} of {tried:.0f} evaluations could not be simulated and were passed over.", failures=failed)
