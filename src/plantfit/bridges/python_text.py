"""What Python targets share: names and numbers of the plant as Python text."""

from plantfit.bridges.plant import Plant


def python_values(plant: Plant) -> dict[str, str]:
    """The entries of a template by name."""
    return {
        "told": docstring("\n".join(plant.story)), "parameters": repr({n: float(v) for n, v in plant.p.items()}),
        "states": repr(list(plant.vector.states)),
        "inputs": repr(list(plant.model.inputs)), "outputs": repr(list(plant.vector.outputs)), "hold": repr(plant.hold),
        "x0": repr(plant.x0),
        "before": repr(plant.before), "delayed": repr([(d.input, d.parameter) for d in plant.model.delays]),
    }  # fmt: skip


def docstring(text: str) -> str:
    """A text as it stands between triple quotes."""
    return text.replace("\\", "\\\\").replace('"', '\\"')
