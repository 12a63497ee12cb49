"""docs/own-plants.md: every command on it is run, and every line that is printed on it comes in its place."""

import re
from pathlib import Path

import pytest
from cli_call import call

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "own-plants.md").read_text("utf-8")
PARTS = {title: text for title, text in re.findall(r"^## (.+)\n((?:(?!^## ).*\n)*)", PAGE, re.MULTILINE) if "    $ plantfit" in text}
FAST = ("A pendubot with a link of 25 cm",)  # others search for 5 to 10 s of processor time
CHATTERS = "A pendubot with a link of 25 cm"
ESTIMATE = re.compile(r"(-?[\d.]+) ± ([\d.]+)")
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def commands(part):
    """(command, lines printed below it; "..." where some are left out) of a part of the page."""
    found = []
    for line in part.splitlines():
        if line.startswith("    $ plantfit "):
            found.append((line.removeprefix("    $ plantfit ").split(), []))
        elif line.startswith("    ") and found and line.strip():
            found[-1][1].append(line.strip())
    return found


def told(line):
    """A line without its numbers and spaces, and its numbers; a p-value goes by its order of magnitude and is left out."""
    line = re.sub(r"p = [\d.e-]+", "p", line)
    words = re.sub(r"[\s()-]+|(?<=#\))e(?=#)", "", NUMBER.sub("#", line))
    return words, NUMBER.findall(line)


def alike(one, other, chatter=False):
    """Whether two lines have the same words, and numbers to 2 % or two units of the last digit, by which machines may differ.

    With `chatter` the record itself differs from machine to machine: estimates agree within four standard errors.
    """
    (words, numbers), (others, found) = told(one), told(other)
    if chatter:
        pairs = zip(re.findall(ESTIMATE, one), re.findall(ESTIMATE, other), strict=True)
        return words == others and all(abs(float(a) - float(b)) <= 4 * (float(s) + float(r)) for (a, s), (b, r) in pairs)
    return words == others and all(
        abs(float(a) - float(b)) <= max(0.02 * abs(float(a)), 2.01 * unit(a)) for a, b in zip(numbers, found, strict=True)
    )


def unit(number):
    digits, _, power = number.partition("e")
    return 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def missing(wanted, said, chatter=False):
    """The first line of `wanted` that does not come in its order in `said`; None where all do."""
    said, at, gap = [line.strip() for line in said.splitlines() if line.strip()], 0, False
    for line in wanted:
        if line == "...":
            gap = True
            continue
        last = len(said) if gap else at + 1
        place = next((k for k in range(at, min(last, len(said))) if alike(line, said[k], chatter)), None)
        if place is None:
            return line
        at, gap = place + 1, False
    return None if gap or at == len(said) else said[at]


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
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "500")
    for words, lines in commands(PARTS[title]):
        said = call(capsys, monkeypatch, *words)
        assert said.code == 0, said.err
        assert missing(lines, said.out, title == CHATTERS) is None
