"""The drawings by name, with the sentence in their first line."""

from dataclasses import dataclass
from importlib.resources import files


@dataclass(frozen=True)
class Drawing:
    """A plant to begin with: `parts` says whether its text is a list of parts, else it is the model of a study file."""

    name: str
    sentence: str
    text: str
    parts: bool


def drawings() -> dict[str, Drawing]:
    """All of them."""
    found = {}
    for file in sorted(files("plantfit.models.drawings").iterdir(), key=lambda f: f.name):
        name, _, kind = file.name.rpartition(".")
        if kind in ("net", "toml"):
            first, _, text = file.read_text("utf-8").partition("\n")
            found[name] = Drawing(name, first.removeprefix("# "), text, kind == "net")
    return found
