"""What may be added to a regression: one column more, of a signal that it reads, on one of its outputs."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from plantfit.errors import ModelError
from plantfit.models.extensions.changes import WITH
from plantfit.models.extensions.extended import pair_of
from plantfit.models.extensions.kinds import parameter_name
from plantfit.models.library.regression import LinearModel
from plantfit.models.model import Declared
from plantfit.models.remade import remade
from plantfit.models.text.suggest import suggest

OVER = " over "
SIGN = 0.1  # of the speed over which friction falls: where its sign is whole


@dataclass(frozen=True)
class Term:
    """A kind of column. `column(signal, scale)` gives it (n,) from a signal (n,); `scaled` ones are written "tau1 with
    omega1 over 0.02".

    `of` says what it takes: an output alone, a speed or position, or a coefficient that changes with a signal. `unit`
    is made of those of output and signal. `sentence` has {} for the pair.
    """

    of: Literal["output", "speed", "position", "coefficient"]
    column: Callable[[np.ndarray, float], np.ndarray]
    unit: Callable[[str, str], str]
    sentence: str
    scaled: bool = False


def _factor(unit: str) -> str:
    return unit if unit.isidentifier() or unit == "1" else f"({unit})"


def _of_output(output: str, signal: str) -> str:
    return output


TERMS: dict[str, Term] = {
    "offset": Term("output", lambda s, scale: np.ones_like(s), _of_output, "constant part of {}"),
    "viscous": Term("speed", lambda s, scale: s, lambda y, s: f"{_factor(y)}/{_factor(s)}", "part of {} in proportion"),
    "coulomb": Term("speed", lambda s, scale: np.tanh(s / scale), _of_output, "dry friction, {}", True),
    "stribeck": Term(
        "speed", lambda s, scale: np.exp(-((s / scale) ** 2)) * np.tanh(s / (SIGN * scale)), _of_output,
        "friction at low speed beyond that at speed, {}", True,
    ),
    "quadratic": Term("speed", lambda s, scale: s * np.abs(s), lambda y, s: f"{_factor(y)}/{_factor(s)}^2",
                      "drag by the square, {}"),
    "presliding": Term("position", lambda s, scale: slid(s, scale), _of_output,
                       "dry friction that holds its side at rest, {}", True),
    "change": Term("coefficient", lambda s, scale: s, lambda y, s: f"{_factor(y)}/{_factor(s)}",
                   "{}, for each unit of it"),
}  # fmt: skip


def slid(position: np.ndarray, distance: float) -> np.ndarray:
    """Dahl's state (n,) of a position (n,): ds = (dq - |dq| s)/distance, exact where the position moves in straight
    lines.

    It begins at 0. Source: `joint_friction`, equation 2.
    """
    steps, state, found = np.diff(position), 0.0, np.zeros(len(position))
    decay, side = np.exp(-np.abs(steps) / distance), np.sign(steps)
    for k in range(len(steps)):
        state = side[k] + (state - side[k]) * decay[k]
        found[k + 1] = state
    return found


@dataclass(frozen=True)
class Place:
    """Where a column stands: its `subject`, an output or coefficient, the `signal` that it is of, and its `scale`;
    as text it is the key of a study file."""

    subject: str
    signal: str = ""
    scale: float | None = None
    text: str = field(default="", compare=False)

    @classmethod
    def of(cls, text: str) -> "Place":
        """Raises ValueError where the scale is no number."""
        pair, _, scale = text.partition(OVER)
        subject, _, signal = pair.partition(WITH)
        return cls(subject, signal, float(scale) if scale else None, text)

    @property
    def pair(self) -> str:
        return f"{self.subject}{WITH}{self.signal}" if self.signal else self.subject


def term_name(kind: str, text: str) -> str:
    """The parameter of a column: that of its pair."""
    return parameter_name(kind, text.partition(OVER)[0])


def term_names(model: LinearModel, terms: Mapping[str, Iterable[str]]) -> list[str]:
    """The parameters of columns, kind -> keys, in their order; of two with one pair, or one that the model has, a
    later one ends in _2."""
    had, found = {p.name for p in model.parameters}, []
    for kind, keys in terms.items():
        for text in keys:
            name, k = term_name(kind, text), 2
            while name in had:
                name, k = f"{term_name(kind, text)}_{k}", k + 1
            had.add(name)
            found.append(name)
    return found


def unit_of_term(model: LinearModel, kind: str, place: Place) -> str | None:
    """The unit of the parameter of a column, None where one that it is made of is not known."""
    term = TERMS[kind]
    of = model.coefficients if term.of == "coefficient" else model.outputs
    own, signal = of[place.subject], model.signals.get(place.signal, "1")
    return None if own is None or signal is None else term.unit(own or "1", signal or "1")


@remade
def with_terms(model: LinearModel, given: Mapping[str, Mapping[str, tuple[float, float]]]) -> LinearModel:
    """The regression with columns more: kind -> "tau1 with omega1 over 0.02" -> bounds (low, high) of the parameter
    KIND_tau1_with_omega1.

    Of two keys with one pair the second brings KIND_tau1_with_omega1_2. Raises ModelError for a kind, pair, scale or
    bounds that cannot be.
    """
    names = iter(term_names(model, given))
    added: dict[str, tuple[Term, Place]] = {}
    more: list[Declared] = []
    for kind, own in given.items():
        if kind not in TERMS:
            raise ModelError(
                f"Model {model.name!r} is a regression: {kind!r} cannot be added to it.{suggest(kind, list(TERMS))} "
                f"It takes {', '.join(TERMS)}."
            )
        for text, bounds in own.items():
            place, pair, name = (
                _place(model, kind, text),
                pair_of(f"Model {model.name!r}: {kind} of {text!r}", bounds),
                next(names),
            )
            added[name] = TERMS[kind], place
            sentence = TERMS[kind].sentence.format(place.pair)
            more.append(Declared(name, unit_of_term(model, kind, place), pair, sentence=sentence))
    own_base = model.base

    def regressor(signals: Mapping[str, Any]) -> dict[str, np.ndarray]:
        blocks = model.blocks(signals)
        return {
            o: np.column_stack([block, *(_column(model, o, blocks, signals, *one) for one in added.values())])
            for o, block in blocks.items()
        }

    def base(p: Mapping[str, Any]) -> dict[str, Any]:
        assert own_base is not None
        return {**own_base(p), **{n: p[n] for n in added}}

    coefficients = {} if own_base is None else {**model.coefficients, **{p.name: p.unit for p in more}}
    return replace(
        model, parameters=(*model.parameters, *more), regressor=regressor, coefficients=coefficients,
        base=None if own_base is None else base,
    )  # fmt: skip


def _column(
    model: LinearModel,
    output: str,
    blocks: Mapping[str, np.ndarray],
    signals: Mapping[str, Any],
    term: Term,
    place: Place,
) -> np.ndarray:
    size = len(blocks[output])
    if term.of != "coefficient" and place.subject != output:
        return np.zeros(size)
    signal = np.asarray(signals[place.signal], dtype=float) if place.signal else np.ones(size)
    made = term.column(signal, place.scale or 1.0)
    return made * blocks[output][:, list(model.coefficients).index(place.subject)] if term.of == "coefficient" else made


def _place(model: LinearModel, kind: str, text: str) -> Place:
    term, where = TERMS[kind], f"Model {model.name!r}: {kind} is given to {text!r}"
    subjects = list(model.coefficients if term.of == "coefficient" else model.outputs)
    example = subjects[0] if term.of == "output" else f"{subjects[0]}{WITH}{next(iter(model.signals))}"
    example += f"{OVER}0.01" if term.scaled else ""
    try:
        place = Place.of(text)
    except ValueError:
        raise ModelError(f"{where}, whose scale is not a number; write it as in {example!r}.") from None
    if (
        bool(place.signal) != (term.of != "output")
        or (place.scale is not None) != term.scaled
        or (place.scale or 1.0) <= 0
    ):
        raise ModelError(f"{where}; write it as in {example!r}.")
    if place.subject not in subjects:
        what = "coefficients" if term.of == "coefficient" else "outputs"
        raise ModelError(
            f"{where}, and {place.subject!r} is none of its {what} {subjects}.{suggest(place.subject, subjects)}"
        )
    if place.signal and place.signal not in model.signals:
        raise ModelError(
            f"{where}, and it reads no {place.signal!r}.{suggest(place.signal, list(model.signals))} It reads "
            f"{list(model.signals)}."
        )
    return place
