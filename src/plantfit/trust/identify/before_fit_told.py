"""What `check` says before a fit: how many combinations the records can determine, and what would have to be known."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from plantfit.trust.verdict.words import some

ROUGH = 0.5  # relative standard error from which on a parameter is only roughly known


@dataclass(frozen=True)
class BeforeFit:
    """What records can determine of the free parameters `names`, the true values being unknown.

    `rank` counts determined combinations. `alone` are parameters that are determined by themselves, `together` formulas
    of those that are not, `unseen` parameters without any effect. `entries` are those of them that are entries of a
    table to which no simulation came, and whether a recorded sample does; None where nobody can see. `open` are the
    parameters of which only combinations are determined, and each of `fix` is a set of them that makes the others
    determined. `rough` maps parameters that noise of 1 % would leave roughly known to their median relative standard
    error. `points` were tried, `lost` of them could not be simulated.

    `varies` where the rank is not the same at all points, as where a limit, friction or an event acts at some of them:
    other values may then determine more. Formulas are `agreed` where enough points have that rank; else none is named.

    `silent` maps outputs whose fitted samples are no more than the parameters that follow them, and whose scale nobody
    gave, to the number of these samples: nothing shows how large their errors are, and a fit gives no interval that
    rests on them. Without them the rank is `heard`, and `heard_alone` are determined by themselves. `few` is the number
    of all fitted samples where they are too few for intervals that hold, else 0.
    """

    names: tuple[str, ...]
    rank: int
    alone: tuple[str, ...]
    together: tuple[str, ...]
    open: tuple[str, ...]
    unseen: tuple[str, ...]
    fix: tuple[tuple[str, ...], ...]
    rough: dict[str, float]
    points: int
    lost: int
    silent: dict[str, int] = field(default_factory=dict)
    heard: int = 0
    heard_alone: tuple[str, ...] = ()
    few: int = 0
    entries: dict[str, bool | None] = field(default_factory=dict)
    varies: bool = False
    agreed: bool = True

    @property
    def sentences(self) -> list[tuple[str, str]]:
        """(level, sentence): "info" where all can be determined, else "warning"."""
        return list(_sentences(self))

    @property
    def record(self) -> dict[str, Any]:
        """As a plain record, with the sentences."""
        return {
            "rank": self.rank, "of": len(self.names), "alone": list(self.alone), "together": list(self.together),
            "open": list(self.open),
            "unseen": list(self.unseen), "fix": [list(f) for f in self.fix], "rough": self.rough, "points": self.points,
            "lost": self.lost,
            "silent": self.silent, "heard": self.heard, "heard_alone": list(self.heard_alone), "few": self.few,
            "entries": self.entries, "varies": self.varies, "agreed": self.agreed,
            "sentences": [{"level": level, "sentence": sentence} for level, sentence in self.sentences],
        }  # fmt: skip


def _sentences(found: BeforeFit) -> Iterator[tuple[str, str]]:
    """(level, sentence) of what records can determine."""
    d = len(found.names)
    tried = f"{found.points - found.lost} random points of the bounds"
    if len(found.unseen) == d and not found.entries:
        told = f"No parameter has any effect on the fitted samples at any of {tried}, whatever value it has: with such "
        yield (
            "warning",
            f"{told}bounds nothing moves the outputs. Look at the bounds, at the inputs and their units, and at where "
            "states begin.",
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
        what = f"all {d} parameters apart" if d > 1 else "the one free parameter"
        yield "info", f"{given} records can tell {what} (rank of the sensitivities at {tried})."
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


def _of_tables(found: BeforeFit, tried: str) -> Iterator[tuple[str, str]]:
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


def _unheard(found: BeforeFit) -> Iterator[tuple[str, str]]:
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


def _advice(found: BeforeFit) -> str:
    if not found.fix:
        return ""
    if len(found.fix[0]) == 1:
        names = [f[0] for f in found.fix]
        return f"Hold or measure {'one of ' if len(names) > 1 else ''}{some(names, 6)}."
    return f"Hold or measure {len(found.fix[0])} of them, such as {' and '.join(found.fix[0])}."
