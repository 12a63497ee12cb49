"""What generated Python files share: what they declare of the plant, what `simulate` is given, and where an input
has an edge."""

from plantfit.bridges.plant import Plant

_DECLARED = """PARAMETERS = {parameters}
STATES = {states}
INPUTS = {inputs}
OUTPUTS = {outputs}
HOLD = {hold}
X0 = {x0}  # as the recording began
BEFORE = {before}  # inputs before the first sample
DELAYED = {delayed}  # (input, parameter) of every delayed copy"""

_GIVEN = """    named = dict(PARAMETERS, **(parameters or {}))
    p, start, past = list(named.values()), dict(X0, **(x0 or {})), dict(BEFORE, **(before or {}))
    t = np.asarray(t, dtype=float)
"""

_EDGES = """    edges = np.unique(np.concatenate([t] + [t + d for _, d in late]))
    edges = edges[(edges >= t[0]) & (edges <= t[-1])]
"""


def shared(plant: Plant) -> dict[str, str]:
    """Parts of a template by name: `told`, `declared`, `given`, `edges`."""
    declared = _DECLARED.format(
        parameters={n: float(v) for n, v in plant.p.items()}, states=list(plant.vector.states),
        inputs=list(plant.model.inputs),
        outputs=list(plant.vector.outputs), hold=plant.hold, x0=plant.x0, before=plant.before,
        delayed=[(d.input, d.parameter) for d in plant.model.delays],
    )  # fmt: skip
    return {"told": docstring("\n".join(plant.story)), "declared": declared, "given": _GIVEN, "edges": _EDGES}


def docstring(text: str) -> str:
    """A text as it stands between triple quotes."""
    return text.replace("\\", "\\\\").replace('"', '\\"')
