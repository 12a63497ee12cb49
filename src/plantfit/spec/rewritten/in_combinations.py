"""A study file written anew: its parameters are the combinations that the data determine.

Of each group of combinations that share parameters, as many parameters are replaced as there are combinations:
equations get a line that computes the replaced one from the combination and from the others, which are held at the
answer's values. Any other value of these would do: the combinations say what the data know.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations as choices
from itertools import islice
from typing import Any

import numpy as np
import tomlkit
from tomlkit.items import Table

import plantfit.runtime  # noqa: F401
from plantfit import units
from plantfit.errors import SpecError, UnitError
from plantfit.spec.reading import parse
from plantfit.spec.rewritten.document import text_of
from plantfit.spec.study import Study

PIVOTS = 3000  # choices of replaced parameters that are looked at
WIDE = 10.0  # times the answer's value, where the bounds of the parameters say nothing about a combination
DECADES = 2.0  # of positive bounds from which on the search is even over decades
KEPT = ("sentence", "per_recording")  # keys of a parameter that stay when it is held


@dataclass(frozen=True)
class Rewritten:
    """`text` of the new study file; `made` maps each new parameter to its formula, `held` each held one to its value.

    `left` are parameters of combinations that could not be written in, with the reason.
    """

    text: str
    made: Mapping[str, str]
    held: Mapping[str, float]
    left: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class _Group:
    """Combinations that share parameters `names`; `weights` (combinations, names): powers of a product, or factors
    of a sum."""

    names: tuple[str, ...]
    weights: np.ndarray
    product: bool | None  # None: both kinds
    found: tuple[Mapping[str, Any], ...]


def in_combinations(study: Study, findings: Mapping[str, Any]) -> Rewritten:
    """The study file whose parameters are the combinations of `findings["determined"]`, the others held at the answer's
    values.

    Library models have no equations to write in: of each group as many parameters stay free as there are combinations,
    the others are held. So it is done where a group has products and sums, products of negative numbers, or sums of
    different units. A parameter that stands in no combination stays as it is. Raises SpecError when there is nothing to
    change.
    """
    rows = {p["name"]: p for p in findings["parameters"]}
    found = (findings.get("determined") or {}).get("combinations", ())
    if not found:
        raise SpecError(
            f"{study.name}: all that the data determine are parameters "
            "by themselves, no combinations; nothing has to be changed."
        )
    document = tomlkit.parse(study.text.removeprefix("\ufeff"))
    made: dict[str, str] = {}
    held: dict[str, float] = {}
    left: dict[str, str] = {}
    for group in _groups(found):
        if reason := _refused(study, rows, group):
            left.update(dict.fromkeys(group.names, reason))
            continue
        unit = _units_of(group, rows) if study.table.model.equations is not None else None
        pivots = _pivots(group, rows, unit is not None)
        if unit is not None:
            made.update(_replaced(document, study, group, pivots, unit))
        held.update({n: _hold(document, rows[n]) for n in group.names if n not in pivots})
    if not held:
        raise SpecError(
            f"{study.name}: no combination can be written, because {'; '.join(dict.fromkeys(left.values()))}."
        )
    text = text_of(document)
    try:
        parse(text, study.path)
    except SpecError as error:
        raise SpecError(
            f"{study.name} cannot be written in combinations: {error} Write them into the equations by hand."
        ) from None
    return Rewritten(text, made, held, left)


def _groups(found: Sequence[Mapping[str, Any]]) -> Iterator[_Group]:
    rest = list(found)
    while rest:
        own = [rest.pop(0)]
        names = set(own[0]["weights"])
        while more := [c for c in rest if names & set(c["weights"])]:
            own += more
            rest = [c for c in rest if c not in more]
            names.update(*(c["weights"] for c in more))
        ordered = tuple(dict.fromkeys(n for c in own for n in c["weights"]))
        weights = np.array([[c["weights"].get(n, 0.0) for n in ordered] for c in own])
        kinds = {bool(c["product"]) for c in own}
        yield _Group(ordered, weights, kinds.pop() if len(kinds) == 1 else None, tuple(own))


def _refused(study: Study, rows: Mapping[str, Any], group: _Group) -> str:
    """Why the parameters of a group cannot be replaced; empty when they can."""
    known = study.problem.space.parameters
    for name in group.names:
        if name not in known or known[name].shape or known[name].per_recording or name not in rows:
            return f"{name} is not one number for all recordings"
        if any(p.tied == name for p in known.values()):
            return f"another parameter is tied to {name}"
    return ""


def _pivots(group: _Group, rows: Mapping[str, Any], written: bool) -> tuple[str, ...]:
    """The parameters that are replaced or stay free, as many as combinations.

    Those that the combinations tell most of; where formulas are `written`, rather those that have whole numbers in
    them.
    """
    count = len(group.found)
    size = np.array([max(abs(rows[n]["value"]), 1e-300) for n in group.names])
    scaled = (
        group.weights
        if group.product
        else group.weights * size / np.max(np.abs(group.weights) * size, axis=1, keepdims=True)
    )

    def rank(places: tuple[int, ...]) -> tuple[bool, bool, float]:
        block = group.weights[:, places]
        own = abs(float(np.linalg.det(scaled[:, places])))
        if own < 1e-9:
            return False, False, 0.0
        inverse = np.linalg.inv(block) @ group.weights
        return True, written and bool(np.allclose(inverse, np.round(inverse), atol=1e-9)), own

    best = max(islice(choices(range(len(group.names)), count), PIVOTS), key=rank)
    if not rank(best)[0]:
        raise SpecError(
            f"The combinations of {', '.join(group.names)} depend on each other; write them into the equations by hand."
        )
    return tuple(group.names[k] for k in best)


def _units_of(group: _Group, rows: Mapping[str, Any]) -> list[str | None] | None:
    """The unit of every combination, None for one of parameters without a declared unit; None where equations cannot
    hold them: both kinds, a sign that powers lose, factors with units."""
    if group.product is None or (group.product and any(rows[n]["value"] <= 0 for n in group.names)):
        return None
    own = [units.parse(units.difference_of(rows[n]["unit"] or "") or "") for n in group.names]
    if not group.product:
        return [rows[group.names[0]]["unit"]] * len(group.found) if len(set(own)) == 1 else None
    found: list[str | None] = []
    for row in group.weights:
        if not all(rows[n]["unit"] for n, power in zip(group.names, row, strict=True) if power):
            found.append(None)  # a unit that nobody wrote may be any in the equations, and is no 1
            continue
        unit = units.parse("")
        for base, power in zip(own, row, strict=True):
            unit = unit * base ** float(power) if power else unit
        found.append(_spelled(unit))
    return found


def _spelled(unit: Any) -> str:
    text = f"{unit:~C}".replace("Ω", "ohm") or "1"
    try:
        units.parse(text)
    except UnitError:
        return f"{unit:C}"
    return text


def _replaced(
    document: Any, study: Study, group: _Group, pivots: Sequence[str], unit: Sequence[str | None]
) -> dict[str, str]:
    """Write a group in; the new parameters with their formulas."""
    taken = set(study.problem.space.parameters) | set(re.findall(r"[A-Za-z_]\w*", study.table.model.equations or ""))
    made: dict[str, str] = {}
    for c in group.found:
        made[_name(c, taken | set(made))] = c["formula"]
    places = [group.names.index(p) for p in pivots]
    inverse = np.linalg.inv(group.weights[:, places])
    rest = inverse @ group.weights
    formulas = {}
    for k, pivot in enumerate(pivots):
        terms = [(new, float(w)) for new, w in zip(made, inverse[k], strict=True)]
        terms += [(n, -float(w)) for j, (n, w) in enumerate(zip(group.names, rest[k], strict=True)) if j not in places]
        terms = [(n, round(w, 12)) for n, w in terms if abs(w) > 1e-12]
        formulas[pivot] = _product_text(terms) if group.product else _sum_text(terms)
    _insert(document, study, group, made, formulas, unit)
    return made


def _insert(
    document: Any,
    study: Study,
    group: _Group,
    made: Mapping[str, str],
    formulas: Mapping[str, str],
    unit: Sequence[str | None],
) -> None:
    lines = "".join(f"{name} = {formula}\n" for name, formula in formulas.items())
    model = document["model"]
    model["equations"] = tomlkit.string(lines + str(model["equations"]).lstrip("\n"), multiline=True)
    _in_initial_values(model, formulas)
    parameters = document["parameters"]
    for name in formulas:
        parameters.pop(name)
    for (name, formula), c, own in zip(made.items(), group.found, unit, strict=True):
        low, high = _bounds(study, c)
        table = tomlkit.table()
        table["sentence"] = formula
        if own:
            table["unit"] = own
        table["bounds"] = [float(f"{low:.6g}"), float(f"{high:.6g}")]
        if low > 0 and np.log10(high / low) > DECADES:
            table["scale"] = "log"
        table["start"] = float(f"{c['value']:.6g}")
        parameters[name] = table


def _in_initial_values(model: Any, formulas: Mapping[str, str]) -> None:
    """Initial values know parameters, not lines of the equations: formulas are written in."""
    for state in model.get("states", {}).values() if isinstance(model.get("states"), Mapping) else ():
        if isinstance(state, Mapping) and isinstance(state.get("initial"), str):
            text = str(state["initial"])
            for name, formula in formulas.items():
                text = re.sub(rf"\b{re.escape(name)}\b", f"({formula})", text)
            if text != state["initial"]:
                state["initial"] = text  # pyrefly: ignore[unsupported-operation]


def _bounds(study: Study, c: Mapping[str, Any]) -> tuple[float, float]:
    """Where to look for a combination: what the bounds of its parameters allow, and the interval that is known."""
    known, value = study.problem.space.parameters, float(c["value"])
    corners = []
    for name, weight in c["weights"].items():
        ends = known[name].bounds
        own = np.array([float(np.min(ends[0])), float(np.max(ends[1]))]) if ends else np.array([np.nan, np.nan])
        if c["product"]:
            own = np.sort(own**weight) if own[0] > 0 else np.array([np.nan, np.nan])
        corners.append(np.sort(weight * own) if not c["product"] else own)
    ends = np.prod(corners, axis=0) if c["product"] else np.sum(corners, axis=0)
    low, high = (float(e) for e in ends)
    if not np.isfinite(low) or not np.isfinite(high) or high <= low:
        low, high = (
            sorted((value / WIDE, value * WIDE))
            if c["product"]
            else (value - WIDE * abs(value), value + WIDE * abs(value))
        )
    return min(low, float(c["low"])), max(high, float(c["high"]))


def _hold(document: Any, row: Mapping[str, Any]) -> float:
    """Write the parameter of a row of the findings as held at its value."""
    parameters = document.setdefault("parameters", tomlkit.table())
    old = parameters.get(row["name"], {})
    table: Table = tomlkit.table()
    for key in KEPT:
        if key in old:
            table[key] = old[key]
    if row["unit"]:
        table["unit"] = row["unit"]
    value = float(f"{row['value']:.6g}")
    table["value"] = value
    table["value"].comment("held: the data know it in combination only")
    parameters[row["name"]] = table
    return value


def _name(c: Mapping[str, Any], taken: set[str]) -> str:
    """A name for a combination that says what it is made of."""
    parts = []
    for name, weight in c["weights"].items():
        power = f"{abs(weight):g}".replace(".", "p") if c["product"] and abs(weight) != 1.0 else ""
        joint = ("_per_" if weight < 0 else "_") if c["product"] else ("_less_" if weight < 0 else "_and_")
        parts.append((joint if parts or (c["product"] and weight < 0) else "") + name + power)
    name = "".join(parts).lstrip("_")
    while name in taken:
        name += "_"
    return name


def _product_text(terms: Sequence[tuple[str, float]]) -> str:
    up = "*".join(_powered(n, w) for n, w in terms if w > 0) or "1"
    down = [_powered(n, -w) for n, w in terms if w < 0]
    return up + (f"/({'*'.join(down)})" if len(down) > 1 else f"/{down[0]}" if down else "")


def _powered(name: str, power: float) -> str:
    return name if power == 1.0 else f"{name}^{power:g}" if power == int(power) else f"{name}^({power:.12g})"


def _sum_text(terms: Sequence[tuple[str, float]]) -> str:
    text = " ".join(f"{'-' if w < 0 else '+'} {'' if abs(w) == 1.0 else f'{abs(w):.12g}*'}{n}" for n, w in terms)
    return text[2:] if text.startswith("+") else f"-{text[2:]}"


__all__ = ["Rewritten", "in_combinations"]
