"""Pages of the docs site that the build makes: the start from README.md, commands, Python names, keys of the study file, changes, and what
faults look like.

A hook of MkDocs (mkdocs.yml).
"""

import importlib
import inspect
import json
import re
import sys
from base64 import b64decode
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "tools")]
from notebooks import notebooks
from pictures import pictures
from verdict_pictures import pictures as verdict_pictures

from plantfit.findings import findings_schema
from plantfit.findings.results.all_results import RESULTS, result_schema
from plantfit.spec.tables import json_schema


def on_files(files: Files, config: Any) -> Files:
    """Add the pages that are made."""
    pages = {
        "index.md": start_page(),
        "reference/commands.md": commands_page(),
        "reference/python.md": python_page(),
        "reference/study-file-keys.md": keys_page(),
        "reference/findings.md": findings_page(),
        "reference/results.md": results_page(),
        "reference/changes.md": relinked((ROOT / "CHANGELOG.md").read_text("utf-8"), "../"),
        "reference/study-file.schema.json": json.dumps(json_schema(), indent=1),
        "reference/findings.schema.json": json.dumps(findings_schema(), indent=1),
    }
    drawn = pictures()
    pages |= {f"pictures/{name}.svg": svg for name, (_, _, svg) in drawn.items()}
    pages |= {f"verdict/{name}.svg": svg for name, svg in verdict_pictures().items()}
    pages["what-it-looks-like.md"] = pictures_page(drawn)
    for book in notebooks():
        pages |= notebook_page(book)
    for place, text in pages.items():
        files.append(File.generated(config, place, content=text))
    return files


def notebook_page(path: Path) -> dict[str, str | bytes]:
    """A notebook as a page with the outputs that it keeps, and its pictures, by their places on the site."""
    made: dict[str, str | bytes] = {}
    text = []
    for k, cell in enumerate(json.loads(path.read_text("utf-8"))["cells"]):
        source = "".join(cell["source"])
        text.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for j, output in enumerate(cell.get("outputs", [])):
            data = output.get("data", {})
            if "image/png" in data:
                name = f"{path.stem}-{k}-{j}.png"
                made[f"notebooks/{name}"] = b64decode(data["image/png"])
                text.append(f"![Drawn by the lines above]({name})")
            else:
                said = "".join(output.get("text") or data.get("text/plain", ""))
                text.append(f"```text\n{said.rstrip()}\n```")
    link = f"[This page as a notebook]({path.name}) for Jupyter; `pip install 'plantfit[notebooks]'` has what it needs."
    head, _, rest = "\n\n".join(text).partition("\n")
    return {f"notebooks/{path.stem}.md": f"{head}\n\n{link}\n{rest}\n", **made}


def start_page() -> str:
    """README.md, with its links as the site has them."""
    return relinked((ROOT / "README.md").read_text("utf-8"), "")


def relinked(text: str, up: str) -> str:
    """Links to docs/ as links between pages; to files that are not on the site as their names alone."""
    text = re.sub(r"\]\(docs/([^)]+)\)", rf"]({up}\1)", text)
    text = re.sub(r"\]\(CHANGELOG\.md\)", f"]({up}reference/changes.md)", text)
    return re.sub(r"\[([^\]]+)\]\((?:[A-Z][\w.]*(?:\.md)?|firmware/[^)]*)\)", r"\1", text)


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Links out of docs/ lead to the repository, which the site does not have; those to notebooks lead to their pages."""
    markdown = re.sub(r"\]\(notebooks/(\w+)\.ipynb\)", r"](notebooks/\1.md)", markdown)
    return re.sub(r"\[([^\]]+)\]\(\.\./(?!reference/|[\w-]+\.(?:md|png))[^)]*\)", r"\1", markdown)


def pictures_page(drawn: Mapping[str, tuple[str, str, str]]) -> str:
    """Every candidate of a diagnosis and every look at a signal or clock, with its picture."""
    from plantfit.models.extensions import KINDS

    text = "# What it looks like\n\nWhat [diagnosis](diagnosis.md) tries and looks for. Made from the laws and looks themselves.\n"
    clock = "Blue: the place; dots: the samples. Of the clock its steps are drawn, in s."
    for title, hint, added in (("Additions to a model", "Grey: without it; amber: with it.", True), ("Looks at the data", clock, False)):
        text += f"\n## {title}\n\n{hint}\n"
        for name in (n for n in drawn if (n in KINDS) is added):
            heading, sentence, _ = drawn[name]
            text += f"\n### {heading[0].upper()}{heading[1:]}\n\n`{name}`: {sentence}\n\n![{heading}](pictures/{name}.svg)\n"
    return text


def commands_page() -> str:
    """Every command with its arguments and options, from the program itself."""
    from plantfit.cli.main import app

    group: Any = typer.main.get_command(app)  # typer brings a click of its own
    text = "# Commands\n\nAs `plantfit COMMAND --help` says it. Made from the program.\n"
    for name, command in sorted(group.commands.items()):
        if not command.hidden:
            text += f"\n## plantfit {name}\n\n{_escaped(command.help or '')}\n\n{_options(command)}"
    return text


def _options(command: Any) -> str:
    rows = []
    for parameter in command.params:
        told = getattr(parameter, "help", None) or ""
        if getattr(parameter, "hidden", False):
            continue
        names = f"`{parameter.name}`" if parameter.param_type_name == "argument" else _names(parameter)
        rows.append(f"| {_cell(names)} | {_cell(_escaped(told))} |")
    return "| | |\n|---|---|\n" + "\n".join(rows) + "\n" if rows else ""


def _names(parameter: Any) -> str:
    return ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("[", "\\[")


def python_page() -> str:
    """The public names, with their docstrings by mkdocstrings."""
    text = "# Python\n\nThe names of `import plantfit as pf`, then those of its rooms.\n"
    for room in (
        "plantfit",
        "plantfit.recording",
        "plantfit.models",
        "plantfit.findings",
        "plantfit.trust",
        "plantfit.control",
        "plantfit.estimate",
        "plantfit.study",
    ):
        module = importlib.import_module(room)
        text += f"\n## plantfit{room}\n"
        for place in _places(module):
            text += f"\n::: {place}\n"
    return text


def _places(module: Any) -> Iterator[str]:
    """Where the functions and classes of a room's `__all__` are defined."""
    for name in sorted(getattr(module, "__all__", ()), key=str.lower):
        found = getattr(module, name)
        home = getattr(found, "__module__", "")
        if (
            (inspect.isclass(found) or inspect.isfunction(found))
            and home.startswith("plantfit")
            and getattr(found, "__qualname__", "") == name
        ):
            yield f"{home}.{name}"


def keys_page() -> str:
    """Keys, types and defaults of the study file, from its schema."""
    found = json_schema()
    text = (
        "# Keys of the study file\n\nTypes and defaults as the reader checks them; what each means: [the study file](../study-file.md).\n"
        "Editors take the [JSON schema](study-file.schema.json), which `plantfit schema` prints too: with Taplo or Even Better TOML a\n"
        "first line `#:schema ./study-file.schema.json` completes and checks keys while you write.\n"
    )
    tables = {"study file": found, **found["$defs"]}
    for name, table in tables.items():
        rows = [f"| `{key}` | {_cell(_kind(value))} | {_default(value)} |" for key, value in table.get("properties", {}).items()]
        if rows:
            title = name.removesuffix("Table")
            text += f"\n## {title}\n\n| key | type | default |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    return text


def findings_page() -> str:
    """Keys, types and meanings of the findings, from their records."""
    found = findings_schema()
    text = (
        "# The findings\n\n`answer.findings` and `plantfit run --json` give one record of JSON types: what a fit found and what it is\n"
        "worth. `--json` leaves the samples out (`t`, `inputs` and `outputs` of recordings, `residuals` of the diagnosis) and adds\n"
        "`report`, where the page is. None stands for what is not known and for what is not finite.\n"
        "`plantfit.findings.read_findings(record)` checks a record and gives it with attributes. There is a\n"
        "[JSON schema](findings.schema.json), which `plantfit schema --findings` prints too.\n"
    )
    return text + "".join(_record_table(name, record) for name, record in {"Findings": found, **found["$defs"]}.items())


def results_page() -> str:
    """Keys, types and meanings of what other commands print, from their records."""
    rows, tables = "", {}
    for command, record in RESULTS.items():
        schema = result_schema(command)
        of_models = " (of models)" if command == "compare" else ""
        rows += f"| `plantfit {command} --json`{of_models} | [{record.__name__}](#{record.__name__.lower()}) |\n"
        tables |= {record.__name__: schema, **schema["$defs"]}
    text = (
        "# The results of other commands\n\nWhat commands beside `run` print with `--json`, and what `record` of their results holds in\n"
        "Python; `typed` is the same with attributes. None stands for what is not known and for what is not finite. `plantfit schema --of\n"
        f"COMMAND` prints the JSON schema of one. Those of a fit are\n[the findings](findings.md).\n\n"
        f"| command | record |\n|---|---|\n{rows}"
    )
    return text + "".join(_record_table(name, tables[name]) for name in tables)


def _record_table(name: str, record: dict[str, Any]) -> str:
    """A section on one record."""
    rows = [
        f"| `{key}` | {_cell(_kind(value, ''))} | {_cell(_escaped(value.get('description', '')))} |"
        for key, value in record.get("properties", {}).items()
    ]
    head = f"\n## {name}\n\n{_escaped(record.get('description', ''))}\n\n| key | type | meaning |\n|---|---|---|\n"
    return head + "\n".join(rows) + "\n"


WORDS = {"number": "number", "integer": "whole number", "string": "text", "boolean": "true or false", "null": "none"}


def _kind(value: dict[str, Any], suffix: str = "Table") -> str:
    """A type in words; `suffix` is left out of the names of tables."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2].removesuffix(suffix)
        return f"[{name}](#{name.lower()})"
    if "anyOf" in value:
        return " or ".join(dict.fromkeys(_kind(v, suffix) for v in value["anyOf"]))
    if "enum" in value or "const" in value:
        return ", ".join(f"`{v}`" for v in value.get("enum", [value.get("const")]))
    if value.get("type") == "array":
        return f"list of {_kind(value.get('items', {}), suffix)}" if value.get("items") else "list"
    if value.get("type") == "object":
        inner = value.get("additionalProperties")
        return f"table of {_kind(inner, suffix)}" if isinstance(inner, dict) else "table"
    return WORDS.get(value.get("type", ""), "any")


def _default(value: dict[str, Any]) -> str:
    if "$ref" in value or "default" not in value or value["default"] is None or value["default"] in ({}, []):
        return ""
    return f"`{json.dumps(value['default'])}`"
