"""What the verdict says about agreement of runs, and about runs that were cut."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from plantfit.trust.verdict.outputs import forgotten
from plantfit.trust.verdict.words import Sentence, number, say, some

TOLD = 3  # distinct answers, and parameters of each, that are named
APART = 1e-3  # relative difference from which a parameter of distinct answers is named


def agreement_sentences(findings: Mapping[str, Any]) -> Iterator[Sentence]:
    """How many runs reach the reported answer on the final problem, what was cut, and whether answers of one cost
    are one model."""
    told = findings.get("agreement")
    if not told:
        return
    if told["runs"] > 1:
        yield _count(told)
    if forgotten(findings):
        more = ""  # its cost has optima everywhere, and another sentence says what to do
    elif any(p.get("open") or p.get("status") == "flat" for p in findings.get("parameters", ())):
        more = ". It goes on along parameters that the data do not determine"
    else:
        more = ". Give a larger budget"
    yield from _cut(told, more)
    yield from _answers(told)


def _count(told: Mapping[str, Any]) -> Sentence:
    """Of the runs that were searched on; those left where they stood are told apart, and those cut on the way are no
    agreement."""
    runs, left, cut = told["runs"], told["left"], told["cut"]
    which = f"the {runs - left} runs that were searched on" if left else f"{runs} runs"
    text = f"{told['agree']} of {which} agree on the best cost, {number(told['cost'])}."
    if cut:
        text += f" {cut} of the others {'was' if cut == 1 else 'were'} cut in the local search on the final problem."
    if left:
        text += f" The other {left} of {runs} runs were left where the search had ended."
    return say("good" if 2 * told["agree"] >= runs - left else "warning", text, runs=told["agree"], of=runs - left)


def _cut(told: Mapping[str, Any], more: str) -> Iterator[Sentence]:
    runs, spent, reached = told["runs"], told["spent"], told["spent_and_agree"]
    if told["ended"] == "cut":
        yield say(
            "warning",
            "The reported answer is not the end of a search: the local "
            f"search on the final problem was cut after 200 derivatives{more}.",
        )
    if not spent:
        return
    if runs == 1:
        text = "The run was cut by its budget"
        text += (
            "; a local search from where it stood came to its end at the reported answer."
            if told["ended"] == "searched"
            else "."
        )
    else:
        text = (
            f"{spent} of {runs} runs {'was' if spent == 1 else 'were'} cut by {'its' if spent == 1 else 'their'} budget"
        )
        searched = told["spent_and_searched"]
        which = "each" if searched == spent else f"{searched} of them"
        text += (
            f"; a local search from where {which} stood reached the best cost in {reached} of {searched}."
            if told["ended"]
            else "."
        )
    yield say("info", text, cut=spent)


def _answers(told: Mapping[str, Any]) -> Iterator[Sentence]:
    for s in told["symmetries"]:
        yield say("info", f"Answers at several places are one: {s['sentence']}.")
    answers = told["answers"]
    if len(answers) > 1:
        shown = [f"{_values(a, answers)}{_of_runs(a['runs'], told['runs'])}" for a in answers[:TOLD]]
        more = f", and {len(answers) - TOLD} more" if len(answers) > TOLD else ""
        text = (
            f"{len(answers)} different answers fit equally well: "
            f"{'; '.join(shown)}{more}. The data do not tell them apart."
        )
        yield say("warning", text, answers=len(answers))


def _of_runs(own: int, runs: int) -> str:
    """How many of several runs ended at an answer."""
    if runs == 1:
        return ""
    return f" ({own} run{'s' if own > 1 else ''})" if own else " (local searches within the runs)"


def _values(answer: Mapping[str, Any], answers: Sequence[Mapping[str, Any]]) -> str:
    """The parameters that differ most between the answers, with their values in this one."""

    def differs(name: str) -> float:
        values = [a["parameters"][name] for a in answers]
        return (max(values) - min(values)) / (max(map(abs, values)) or 1.0)

    names = [n for n in sorted(answer["parameters"], key=differs, reverse=True) if differs(n) > APART][:TOLD]
    return some(
        [f"{n} = {number(answer['parameters'][n])}" for n in answer["parameters"] if n in names]
        or ["no parameter differs"]
    )
