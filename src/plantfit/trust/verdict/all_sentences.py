"""The verdict: plain sentences, each with its number, from the findings record."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from plantfit.errors import Status
from plantfit.optimize.contract import RunResult
from plantfit.problem.accuracy.verification import NOTHING
from plantfit.trust.heterogeneity.sentences import answer_sentences
from plantfit.trust.identify.directions import extent
from plantfit.trust.verdict.agreement import agreement_sentences
from plantfit.trust.verdict.estimators.filtered import filtered_sentences
from plantfit.trust.verdict.fit import fit_sentences
from plantfit.trust.verdict.misreadings import derivative_sentences, hold_sentences, misreading_sentences
from plantfit.trust.verdict.outputs import at_rest, forgotten
from plantfit.trust.verdict.parameters import parameter_sentences
from plantfit.trust.verdict.residuals import noise_sentences, only_noise, residual_sentences, size_sentences
from plantfit.trust.verdict.searches import forgetting_sentences, search_sentences
from plantfit.trust.verdict.stated_errors import uncertainty_sentences
from plantfit.trust.verdict.unseen import unseen_sentences
from plantfit.trust.verdict.weights import weight_sentences
from plantfit.trust.verdict.words import Sentence, say, with_unit

Findings = Mapping[str, Any]
ENOUGH = 0.05  # of the residual: an error of the simulation that is less is negligible
ALONE = 1e-4  # of the spread of the samples, where the residual is nothing: ten times what the steps are made for
LISTED = 6  # directions along which parameters move together that get a sentence each


def sentences(findings: Findings, best: RunResult) -> list[Sentence]:
    """The verdict in the order in which a reader needs it."""
    return [
        *fit_sentences(findings),
        *forgetting_sentences(findings),
        *unseen_sentences(findings),
        *(findings.get("diagnosis") or {}).get("verdict", []),
        *_agreement(findings, best),
        *answer_sentences(findings),
        *filtered_sentences(findings),
        *parameter_sentences(findings),
        *derivative_sentences(findings),
        *misreading_sentences(findings),
        *hold_sentences(findings),
        *uncertainty_sentences(findings),
        *_combinations(findings),
        *residual_sentences(findings),
        *size_sentences(findings),
        *noise_sentences(findings),
        *weight_sentences(findings),
        *_refused(findings, best),
        *_steps(findings),
        *_failures(findings),
    ]


def _agreement(findings: Findings, best: RunResult) -> Iterator[Sentence]:
    if at_rest(findings):  # every search ends where it begins, and says nothing
        return
    flat = any(p.get("open") or p.get("status") == "flat" for p in findings["parameters"])
    several = len((findings.get("agreement") or {}).get("answers", ())) > 1
    lost = bool(findings["simulation"]["outputs"]) and any(said["level"] == "bad" for said in fit_sentences(findings))
    yield from search_sentences(
        best.extra,
        flat=flat,
        several=several,
        lost=lost,
        ended=best.status is Status.converged,
        forgets=bool(forgotten(findings)),
        noise=only_noise(findings),
    )
    yield from agreement_sentences(findings)


def _combinations(findings: Findings) -> Iterator[Sentence]:
    together = [c for c in findings["combinations"] if len(c["weights"]) > 1]
    if len(together) <= LISTED:
        yield from (say("warning", c["sentence"], relative_sd=c["relative_sd"]) for c in together)
        return
    names = {n for c in together for n in c["weights"]}
    loosest = max(c["relative_sd"] for c in together)
    text = (
        f"Along {len(together)} directions {len(names)} parameters can move together and the simulated "
        f"outputs hardly change, along the loosest by {extent(loosest)} (standard deviation): only "
        "combinations of these parameters are known. The report lists the directions in one table."
    )
    yield say("warning", text, relative_sd=loosest, directions=len(together))


def _refused(findings: Findings, best: RunResult) -> Iterator[Sentence]:
    """Runs whose answer an independent solver could not follow, and what its cost at the reported answer led to."""
    refused = [r["extra"]["refused"] for r in findings["runs"] if "refused" in r["extra"]]
    if refused and "refused" not in best.extra:
        where = refused[0].removeprefix("The answer is refused: ")
        which = "A run" if len(refused) == 1 else f"{len(refused)} runs"
        text = f"{which} found an answer that is an artefact of coarse steps, and it was left out: {where}"
        yield say("warning", text, refused=len(refused))
    if told := best.extra.get("steps"):
        yield say("warning" if "still" in told else "info", told)


def _steps(findings: Findings) -> Iterator[Sentence]:
    if refused := findings["simulation"].get("refused"):
        yield say("bad", f"The answer is refused: in recording {findings['simulation']['recording']}, {refused}.")
    checked = findings["simulation"].get("recording")
    where = f" in {checked}, the least exact recording," if checked and len(findings["recordings"]) > 1 else ""
    reached, samples = findings["simulation"].get("checked_samples"), findings["simulation"].get("samples")
    part = "" if reached is None or reached >= samples else f" over the first {reached} of {samples} samples"
    if part and (allowed := findings["simulation"].get("checked_evaluations")):
        part += f", as far as the {allowed:,} evaluations reach that the check may take,"
    if refused:  # what was compared before it ended speaks for nothing behind
        part = f"{part}, where it could be followed," if part else " where it could be followed"
    for name, o in findings["simulation"].get("outputs", {}).items():
        spread = _spread(findings, name)
        if not (o["rms_residual"] or spread):
            continue
        text = (
            f"The simulation of {name} is exact to {with_unit(o['max_error'], o['unit'])} at worst{part}{where} "
            f"({findings['simulation']['checked_with']}); in the rms it is off by "
        )
        if (
            o["rms_residual"] < NOTHING * spread
        ):  # as of data without noise, or followed exactly: a share of it says nothing
            share, most, of = (
                o["rms_error"] / spread,
                ALONE,
                "spread of the samples, beside which the residual is nothing",
            )
        else:
            share, most, of = o["rms_error"] / o["rms_residual"], ENOUGH, "residual"
        level = "warning" if share >= most else "info" if refused else "good"
        end = "negligible" if share < most else "not negligible: ask for more substeps"
        yield say(level, f"{text}{100 * share:.2g} % of the {of}: {end}.", max_error=o["max_error"], share=share)


def _spread(findings: Findings, output: str) -> float:
    """The standard deviation of what was measured of an output and fitted."""
    own = [r["outputs"][output] for r in findings["recordings"] if output in r["outputs"]]
    y = [v for o in own for v, part in zip(o["measured"], o["part"], strict=True) if v is not None and part == "fit"]
    return float(np.std(y)) if y else 0.0


def _failures(findings: Findings) -> Iterator[Sentence]:
    failed = sum(r["failures"] for r in findings["runs"])
    tried = sum(r["evaluations"] for r in findings["runs"])
    if failed:
        yield say(
            "info", f"{failed} of {tried:.0f} evaluations could not be simulated and were passed over.", failures=failed
        )
