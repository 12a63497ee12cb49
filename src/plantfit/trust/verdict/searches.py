"""What the verdict says about the local searches of the best run: how many reached the answer, and what may have
been missed."""

import shlex
from collections.abc import Iterator, Mapping
from typing import Any

from plantfit.trust.verdict.words import Sentence, number, say, some, study_file

AGREE = 3  # independent searches that reached the answer, from which on it is called repeated
NEAR, MOST = 0.1, 0.5  # of the best cost, and of the searches, that make a valley
NOTHING = 1e-12  # of a scaled cost
UNSEEN = (
    0.1  # expected share of the box that leads to optima not seen yet, up to which nothing is said against the answer
)


HARDLY = "The residuals are no more than noise, so that another answer may fit as well, but hardly better."
SHOOT = "where the plant swings for long or is unstable, `shooting = 100` under [search] (docs/long-records.md)"
SEGMENTS = 5  # of each piece of a record that forgets its start


def forgetting_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """What cannot be followed from the first sample to the last, and the lines of a study file that follow it in
    pieces."""
    forgets = findings["simulation"].get("forgets", [])
    if not forgets:
        return
    first, count = forgets[0], len(forgets)
    names, piece = some([f["recording"] for f in forgets], most=3), f"{float(number(first['tenfold'], 1)):g}"
    several = f"simulations of {names} forget their start: in {first['recording']}"
    whose = several if count > 1 else f"simulation of {names} forgets its start: here"
    text = (
        f"The {whose} a small deviation grows tenfold in about {piece} s, {first['growth']:.0e} "
        "times in all. So hardly any simulation from the first sample to the last can follow "
        "it, and none tells what the model lacks. Fit pieces with starts of their own: "
    )
    if file := study_file(findings):
        text += f"`plantfit run {shlex.quote(file)} --pieces {piece}` (docs/long-records.md)."
    else:
        text += (
            f"`pieces = {piece}` under [recording.{first['recording']}], `start` for each state "
            f"under [model.extensions] and `start_STATE = {{ per_recording = true }}` under "
            f"[parameters], `shooting = {SEGMENTS}` under [search] (docs/long-records.md)."
        )
    yield say("bad", text, growth=first["growth"], tenfold=first["tenfold"])


def search_sentences(
    extra: Mapping[str, Any],
    flat: bool = False,
    several: bool = False,
    lost: bool = False,
    ended: bool = False,
    forgets: bool = False,
    noise: bool = False,
) -> Iterator[Sentence]:
    """One sentence from the bookkeeping of `optimize.local.basins.Basins`; none for methods without local searches.

    With `flat`, parameters are open along a valley: searches end anywhere in it, and a larger budget changes nothing.
    Searches that end at costs far above the best are in no valley with it, whatever is open at the answer. With
    `several`, other optima fit equally well. With `lost`, a simulation does not follow its record: segments may find
    what searches over all of it do not. With `forgets` it forgets its start beside, and another sentence says what to
    do. With `ended` the search made as many local searches as it was asked for, and its budget did not stop it. With
    `noise` what is left is noise, and a larger budget would find no answer that fits much better.
    """
    if extra.get("linear"):
        yield say(
            "good",
            "The outputs are linear in all parameters: the answer was computed in one step, and no other fits better.",
        )
        return
    if "missed" in extra:
        yield _by_shooting(extra)
        return
    if "basin_hits" not in extra or "starts" not in extra:
        return
    hits, starts = int(extra["basin_hits"]), int(extra["starts"])
    optima, unseen = int(extra.get("optima", 1)), float(extra.get("unseen", 0.0))
    if starts == 0:
        more = ": where parameters are not determined, a larger budget does not help" if flat else ": give a larger one"
        yield say("warning", f"No local search came to its end within the budget{'' if forgets else more}.")
        return
    if ended and starts == hits == 1:
        text = (
            "One local search was made, as asked, and it ended at the "
            "answer: whether another optimum is better was not looked for. "
        )
        text += "`settings = { least_squares = { agree = 5 } }` under [search] looks for one."
        yield say("info", text, hits=hits, starts=starts, optima=optima)
        return
    text = (
        f"{_count(hits, starts)} from different starts ended {'at the best cost' if several else 'in the best optimum'}"
    )
    if hits and optima > 1 and several:
        text += f", the others at {optima - 1} higher {'one' if optima == 2 else 'ones'}"
    elif hits and optima > 1:
        text += f", the others in {optima - 1} worse {'one' if optima == 2 else 'ones'}"
    if hits < AGREE and flat and not forgets and _in_the_valley(extra):
        yield say(
            "info",
            f"{text}: they end anywhere in the valley of parameters that are not determined.",
            hits=hits,
            starts=starts,
            optima=optima,
        )
    elif hits < AGREE and noise:
        yield say("info", f"{text}. {HARDLY}", hits=hits, starts=starts, optima=optima)
    elif hits < AGREE:
        more = f"; give a larger budget, or, {SHOOT}" if lost else "; give a larger budget"
        yield say(
            "warning",
            f"{text}: a better one may exist{'' if forgets else more}.",
            hits=hits,
            starts=starts,
            optima=optima,
        )
    elif optima > 1 and unseen > UNSEEN:
        doubt = f"about {100 * unseen:.0f} % of the box is expected to lead to optima that no search has seen"
        if noise:
            yield say("info", f"{text}: {doubt}. {HARDLY}", hits=hits, starts=starts, optima=optima, unseen=unseen)
            return
        if cut := int(extra.get("cut_searches", 0)):
            were = "search was cut off before its" if cut == 1 else "searches were cut off before their"
            doubt += f", as {cut} more {were} end"
        yield say(
            "warning", f"{text}: {doubt}; give a larger budget.", hits=hits, starts=starts, optima=optima, unseen=unseen
        )
    else:
        yield say("good", f"{text}.", hits=hits, starts=starts, optima=optima)


def _by_shooting(extra: Mapping[str, Any]) -> Sentence:
    """Of an answer that no search over whole records had found."""
    segments, times = int(extra["segments"]), number(float(extra["missed"]), 2)
    return say(
        "info",
        f"Local searches over whole records ended at an RMSE {times} times as large. Multiple shooting with {segments} "
        f"segments found this answer; `shooting = {segments}` under [search] begins with it (docs/long-records.md).",
        segments=segments,
    )


def _in_the_valley(extra: Mapping[str, Any]) -> bool:
    """Whether most searches that ended did so at about the best cost, as they do along a valley and not in optima of
    their own."""
    costs = [float(c) for c in extra.get("local_costs", ())]
    if not costs:
        return True  # bookkeeping without costs
    best = float(extra.get("basin_cost", min(costs)))
    return sum(c <= (1 + NEAR) * best + NOTHING for c in costs) >= MOST * len(costs)


def _count(hits: int, starts: int) -> str:
    return f"{hits} of {starts} local {'search' if starts == 1 else 'searches'}"
