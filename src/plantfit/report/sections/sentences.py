"""Plain sentences that the report says about findings."""

from collections.abc import Iterable, Sequence

from plantfit.errors import Status
from plantfit.findings import Cross, Findings, Parameter, ResidualTest
from plantfit.report.numbers import UNKNOWN, count, percent, significant

LEVELS = {"good": ("Good", "✓"), "warning": ("Caution", "!"), "bad": ("Problem", "✕"), "info": ("Note", "i")}
_STATUS = {
    "determined": "determined by the data",
    "weak": "weakly determined: the interval is wide",
    "flat": "not determined: the data set no end to it",
    "not visited": "not visited: no sample depends on it, so that it is not measured",
    "fixed": "held fixed, not fitted",
}


def subtitle(findings: Findings) -> str:
    """One line: how many parameters were fitted to what, by which methods."""
    free = sum(p.status != "fixed" for p in findings.parameters)
    outputs = dict.fromkeys(name for r in findings.recordings for name in r.outputs)
    methods = dict.fromkeys(r.method for r in findings.runs)
    parts = [many(free, "parameter") + " fitted"]
    if outputs:
        parts.append(f"to {listed(outputs)}")
    if findings.recordings:
        parts.append(
            f"of {many(len(findings.recordings), 'recording')} ({listed(r.name for r in findings.recordings)})"
        )
    if methods:
        parts.append(f"in {many(len(findings.runs), 'run')} of {listed(methods)}")
    return " ".join(parts) + "."


def tally(findings: Findings) -> str:
    """How many sentences of the verdict are good, need caution, are problems."""
    words = {"good": "good", "warning": "caution", "bad": "problem"}
    counts = {level: sum(v.level == level for v in findings.verdict) for level in words}
    return " · ".join(
        f"{n} {words[level]}{'s' if level == 'bad' and n > 1 else ''}" for level, n in counts.items() if n
    )


def parameter_status(parameter: Parameter) -> str:
    """What is known of one parameter, in words."""
    if parameter.at_bound:
        return f"at its {parameter.at_bound} bound: widen the bound or question the model"
    return _STATUS.get(parameter.status, parameter.status)


def run_status(status: str) -> str:
    """The sentence of a run's status; an unknown one stays as it is."""
    return Status(status).sentence if status in Status.__members__ else status


_ENDED = {
    "searched": "A local search from there came to its end.",
    "segments": "Multiple shooting found another answer, at which it ends.",
    "same point": "It shares the local search of a run that ended at the same point.",
    "cut": "A local search from there was cut.",
    "left": "No local search went on from there.",
}


def run_end(ended: str) -> str:
    """How a run was brought to the final problem; empty if it was not."""
    return _ENDED.get(ended, ended)


def whiteness(test: ResidualTest, noise: str = "") -> str:
    """Whether the residuals of one output still hold a pattern, and whether errors that samples share or `noise` that
    is "correlated" or "moves" the plant leave such a one."""
    small = test.p_value is not None and test.p_value < 1e-6
    p = "" if test.p_value is None else " (p < 0.000001)" if small else f" (p = {significant(test.p_value, 2)})"
    if test.white and test.curved is not None:
        return (
            f"White{p} in the order of the rows, but a polynomial of the inputs explains "
            f"{100 * test.curved.explained:.0f} % of their squares: something is missing."
        )
    if test.white and test.sizes is not None:
        where = "highest" if test.sizes.high > test.sizes.low else "lowest"
        return (
            f"White{p} in the order of the rows, but not of one size: larger where the model is {where}. The standard "
            "errors take them as of one size."
        )
    if test.white:
        return f"White{p}: the residuals look like noise; the model explains what can be explained."
    if test.shared:
        return (
            f"Not white{p}: the errors of {test.output} come back with {test.shared}, which leaves such a pattern; the "
            "standard errors allow for that."
        )
    if noise == "moves":
        return f"Not white{p}: noise that moves the plant leaves such a pattern; errors one sample ahead are white."
    if noise:
        return f"Not white{p}: noise that is correlated leaves such a pattern; the standard errors allow for that."
    return (
        f"Not white{p}: the residuals follow a pattern that the model does not explain; "
        "the standard errors allow for that, but something is missing."
    )


def begins(off: float, unit: str | None) -> str:
    """By how much a simulation begins `off` the first measured value."""
    by = " ".join((significant(abs(off), 2), *([unit] if unit else ())))
    where = "above" if off > 0 else "below"
    return f"The simulation begins {by} {where} the first measured value: the fit estimated the noise of that value."


def independence(name: str, cross: Cross, named: bool = False) -> str:
    """Whether an input still shows in the residuals; what that means is left to the diagnosis where it `named` what
    is missing."""
    if named:
        return f"No correlation with {name} beyond chance." if cross.independent else f"Still correlated with {name}."
    if cross.independent:
        return f"Independent of {name}."
    return f"Still depends on {name}: some effect of this input is missing from the model."


def no_validation(findings: Findings) -> str:
    """Why there is no score on unseen data; empty when there is one."""
    if any(s.part == "validation" for s in findings.scores):
        return ""
    return "No unseen data: give validation to know if the fit holds beyond the samples it was made from."


def decimated(samples: Sequence[int], points: int) -> str:
    """What was left out of the drawings of recordings with so many samples; empty when nothing was."""
    bins = [round(2 * n / points) for n in samples if n > points]
    if not bins:
        return ""
    every = count(bins[0]) if len(set(bins)) == 1 else f"{count(min(bins))} to {count(max(bins))}"
    used = f"all {count(samples[0])} samples" if len(samples) == 1 else "all samples"
    return f"Shown decimated: lowest and highest of every {every} samples. All numbers use {used}."


def share(value: float | None) -> str:
    """The part of the runs that ended in a basin."""
    return UNKNOWN if value is None else percent(value)


def many(n: int, noun: str) -> str:
    """`1 run`, `3 runs`."""
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def listed(names: Iterable[str], most: int = 6) -> str:
    """`a, b and c`; long lists are cut with their number."""
    names = list(names)
    if len(names) > most:
        return f"{', '.join(names[: most - 1])} and {len(names) - most + 1} more"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
