"""A model with some additions."""

from collections.abc import Mapping
from typing import Any

from plantfit.errors import ModelError
from plantfit.models.extensions.changes import WITH
from plantfit.models.extensions.kinds import KINDS, Kind, parameter_name
from plantfit.models.extensions.of_packages import loaded, packages_kinds
from plantfit.models.model import Model
from plantfit.models.remade import remade
from plantfit.models.text.suggest import suggest
from plantfit.models.text.table_text import read_nodes

_MEANT = {
    "numbers": "parameters that can change",
    "parts": "pairs of an output and an input",
    "products": "outputs with two inputs",
}
FEWEST = 3  # values of a pattern that repeats


@remade
def with_extensions(model: Model, given: Mapping[str, Mapping[str, tuple[float, float] | Mapping[str, Any]]]) -> Model:
    """The model with additions: kind -> signal -> bounds (low, high) of the parameter KIND_SIGNAL, in the order of
    `KINDS`, then those of other packages. Of a curve in time it is {"bounds": (low, high), "nodes": ...} with nodes in
    s, a list or {"from", "to", "count"}, of a pattern that repeats {"bounds": (low, high), "period": s, "count": n}, of
    a step at a moment {"bounds": (low, high), "at": (low, high)} with the bounds of the moment in s.

    Parameters that come beside it, as creep_SIGNAL with dry friction, get their values from the study. Raises
    ModelError for a kind, signal or bounds that cannot be, for a dead time of an input that has one already, and for an
    addition of a package that cannot be made.
    """
    where, plugins = f"Model {model.name!r}: extensions", packages_kinds()
    for kind in given:
        if kind not in KINDS and kind not in plugins:
            known = [*KINDS, *plugins]
            raise ModelError(f"{where} name {kind!r}.{suggest(kind, known)} Known are {', '.join(known)}.")
    for kind in (k for k in (*KINDS, *plugins) if k in given):
        made = KINDS[kind] if kind in KINDS else loaded(plugins[kind])[1]
        for signal, bounds in given[kind].items():
            known = made.signals(model)
            if signal not in known:
                raise ModelError(f"{where} give {kind} to {signal!r}, {_unknown(model, made, signal, known)}")
            if kind == "dead_time" and any(d.input == signal for d in model.delays):
                raise ModelError(
                    f"{where} give {signal!r} a dead time, and it has one already; widen the bounds of that one."
                )
            what = f"{where}: {kind} of {signal!r}"
            pair, nodes = _OVER[made.over](what, bounds)
            try:
                model = made.make(model, signal, pair, parameter_name(kind, signal), *nodes)
            except Exception as failure:
                if kind in KINDS:
                    raise
                package, what = plugins[kind].package, f"{type(failure).__name__}: {str(failure)[:200]}"
                raise ModelError(
                    f"{where}: {kind!r} of the package {package} fails at "
                    f"{signal!r} ({what}); update or uninstall {package}."
                ) from failure
    return model


def _unknown(model: Model, made: Kind, signal: str, known: tuple[str, ...]) -> str:
    if made.to != "changes":
        which = _MEANT.get(made.to, made.to)
        return f"which is not one of its {which} {list(known)}."
    subjects, drivers = ({k.split(WITH)[side]: None for k in known} for side in (0, 1))
    example = known[0] if known else "K with u"
    if signal.count(WITH) != 1:
        return f"which is no pair; write a parameter or input and what it changes with, as in {example!r}."
    (subject, driver), wrong = signal.split(WITH), ""
    if subject not in subjects:
        wrong = (
            f"and {subject!r} is no parameter or input that can change.{suggest(subject, list(subjects))} There "
            f"are {list(subjects)}."
        )
    elif driver not in drivers:
        wrong = f"and {driver!r} is no input, state or t.{suggest(driver, list(drivers))} There are {list(drivers)}."
    return wrong or "which cannot change with itself."


def _over_time(what: str, given: Any) -> tuple[tuple[float, float], tuple[tuple[float, ...]]]:
    """Bounds and nodes of a curve in time."""
    if not isinstance(given, Mapping) or set(given) != {"bounds", "nodes"}:
        raise ModelError(
            f"{what} is {given!r}; it is a curve in time, so write bounds and nodes (s), "
            "as in { bounds = [-1, 1], nodes = { from = 0, to = 600, count = 20 } }."
        )
    return pair_of(f"{what}: bounds", given["bounds"], "where to look for its values"), (
        read_nodes(f"{what}: nodes", given["nodes"]),
    )


def _over_period(what: str, given: Any) -> tuple[tuple[float, float], tuple[float, int]]:
    """Bounds, period and count of a pattern that repeats."""
    if not isinstance(given, Mapping) or set(given) != {"bounds", "period", "count"}:
        raise ModelError(
            f"{what} is {given!r}; it repeats, so write bounds, the period (s) and how many values it has, "
            "as in { bounds = [-1, 1], period = 86400, count = 8 }."
        )
    period, count = given["period"], given["count"]
    if isinstance(period, bool) or not isinstance(period, int | float) or not 0 < period < float("inf"):
        raise ModelError(f"{what}: period is {period!r}; write a time in s, as in 86400 for a day.")
    if isinstance(count, bool) or not isinstance(count, int) or count < FEWEST:
        raise ModelError(f"{what}: count is {count!r}; write a whole number, at least {FEWEST}.")
    return pair_of(f"{what}: bounds", given["bounds"], "where to look for its values"), (float(period), count)


def _over_moment(what: str, given: Any) -> tuple[tuple[float, float], tuple[tuple[float, float]]]:
    """Bounds of a change and of its moment."""
    if not isinstance(given, Mapping) or set(given) != {"bounds", "at"}:
        raise ModelError(
            f"{what} is {given!r}; it is at a moment, so write bounds and between which times (s) that is, "
            "as in { bounds = [-1, 1], at = [0, 600] }."
        )
    return pair_of(f"{what}: bounds", given["bounds"], "where to look for its value"), (
        pair_of(f"{what}: at", given["at"], "where to look for its moment (s)"),
    )


def pair_of(what: str, bounds: Any, meant: str = "the bounds of its parameter") -> tuple[float, float]:
    """(low, high) as a study file or a call gives them. Raises ModelError, which says `what` they are of, for
    anything else."""
    pair = tuple(bounds) if isinstance(bounds, list | tuple) else ()
    if (
        len(pair) != 2
        or not all(isinstance(b, int | float) and not isinstance(b, bool) for b in pair)
        or not pair[0] < pair[1]
    ):
        raise ModelError(f"{what} is {bounds!r}; write {meant}, as in [0, 1].")
    return float(pair[0]), float(pair[1])


_OVER = {
    "": lambda what, bounds: (pair_of(what, bounds), ()),
    "time": _over_time,
    "period": _over_period,
    "moment": _over_moment,
}
