"""Every page that a demo writes: what was found on top, no sentence twice, small enough to be sent."""

import re
from collections import Counter
from html import unescape

import pytest
from cli_call import call

from plantfit.cases.shared.record import FOUND
from plantfit.cases.shared.registry import demos

PAPERS = ("pendubot", "motor", "robot", "steam")
LARGEST = 1_500_000  # bytes of a page
SAYS = "p|li|h1|h2|h3|figcaption|summary"
LONG = 5  # words from which it is a sentence
FIGURES_OF_A_PAIR = "A12, "  # two pairs of methods may have the same


def sentences(page):
    """Sentences in lists, paragraphs, headings and captions of figures.

    Cells of tables, the result of a test of each residual, and the places of looks come back by their nature.
    """
    page = re.sub(r"<(ul|p) class=\"(?:said|figures)\b.*?</\1>", "", page, flags=re.S)
    page = re.sub(r"<(script|style|pre)\b.*?</\1>", "", page, flags=re.S)
    parts = re.findall(rf"<(?:{SAYS})\b[^>]*>(.*?)(?=</(?:{SAYS})>|<(?:li|p)\b)", page, re.S)
    texts = (" ".join(unescape(re.sub(r"<[^>]+>", " ", part)).split()) for part in parts)
    said = (s for text in texts for s in re.split(r"(?<=[.!?])\s+(?=[A-Z0-9])", text))
    return [s for s in said if len(s.split()) >= LONG]


def twice(page):
    return [s for s, n in Counter(sentences(page)).items() if n > 1 and not s.startswith(FIGURES_OF_A_PAIR)]


def first_section(page):
    """Title and points of the first section of a page."""
    found = re.search(r"<section id=\"section-1\">\s*<h2>(.*?)</h2>(.*?)</section>", page, re.S)
    assert found
    return found[1], [
        " ".join(re.sub(r"<[^>]+>", " ", p).split()) for p in re.findall(r"<li>(.*?)</li>", found[2], re.S)
    ]


def test_a_sentence_that_stands_twice_is_seen():
    page = (
        "<h2>A title of few words</h2><ul><li>One long sentence stands here. Another.</li><li>One long sentence "
        "stands here.</li></ul>"
    )
    assert twice(page) == ["One long sentence stands here."]
    assert twice(page.replace("stands here.</li></ul>", "stands there.</li></ul>")) == []
    assert twice("<td>One long sentence stands here.</td>" * 2) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", demos())
def test_pages_of_a_demo(capsys, monkeypatch, tmp_path, name):
    monkeypatch.chdir(tmp_path)
    said = call(capsys, monkeypatch, "demo", name)
    assert said.code == 0, said.err
    pages = {p.name: p.read_text("utf-8") for p in (tmp_path / "out" / name).glob("*.html")}
    assert pages
    assert {n: twice(page) for n, page in pages.items()} == {n: [] for n in pages}
    sizes = {n: len(page.encode()) for n, page in pages.items()}
    assert all(size < LARGEST for size in sizes.values()), sizes
    if name in PAPERS:
        title, found = first_section(pages[f"{name}.html"])
        assert title == FOUND
        assert len(found) == 5
        assert all(re.search(r"\d", line) for line in found)
