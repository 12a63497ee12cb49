"""Pages of docs/ with commands and what they print: each command is run, and each printed line comes in its place."""

import re
from pathlib import Path

from cli_call import call

DOCS = Path(__file__).resolve().parents[2] / "docs"
ESTIMATE = re.compile(r"(-?[\d.]+) ± ([\d.]+)")
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def parts(page):
    """Text by title, of the sections of a page that have commands."""
    text = (DOCS / page).read_text("utf-8")
    return {
        title: part
        for title, part in re.findall(r"^## (.+)\n((?:(?!^## ).*\n)*)", text, re.MULTILINE)
        if "    $ plantfit" in part
    }


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
    """A line without its numbers and spaces, and its numbers; a p-value goes by its order of magnitude and is left
    out."""
    line = re.sub(r"p = [\d.e-]+", "p", line)
    words = re.sub(r"[\s()-]+|(?<=#\))e(?=#)", "", NUMBER.sub("#", line))
    return words, NUMBER.findall(line)


def alike(one, other, chatter=False):
    """Whether two lines have the same words, and numbers to 2 % or two units of the last digit, by which machines may
    differ.

    With `chatter` the record itself differs from machine to machine: estimates agree within four standard errors.
    """
    (words, numbers), (others, found) = told(one), told(other)
    if chatter:
        pairs = zip(re.findall(ESTIMATE, one), re.findall(ESTIMATE, other), strict=True)
        return words == others and all(
            abs(float(a) - float(b)) <= 4 * (float(s) + float(r)) for (a, s), (b, r) in pairs
        )
    return words == others and all(
        abs(float(a) - float(b)) <= max(0.02 * abs(float(a)), 2.01 * unit(a))
        for a, b in zip(numbers, found, strict=True)
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


def first_wrong(capsys, monkeypatch, folder, part, chatter=False):
    """Run the commands of a part in an empty folder; the first that fails, or line that is missing, None where there
    is none."""
    monkeypatch.chdir(folder)
    monkeypatch.setenv("COLUMNS", "500")
    for words, lines in commands(part):
        said = call(capsys, monkeypatch, *words)
        if said.code:
            return f"{' '.join(words)}: {said.err}"
        line = missing(lines, said.out, chatter)
        if line is not None:
            return f"{' '.join(words)}: {line}"
    return None
