"""The house is as docs/architecture.md says: its sub-rooms, and the files that pages and docstrings name."""

import ast
import importlib
import pkgutil
import re
from pathlib import Path
from types import ModuleType

import pytest

import plantfit

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src" / "plantfit"
MOST = 15
ROOMS = sorted(p.name for p in SOURCE.iterdir() if (p / "__init__.py").exists())
NAMED = re.compile(rf"(?<![\w./])((?:{'|'.join(ROOMS)})(?:/[a-z_0-9]+)*/(?:[a-z_0-9]+\.py\b)?)")


def folders() -> list[Path]:
    found = [p for p in sorted(SOURCE.rglob("*")) if p.is_dir() and p.name != "__pycache__"]
    return [p for p in found if any(e.name != "__pycache__" for e in p.iterdir())]  # not what a moved folder left behind


@pytest.mark.parametrize("folder", folders(), ids=lambda p: str(p.relative_to(SOURCE)))
def test_no_folder_has_more_entries_than_one_can_survey(folder):
    entries = [p.name for p in folder.iterdir() if p.name != "__pycache__"]
    assert len(entries) <= MOST, f"{len(entries)} entries; make a sub-room, and name it in docs/architecture.md"


def test_every_package_says_what_it_holds():
    for init in SOURCE.rglob("__init__.py"):
        assert ast.get_docstring(ast.parse(init.read_text("utf-8"))), f"{init.relative_to(SOURCE)} has no docstring"


def test_files_that_pages_and_docstrings_name_exist():
    pages = [*(ROOT / "docs").glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md", *SOURCE.rglob("*.py")]
    wrong = [
        f"{page.relative_to(ROOT)}: {name}"
        for page in pages
        for name in NAMED.findall(page.read_text("utf-8"))
        if not (SOURCE / name).exists() and not (ROOT / "tests" / name).exists()
    ]
    assert not wrong, "\n".join(wrong)


def test_every_sub_room_stands_on_the_page():
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    table = page[page.index("## Sub-rooms") : page.index("## Where do I put")]
    missing = [
        f"{p.parent.name}/{p.name}"
        for p in folders()
        if p.parent.parent == SOURCE and p.parent.name not in ("cases", "rig") and f"`{p.name}/`" not in table
    ]
    assert not missing, missing


def test_no_function_hides_a_sub_room():
    hidden = []
    for found in pkgutil.walk_packages(plantfit.__path__, "plantfit."):
        if found.ispkg:
            importlib.import_module(found.name)
            room, _, name = found.name.rpartition(".")
            if not isinstance(getattr(importlib.import_module(room), name), ModuleType):
                hidden.append(found.name)
    assert hidden == []
