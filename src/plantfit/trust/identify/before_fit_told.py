"""What `check` says before a fit: how many combinations the records can determine, and what would have to be known."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from plantfit.trust.verdict.words import some

if TYPE_CHECKING:
    from plantfit.trust.identify.before_fit import BeforeFit

ROUGH = 0.5  # relative standard error from which on a parameter is only roughly known


def sentences(found: "BeforeFit") -> Iterator[tuple[str, str]]:
    """(level, sentence) of what records can determine."""
    d = len(found.names)
    tried = f"{found.points - found.lost} random points of the bounds"
    if len(found.unseen) == d and not found.entries:
        told = f"No parameter has any effect on the fitted samples at any of {tried}, whatever value it has: with such "
        yield (
            "warning",
            f"{told}bounds nothing moves the outputs. Look at the bounds, and at the inputs and their units.",
        )
    elif plain := [n for n in found.unseen if n not in found.entries]:
        does = "has" if len(plain) == 1 else "have"
        yield (
            "warning",
            f"{some(plain)} {does} no effect on the fitted samples "
            f"at any of {tried}, whatever {'value it has' if len(plain) == 1 else 'values they have'}: hold a value, "
            "or record what it acts on.",
        )
    yield from _of_tables(found, tried)
    yield from _unheard(found)
    if found.rank == d:
        given = (
            f"With {'a scale' if len(found.silent) == 1 else 'scales'} for {some([*found.silent])} these"
            if found.silent
            else "These"
        )
        yield "info", f"{given} records can tell all {d} parameters apart (rank of the sensitivities at {tried})."
    elif found.rank + len(found.unseen) < d:
        told = [*found.alone, *found.together]
        can = f"These records can determine {found.rank} of {d} at best"
        if found.varies:
            can = f"Where they tell most of {tried}, the records can determine {found.rank} of {d - len(found.unseen)}"
        if any(seen is not False for seen in found.entries.values()):
            can = f"Of what these points reach, the records can determine {found.rank} of {d - len(found.unseen)}"
        if len(told) == found.rank:
            what = f"{can}: {', '.join(told)}."
        elif not found.agreed:
            what = f"{can}. Too few of these points tell so much that it can be said which."
        else:
            left = found.rank - len(told)
            own = f": {', '.join(told)}, and {left} function{'s' if left > 1 else ''}" if told else "; only functions"
            which = (
                "that are neither products of powers nor sums"
                if left > 1 or not told
                else ("that is neither a product of powers nor a sum")
            )
            what = f"{can}{own} of {some(found.open)} {which}."
        yield "warning", f"{what} {_advice(found)}".strip()
    if found.rough:
        worst = sorted(found.rough, key=lambda n: -found.rough[n])
        known = f" with {some(found.fix[0])} known" if found.fix else ""
        left = (
            f"Noise of 1 % of the outputs' standard deviation would leave {some(worst)} known only to more than "
            f"{100 * ROUGH:.0f} %"
        )
        yield "info", f"{left} at half of these points{known}."


def _of_tables(found: "BeforeFit", tried: str) -> Iterator[tuple[str, str]]:
    """Entries of tables that no trial simulation comes to: the recordings may."""
    there, nowhere, hidden = ([n for n, seen in found.entries.items() if seen is s] for s in (True, False, None))
    if there:
        yield (
            "info",
            f"No simulation at {tried} comes to {some(there)}, and the recordings do: the fit shows what they tell "
            f"of {'it' if len(there) == 1 else 'them'}.",
        )
    if nowhere:
        yield (
            "warning",
            f"No fitted sample comes to {some(nowhere)}: hold {'a value' if len(nowhere) == 1 else 'values'}, leave "
            f"{'that node' if len(nowhere) == 1 else 'these nodes'} out, or record what goes there.",
        )
    if hidden:
        yield (
            "info",
            f"No simulation at {tried} comes to {some(hidden)}. What the table is over is not measured, so only the "
            "fit shows whether the recordings do.",
        )


def _unheard(found: "BeforeFit") -> Iterator[tuple[str, str]]:
    """That nothing will show the errors of some outputs, and what is left without them; that samples are too few for
    any interval."""
    d = len(found.names)
    if found.silent:
        many, of = len(found.silent) > 1, some([*found.silent])
        text = (
            f"{of} {'have' if many else 'has'} {some([str(n) for n in found.silent.values()])} "
            "fitted samples, no more than the "
        )
        text += f"parameters that follow them, and nothing shows how large {'their' if many else 'its'} errors are. "
        known = f": {', '.join(found.heard_alone)}" if found.heard == len(found.heard_alone) and found.heard else ""
        text += f"Unless the study gives {'scales' if many else 'a scale'} for {of}, these records determine "
        text += f"{found.heard or 'none'} of {d} parameters{' at best' if found.heard else ''}{known}."
        yield "warning", text
    if found.few and not found.silent:
        yield (
            "warning",
            f"{found.few} fitted samples are too few for {d} parameters: a fit will call none of them determined.",
        )


def _advice(found: "BeforeFit") -> str:
    if not found.fix:
        return ""
    if len(found.fix[0]) == 1:
        names = [f[0] for f in found.fix]
        return f"Hold or measure {'one of ' if len(names) > 1 else ''}{some(names, 6)}."
    return f"Hold or measure {len(found.fix[0])} of them, such as {' and '.join(found.fix[0])}."
