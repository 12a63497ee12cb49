"""What a key of a study file takes, in words of a study file: pydantic speaks of the types of Python."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

PAIR = "two numbers in brackets, as in [0, 10]"

_KINDS = {
    "string": "text in quotation marks",
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "dict": "a table, as in { NAME = VALUE }",
    "tuple": PAIR,
}
_LIMITS = {"greater_than": ("gt", "above"), "greater_than_equal": ("ge", "of at least"), "less_than": ("lt", "below"),
           "less_than_equal": (
    "le", "of at most",
)}  # fmt: skip


def asked(errors: Sequence[Mapping[str, Any]]) -> str:
    """What to write in place of one value that was refused; `errors` are those of pydantic, one for each kind that
    the value may have."""
    own = next((str(e["ctx"]["error"]) for e in errors if e["type"] == "value_error"), None)
    return own if own is not None else f"write {' or '.join(dict.fromkeys(_wanted(e) for e in errors))}"


def _wanted(error: Mapping[str, Any]) -> str:
    kind, context, value = str(error["type"]), error.get("ctx") or {}, error.get("input")
    if kind in _LIMITS:
        key, word = _LIMITS[kind]
        limit = context[key]
        percent = limit == 1 and kind.startswith("less") and isinstance(value, int | float) and 1 < value <= 100
        return f"a number {word} {limit:g}" + (f", as {value / 100:g} for {value:g} %" if percent else "")
    if kind == "literal_error":
        expected = str(context["expected"])
        return {"True": "true", "False": "false"}.get(expected, expected)
    if kind == "list_type":
        return (
            f"a list in brackets, as in [{json.dumps(value, ensure_ascii=False)}]"
            if isinstance(value, str)
            else "a list in brackets"
        )
    if kind in ("model_type", "model_attributes_type"):
        return f"a table with a name of its own, as in [{'.'.join(map(str, error['loc'][:-1]))}.NAME]"
    if kind == "missing" or (kind in ("too_long", "too_short") and context.get("field_type") == "Tuple"):
        return PAIR
    if kind == "too_short":
        return f"a list of at least {context['min_length']}"
    if kind == "too_long":
        return f"a list of at most {context['max_length']}"
    wanted = _KINDS.get(kind.partition("_")[0])
    if wanted is None:
        return f"another value ({str(error['msg']).lower()})"
    return (
        f"{wanted} without quotation marks"
        if isinstance(value, str) and wanted.endswith(("number", "false"))
        else wanted
    )
