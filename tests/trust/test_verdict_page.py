"""docs/verdict.md has every sentence that the verdict can say; the sentences are taken from the code."""

import re
import sys
import xml.etree.ElementTree as ElementTree
from importlib import import_module
from pathlib import Path

from said_in_code import said

ROOT = Path(__file__).resolve().parents[2]
PAGE = " ".join((ROOT / "docs" / "verdict.md").read_text("utf-8").split())
PASSED_ON = {"all_sentences.py"}  # combinations and steps, whose sentences come from elsewhere as they are


def test_no_sentence_is_missing():
    calls = said()
    assert len(calls) > 40
    bare = [place for place, pieces in calls.items() if not pieces]
    assert {place.split(":")[0] for place in bare} <= PASSED_ON, (
        f"write the words of the sentence where it is said: {bare}"
    )
    missing = {
        place: pieces
        for place, pieces in calls.items()
        if pieces and max(pieces, key=len) not in PAGE and pieces[0] not in PAGE
    }
    assert missing == {}, (
        "add a row to docs/verdict.md for each sentence that is said "
        f"at {sorted(missing)} (files of src/plantfit/trust/verdict/)"
    )


def test_a_sentence_that_is_not_said_would_be_seen():
    """Every row's own words stand in the code, so that the page does not outlive a sentence."""
    code = " ".join(" ".join(p.read_text("utf-8").split()) for p in (ROOT / "src" / "plantfit" / "trust").rglob("*.py"))
    rows = re.findall(r"^\| ([^|]+) \|", (ROOT / "docs" / "verdict.md").read_text("utf-8"), re.MULTILINE)
    rows = [r for r in rows if r not in ("sentence",) and not set(r) <= set("-")]
    assert len(rows) > 30
    for row in rows:
        pieces = [p.strip(" .,:;()%=±") for p in re.split(r"\.\.\.| / ", row)]
        longest = max(pieces, key=len)
        words = longest.split()
        assert any(" ".join(words[k : k + 3]) in code for k in range(max(1, len(words) - 2))), row


def test_its_pictures_are_drawn_by_the_build():
    sys.path.insert(0, str(ROOT / "tools"))
    drawn = import_module("verdict_pictures").pictures()
    assert set(re.findall(r"verdict/(\w+)\.svg", PAGE)) == set(drawn)
    for svg in drawn.values():
        assert len(list(ElementTree.fromstring(svg))) > 5
