"""The notebooks of the four papers: whole as they stand, and run anew (slow) they say what they keep."""

import ast
import importlib
import json
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
BOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
# a pendubot's loop plays by encoder steps as the last digits of a machine fall
EXACT = ("dc_motor", "robot_motor", "steam_chamber")
ROUNDING = 1e-11  # per cent of a cost, and nothing that a notebook measures in its unit is as small


def cells(path):
    return [c for c in json.loads(path.read_text("utf-8"))["cells"] if c["cell_type"] == "code"]


def said(cell):
    return "".join("".join(o["text"]) for o in cell["outputs"] if o["output_type"] == "stream")


def drawn(cell):
    return sum("image/png" in o.get("data", {}) for o in cell["outputs"])


def unit(number):
    """Of its last digit."""
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def test_there_is_one_for_each_paper():
    assert [p.stem for p in BOOKS] == ["dc_motor", "pendubot", "robot_motor", "steam_chamber"]


@pytest.mark.parametrize("path", BOOKS, ids=lambda p: p.stem)
def test_a_notebook_is_whole_as_it_stands(path):
    """Run from its first to its last line, with figures, and by public names only."""
    code = cells(path)
    assert [c["execution_count"] for c in code] == list(range(1, len(code) + 1))
    assert not any(o["output_type"] == "error" for c in code for o in c["outputs"])
    assert sum(map(drawn, code)) >= 2
    assert path.stat().st_size < 400_000
    tree = ast.parse("\n".join("".join(c["source"]) for c in code))
    used = {
        n.attr
        for n in ast.walk(tree)
        if isinstance(n, ast.Attribute) and isinstance(n.value, ast.Name) and n.value.id == "pf"
    }
    assert used
    assert used <= set(importlib.import_module("plantfit").__all__)
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and str(node.module).startswith("plantfit"):
            module = importlib.import_module(str(node.module))
            assert all(not a.name.startswith("_") and hasattr(module, a.name) for a in node.names)


@pytest.mark.slow  # 10 to 60 s of processor time each
@pytest.mark.parametrize("path", BOOKS, ids=lambda p: p.stem)
def test_run_anew_it_says_what_it_keeps(path, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    book = importlib.import_module("notebooks").executed(path)
    new = [c for c in book.cells if c.cell_type == "code"]
    for before, now in zip(cells(path), new, strict=True):
        assert drawn(now) == drawn(before)
        kept, told = said(before), said(now)
        assert NUMBER.sub("#", told) == NUMBER.sub("#", kept)
        if path.stem in EXACT:
            for a, b in zip(NUMBER.findall(kept), NUMBER.findall(told), strict=True):
                assert abs(float(a) - float(b)) <= max(0.05 * abs(float(a)), 2.01 * unit(a), ROUNDING), (a, b)
    sys.modules.pop("notebooks", None)
