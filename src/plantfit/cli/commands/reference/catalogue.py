"""`plantfit methods` and `plantfit models`."""

from typing import Any

from plantfit.cli.terminal.out import out, print_json

NEEDS = {
    "gradient": "gradient",
    "residuals": "residuals",
    "schedule_bound": "the budget in advance",
    "raw_box": "bounds in units",
}


def methods(name: str | None, json: bool) -> None:
    """Every search method with what it needs, or one in full."""
    from plantfit.optimize import make
    from plantfit.optimize import methods as registered

    if name is not None:
        make(name)  # raises the sentence for an unknown name
    records = [m for m in registered() if name in (None, m["name"])]
    if json:
        return print_json(records)
    if name is not None:
        return _one_method(records[0])
    from rich.table import Table

    table = Table("method", "what it does", "needs", box=None, pad_edge=False)
    for m in records:
        table.add_row(f"[bold]{m['name']}[/bold]", m["sentence"], _needs(m) or "only costs")
    out.print(table, soft_wrap=False)
    out.print("\n`plantfit methods NAME` shows the paper and the settings of one.", markup=False)


def _needs(method: dict[str, Any]) -> str:
    return ", ".join(word for key, word in NEEDS.items() if method["needs"].get(key))


def _one_method(method: dict[str, Any]) -> None:
    from rich.table import Table

    out.print(f"[bold]{method['name']}[/bold]  {method['sentence']}")
    out.print(f"paper: {method['paper']}", markup=False)
    out.print(f"needs: {_needs(method) or 'only costs'}", markup=False)
    if method["needs"]["minimum_population"] > 1:
        out.print(f"smallest population: {method['needs']['minimum_population']}", markup=False)
    if not method["settings"]:
        return out.print("It has no settings.", markup=False)
    table = Table("setting", "default", "values", "what it is", box=None, pad_edge=False)
    for s in method["settings"]:
        table.add_row(f"[bold]{s['name']}[/bold]", _default(s["default"]), _values(s), s["sentence"])
    out.print()
    out.print(table, soft_wrap=False)
    out.print(f"\nIn a study file: [search.settings.{method['name']}]", markup=False)


def _default(value: Any) -> str:
    return "the method's choice" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def _values(setting: dict[str, Any]) -> str:
    if "options" in setting:
        return ", ".join(map(str, setting["options"]))
    if "range" not in setting:
        return ""
    return " to ".join(str(v) if isinstance(v, int) else f"{v:g}" for v in setting["range"])


def models(name: str | None, json: bool) -> None:
    """Every library model, or one in full."""
    import inspect

    from plantfit.models import describe
    from plantfit.models.library import catalogue as library

    names = [name] if name else list(library.names())
    records: list[dict[str, Any]] = []
    for n in names:
        function, model = library.factory(n), library.make(n)
        records.append(
            {
                "name": n,
                "sentence": model.sentence,
                "source": model.source,
                "options": [str(p) for p in inspect.signature(function).parameters.values()],
                "outputs": dict(model.outputs),
                "parameters": [
                    {"name": p.name, "unit": p.unit, "bounds": p.bounds, "sentence": p.sentence}
                    for p in model.parameters
                ],
            }
        )
    if json:
        return print_json(records)
    for r in records:
        if name:
            out.print(inspect.getdoc(library.factory(name)) or "", markup=False)
            out.print(describe(library.make(name)), markup=False)
        else:
            out.print(f"[bold]{r['name']}[/bold]  {r['sentence']}")
            if r["options"]:
                out.print(f"    options: {', '.join(r['options'])}", markup=False)
