"""`plantfit methods` and `plantfit models`."""

from plantfit.cli.out import out, print_json


def methods(json: bool) -> None:
    """Every search method with what it needs and its settings."""
    from plantfit.optimize import methods as registered

    records = registered()
    if json:
        return print_json(records)
    for m in records:
        needs = [k.replace("_", " ") for k, v in m["needs"].items() if v and k != "minimum_population"]
        out.print(f"[bold]{m['name']}[/bold]  {m['sentence']}")
        out.print(f"    paper: {m['paper']}" + (f"; needs: {', '.join(needs)}" if needs else ""), markup=False)
        for s in m["settings"]:
            out.print("    " + "  ".join(str(v) for v in (s.values() if isinstance(s, dict) else [s])), markup=False, style="dim")


def models(name: str | None, json: bool) -> None:
    """Every library model, or one in full."""
    import inspect

    from plantfit.models import describe, library

    names = [name] if name else list(library.names())
    records = []
    for n in names:
        function, model = library.factory(n), library.make(n)
        records.append(
            {
                "name": n,
                "sentence": model.sentence,
                "source": model.source,
                "options": [str(p) for p in inspect.signature(function).parameters.values()],
                "outputs": dict(model.outputs),
                "parameters": [{"name": p.name, "unit": p.unit, "bounds": p.bounds, "sentence": p.sentence} for p in model.parameters],
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
