"""The figures of one page, and how they are put into it."""

import json
from dataclasses import dataclass, field
from typing import Any

from markupsafe import Markup

from plantfit.report.figures.style import Figure

_CODES = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


@dataclass
class Drawings:
    """Figures of one report in the order of the page."""

    items: list[dict[str, Any]] = field(default_factory=list)

    def add(self, figure: Figure, label: str) -> dict[str, Any]:
        """Keep a figure and return what the template needs to place it."""
        item = {
            "id": f"figure-{len(self.items) + 1}",
            "label": label,
            "figure": figure,
            "height": figure["layout"]["height"],
        }
        self.items.append(item)
        return item

    @property
    def json(self) -> Markup:
        """All figures as JSON that is safe inside a script element."""
        return embedded({item["id"]: item["figure"] for item in self.items})


def embedded(value: Any) -> Markup:
    """JSON for a script element; no character in it can end the element."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return Markup(text.translate(str.maketrans(_CODES)))
