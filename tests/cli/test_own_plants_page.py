"""docs/own-plants.md: every command on it is run, and every line that is printed on it comes in its place."""

import pytest
from printed_page import commands, first_wrong, missing, parts

PARTS = parts("own-plants.md")
FAST = ("A pendubot with a link of 25 cm",)  # others search for 5 to 10 s of processor time
CHATTERS = "A pendubot with a link of 25 cm"


def test_the_page_has_the_five_plants():
    assert len(PARTS) == 5
    for part in PARTS.values():
        assert [words[0] for words, _ in commands(part)] == ["rig", "check", "run"]
        assert "--study" in commands(part)[0][0]


def test_a_line_that_is_not_printed_is_found():
    said = "k = 1.50 ± 0.02 bar\nwhite\nReport: x.html"
    assert missing(["k = 1.51 ± 0.02 bar", "...", "Report: x.html"], said) is None
    assert missing(["k = 1.70 ± 0.02 bar", "...", "Report: x.html"], said) == "k = 1.70 ± 0.02 bar"
    assert missing(["k = 1.50 ± 0.02 bar", "Report: x.html"], said) == "Report: x.html"
    assert missing(["k = 1.50 ± 0.02 bar", "..."], said) is None
    assert missing(["k = 1.50 ± 0.02 bar"], said) == "white"
    assert missing(["k = 1.60 ± 0.02 bar", "..."], said, chatter=True) is None
    assert missing(["k = 1.80 ± 0.02 bar", "..."], said, chatter=True) == "k = 1.80 ± 0.02 bar"


@pytest.mark.parametrize("title", [pytest.param(t, marks=() if t in FAST else pytest.mark.slow) for t in PARTS])
def test_its_commands_print_what_stands_there(capsys, monkeypatch, tmp_path, title):
    assert first_wrong(capsys, monkeypatch, tmp_path, PARTS[title], title == CHATTERS) is None
