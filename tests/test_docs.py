"""The docs site builds with every link checked, asks nothing of the net, and has every command, name and key."""

import ast
import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import jsonschema
import pytest

import plantfit
import plantfit.models
from plantfit.findings import findings_schema
from plantfit.models.extensions import KINDS
from plantfit.models.library.catalogue import _PLACES
from plantfit.models.text.functions import CALLS, SPECIAL
from plantfit.optimize.registry import REGISTRY
from plantfit.simulate.steps.registry import EXACT, FIXED, STEPPERS
from plantfit.spec.tables import json_schema

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    place = tmp_path_factory.mktemp("site")
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(Path(plantfit.__file__).parents[1])}
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(place)]
    done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return place


def test_pages_ask_nothing_of_the_net(site):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        assert not re.findall(
            r'<(?:script|link|img|iframe)[^>]+(?:src|href)="(?:https?:)?//[^"]+', page.read_text("utf-8")
        ), page.name


def test_printed_lines_wrap_and_lines_of_python_do_not(site):
    """site.css wraps what has the class of text; without these classes sentences were cut at the edge of the page."""
    assert ".language-text code { white-space: pre-wrap; }" in (site / "site.css").read_text("utf-8")
    assert 'class="language-text highlight"' in (site / "real-machines.html").read_text("utf-8")
    assert 'class="language-python highlight"' in (site / "notebooks" / "dc_motor.html").read_text("utf-8")


def looks_in(room: str, but: str = "") -> set[str]:
    """The kinds of looks that files of a room make: the first argument of each `Look`, or what a name is bound to
    that stands there."""
    found: set[str] = set()
    for path in (ROOT / "src" / "plantfit" / room).glob("*.py"):
        if path.name == but:
            continue
        tree = ast.parse(path.read_text("utf-8"))
        kinds = [
            n.args[0]
            for n in ast.walk(tree)
            if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id == "Look"
        ]
        names = {kind.id for kind in kinds if isinstance(kind, ast.Name)}
        pairs = [(n.targets[0], n.value) for n in ast.walk(tree) if isinstance(n, ast.Assign)]
        for to, value in pairs:
            if isinstance(to, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs += zip(to.elts, value.elts, strict=True)
            elif isinstance(to, ast.Name) and to.id in names:
                kinds.append(value)
        found |= {str(kind.value) for kind in kinds if isinstance(kind, ast.Constant)}
    return found


OF_RECORDINGS, OF_MODELS = looks_in("recording/looks", but="of_packages.py"), looks_in("trust/looks")


def test_the_table_of_looks_has_every_kind():
    rows = re.findall(
        r"^\| (?!look |-)([^|]+) \|",
        page("diagnosis.md").split("## Looks at the data")[1].split("\n## ")[0],
        re.MULTILINE,
    )
    assert {"constant", "feedback", "gaps"} <= OF_RECORDINGS
    assert {"sampled slowly", "time unit", "not at rest"} <= OF_MODELS
    told, kinds = {kind for row in rows for kind in row.split(", ")}, OF_RECORDINGS | OF_MODELS
    assert kinds - told == set(), f'add a row for {kinds - told} to the table "Looks at the data" of docs/diagnosis.md'
    assert told - kinds == set(), (
        f"no look is of the kind {told - kinds}: mend or take out its row in docs/diagnosis.md"
    )


def test_every_addition_and_look_has_a_picture(site):
    """Of looks those at a signal or the clock; others are about bounds."""
    page = (site / "what-it-looks-like.html").read_text("utf-8")
    for name in (*KINDS, *OF_RECORDINGS):
        assert f'src="pictures/{name}.svg"' in page, f"draw a picture of {name!r} in tools/pictures.py"
        picture = (site / "pictures" / f"{name}.svg").read_text("utf-8")
        assert picture.count("<polyline") >= (2 if name in KINDS else 1), name
        assert "nan" not in picture, name


def test_notebooks_are_pages_with_their_pictures(site):
    for book in (ROOT / "docs" / "notebooks").glob("*.ipynb"):
        page = (site / "notebooks" / f"{book.stem}.html").read_text("utf-8")
        shown = re.findall(rf'src="({book.stem}-[\d-]+\.png)"', page)
        assert len(shown) == book.read_text("utf-8").count('"image/png"') >= 2
        assert all((site / "notebooks" / name).read_bytes().startswith(b"\x89PNG") for name in shown)
        assert f'href="{book.name}"' in page
    assert 'href="notebooks/pendubot.html"' in (site / "overview.html").read_text("utf-8")


def test_every_command_stands_in_the_reference(site):
    help_ = subprocess.run(
        [sys.executable, "-m", "plantfit", "--help"], capture_output=True, text=True, timeout=120
    ).stdout
    known = re.findall(r"^  ([a-z][a-z-]+)  ", help_, re.MULTILINE)
    page = (site / "reference" / "commands.html").read_text("utf-8")
    assert len(known) > 20
    assert [name for name in known if f'id="plantfit-{name}"' not in page] == []
    assert "--candidates" in page


def test_python_names_have_their_docstrings(site):
    page = (site / "reference" / "python.html").read_text("utf-8")
    for words in (
        "plantfit.fitting.fit",
        "plantfit.recording.roles.guess_roles",
        "plantfit.trust.identify.before_fit.before_fit",
    ):
        assert f'id="{words}"' in page
    assert "exact sensitivities" in " ".join(re.sub(r"<[^>]+>", "", page).split())


@pytest.mark.thorough
def test_the_schema_takes_the_studies_of_the_demos_and_no_misspelt_key(site):
    """As an editor checks them."""
    schema = json.loads((site / "reference" / "study-file.schema.json").read_text("utf-8"))
    assert schema == json_schema()
    studies = sorted((ROOT / "src" / "plantfit" / "cases").rglob("*.toml"))
    assert len(studies) > 5
    for study in studies:
        text = tomllib.loads(study.read_text("utf-8"))
        if "model" not in text:
            continue
        jsonschema.validate(text, schema)
        with pytest.raises(jsonschema.ValidationError, match="splt"):
            jsonschema.validate({**text, "splt": 0.7}, schema)


def test_keys_have_types_and_defaults(site):
    page = (site / "reference" / "study-file-keys.html").read_text("utf-8")
    for key in ("recording", "parameters", "split", "bounds", "methods", "scale"):
        assert f"<code>{key}</code>" in page


def test_the_page_of_the_findings_has_every_key_and_its_meaning(site):
    schema = json.loads((site / "reference" / "findings.schema.json").read_text("utf-8"))
    assert schema == findings_schema()
    words = [sys.executable, "-m", "plantfit", "schema", "--findings"]
    assert json.loads(subprocess.run(words, capture_output=True, text=True, timeout=120, check=True).stdout) == schema
    page = (site / "reference" / "findings.html").read_text("utf-8")
    for name, record in {"Findings": schema, **schema["$defs"]}.items():
        assert f'id="{name.lower()}"' in page
        assert [key for key in record["properties"] if f"<code>{key}</code>" not in page] == []
    assert "Ends that the data do not set" in page


def page(name):
    return (ROOT / "docs" / name).read_text("utf-8")


def test_pages_name_every_function_of_equations():
    text = page("models.md")
    listed = re.findall(r"\w+", text[text.index("Functions:") : text.index("constants pi and e")])
    missing = [
        name
        for name in (*CALLS, *SPECIAL)
        if name not in listed and f"`{name}(" not in text and f" {name}(" not in text
    ]
    assert missing == [], f'name {missing} in the paragraph "Functions:" of docs/models.md'


def test_pages_name_every_method_of_search():
    """The overview says how many there are beside `auto`, and `choosing.md` has all of them."""
    (more,) = re.findall(r"`auto` \([^)]*\) and (\d+) other methods", page("overview.md"))
    missing = [name for name in REGISTRY if f"`{name}`" not in page("choosing.md")]
    assert (missing, int(more)) == ([], len(REGISTRY) - 1), (
        f"name {missing} in docs/choosing.md, and write {len(REGISTRY) - 1} other methods in docs/overview.md"
    )


def test_pages_name_every_stepper_and_every_addition():
    missing = [name for name in STEPPERS if f'"{name}"' not in page("study-file.md")]
    assert missing == [], f"name {missing} where docs/study-file.md says what `stepper` may be"
    missing = [name for name in ("auto", EXACT, *FIXED) if f'| `"{name}"` |' not in page("closed-loop.md")]
    assert missing == [], f"add a row for {missing} to the table of steppers in docs/closed-loop.md"
    missing = [kind for kind in KINDS if f"`{kind}`" not in page("diagnosis.md")]
    assert missing == [], f"add {missing} to the table of additions in docs/diagnosis.md"


def test_the_page_of_the_study_file_names_every_key():
    """But those of [control], which stand as options of `plantfit tune` on a page of their own."""
    text, schema = page("study-file.md"), json_schema()
    tables = {name: table for name, table in {"top": schema, **schema["$defs"]}.items() if name != "ControlTable"}
    assert len(tables) > 10
    keys = {(name, key) for name, table in tables.items() for key in table.get("properties", {})}
    missing = sorted(k for k in keys if not re.search(rf"[`\[{{.\s]{k[1]}[`\].\s=]", text))
    assert missing == [], f"explain these keys (table, key) in docs/study-file.md: {missing}"


def test_every_model_of_the_library_is_a_name_of_the_room():
    missing = sorted(set(_PLACES) - set(plantfit.models.__all__))
    assert missing == [], f"add {missing} to the three lists of src/plantfit/models/__init__.py"
