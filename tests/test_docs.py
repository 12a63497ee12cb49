"""The docs site builds with every link checked, asks nothing of the net, and has every command, name and key."""

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
        assert not re.findall(r'<(?:script|link|img|iframe)[^>]+(?:src|href)="(?:https?:)?//[^"]+', page.read_text("utf-8")), page.name


def test_every_command_stands_in_the_reference(site):
    help_ = subprocess.run([sys.executable, "-m", "plantfit", "--help"], capture_output=True, text=True, timeout=120).stdout
    known = re.findall(r"^  ([a-z][a-z-]+)  ", help_, re.MULTILINE)
    page = (site / "reference" / "commands.html").read_text("utf-8")
    assert len(known) > 20
    assert [name for name in known if f'id="plantfit-{name}"' not in page] == []
    assert "--candidates" in page


def test_python_names_have_their_docstrings(site):
    page = (site / "reference" / "python.html").read_text("utf-8")
    for words in ("plantfit.fitting.fit", "plantfit.recording.roles.guess_roles", "plantfit.trust.identify.before_fit.before_fit"):
        assert f'id="{words}"' in page
    assert "exact sensitivities" in " ".join(re.sub(r"<[^>]+>", "", page).split())


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
