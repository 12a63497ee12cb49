"""How an addition gets into a model: every function that reads a channel or a state reads something else in its
place."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

from plantfit.models.model import Declared, Model, Named
from plantfit.models.parts.tables import Table

Reads = Callable[[Named, Named, Named], tuple[Named, Named]]
Values = Callable[[Named, Named, Named], Named]


def rewired(model: Model, reads: Reads, *, values: Values | None = None, **changes: Any) -> Model:
    """The model whose functions see what `reads(x, u, p)` makes of states and channels, and `values(x, u, p)` of
    parameters; `changes` are other fields of it."""

    def seen(function: Any) -> Any:
        if function is None:
            return None

        def call(x: Named, u: Named, p: Named) -> Any:
            return function(*reads(x, u, p), p if values is None else values(x, u, p))

        return call

    return replace(
        model,
        derivative=changes.pop("derivative", None) or seen(model.derivative),
        output=changes.pop("output", None) or seen(model.output),
        events=tuple(replace(e, when=seen(e.when), then=seen(e.then)) for e in model.events),
        frictions=tuple(
            replace(f, sliding=seen(f.sliding), breakaway=seen(f.breakaway),
                    effect=seen(f.effect)) for f in model.frictions
        ),
        backlashes=(
            *(replace(b, drive=seen(b.drive), gap=seen(b.gap)) for b in model.backlashes),
            *changes.pop("backlashes", ()),
        ),
        **changes,
    )  # fmt: skip


def with_table(
    model: Model, table: Table, bounds: tuple[float, float], sentence: str, **changes: Callable[..., Named]
) -> Model:
    """The model with a table of parameters that its own functions do not see; of its `changes`, functions of states,
    channels and parameters, each gets what the model has there as the first argument."""
    begin, name = model.initial_state, table.name

    def others(p: Named) -> dict[str, Any]:
        return without(p, (name,))  # what the model does with its parameters is for single numbers and its own tables

    def over(own: Any, change: Callable[..., Named]) -> Callable[..., Named]:
        return lambda x, c, p: change(own(x, c, others(p)), c, p)

    return rewired(
        model,
        lambda x, c, p: (x, c),
        values=lambda x, c, p: others(p),
        initial_state=None if begin is None else lambda p, u0, y0: begin(others(p), u0, y0),
        parameters=declared(model, name, table.unit, bounds, sentence, shape=table.shape),
        tables=(*model.tables, table),
        **{field: over(getattr(model, field), change) for field, change in changes.items()},
    )


def channels_of(model: Model, name: str) -> tuple[str, ...]:
    """The input and its late copies."""
    return (name, *(d.channel for d in model.delays if d.input == name))


def first_channels(model: Model, x: Named, u0: Named) -> dict[str, Any]:
    """All channels where the states begin: late copies have the first values."""
    late = {d.channel: u0[d.input] for d in model.delays} | {d.channel: x[d.state] for d in model.state_delays}
    return {**u0, **late, "t": u0["t"]}


def declared(
    model: Model, name: str, unit: str | None, bounds: tuple[float, float] | None, sentence: str, **more: Any
) -> tuple[Declared, ...]:
    """The parameters of the model and one more."""
    return (*model.parameters, Declared(name, unit, bounds, sentence=sentence, **more))


def per(unit: str | None, text: str) -> str | None:
    """A unit divided by seconds or the like; None where it is not known."""
    return None if unit is None else f"({unit or '1'}){text}"


def without(values: Named, names: Mapping[str, Any] | tuple[str, ...]) -> dict[str, Any]:
    """Values but those of these names."""
    return {n: v for n, v in values.items() if n not in names}
