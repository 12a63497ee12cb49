"""Long files of plain numbers are read by polars at once: the same recording and the same sentences as line by line."""

import numpy as np
import polars as pl
import pytest

from plantfit.errors import PlantfitError
from plantfit.recording import read
from plantfit.recording.readers.formats.text import csv, plain_text
from plantfit.recording.readers.formats.text.csv import csv_table

N = 200


def rows(separator=",", number="{:.17g}"):
    rng = np.random.default_rng(1)
    values = np.column_stack(
        [np.arange(N) * 0.01, rng.normal(size=(N, 2)) * 10.0 ** rng.integers(-30, 30, size=(N, 2))]
    )
    return [separator.join(number.format(v) for v in row) for row in values]


HEADER = "t [s],u [V],y [mm]"
PLAIN = "\n".join([HEADER, *rows()]) + "\n"
LINES = PLAIN.splitlines()


def but(line, text):
    """The plain file with another line (counted from 1)."""
    return "\n".join([*LINES[: line - 1], text, *LINES[line:]]) + "\n"


QUICK = {  # read at once
    "plain": PLAIN,
    "no end of the last line": PLAIN[:-1],
    "the last line cut": PLAIN[: PLAIN.rindex(",")],
    "DOS lines": PLAIN.replace("\n", "\r\n"),
    "mark": "\ufeff" + PLAIN,
    "no header": "\n".join(LINES[1:]),
    "units in a row": "\n".join(["t,u,y", "s,V,mm", *LINES[1:]]),
    "comments on top": "# a bench\n% and more\n" + PLAIN,
    "commented header": "# t u y\n" + "\n".join(LINES[1:]).replace(",", "\t"),
    "quoted header": '"t [s]","u [V]","y [mm]"\n' + "\n".join(LINES[1:]),
    "semicolons": PLAIN.replace(",", ";"),
    "empty cells": but(90, "0.88,,2"),
    "not a number, a word known to polars": but(150, "1.48,NaN,inf"),
    "missing words on top": but(5, "0.03,n/a,2"),
    "empty lines on top": "\n\n" + PLAIN,
    "empty lines at the end": PLAIN + "\n \n",
    "a column of words": "\n".join(
        [f"{HEADER},note", *(f"{line},{'ok' if k % 3 else 'Ü'}" for k, line in enumerate(LINES[1:]))]
    ),
    "an empty column": "\n".join(f"{line}," for line in LINES),
    "stamps": "\n".join(["t,u", *(f"2024-05-31T13:05:{k / 10:04.1f},{k}" for k in range(N))]),
    "time goes back": but(120, "0.5,1,2"),
    "a time twice": but(120, LINES[118]),
    "time is missing": but(120, ",1,2"),
    "time is infinite": but(120, "inf,1,2"),
    "no numbers at all": "\n".join(["t,u", *(f"{k},a" for k in range(N))]),
}
BY_LINE = {  # left to csv.py
    "a word": but(120, "1.18,abc,2"),
    "hexadecimal": but(120, "1.18,0x10,2"),
    "a quoted cell": but(120, '1.18,"3",2'),
    "a comment": but(120, "# here"),
    "an empty line": but(120, ""),
    "a line of blanks": but(120, "   "),
    "too short": but(120, "1.18,2"),
    "too long": but(120, "1.18,2,3,4"),
    "one short and one long": but(120, "1.18,2").replace(LINES[150], LINES[150] + ",5"),
    "decimal commas": PLAIN.replace(",", ";").replace(".", ","),
    "one decimal comma": PLAIN.replace(",", ";").replace("0.5;", "0,5;"),
    "both marks": "\n".join(["t;u;y", *(f"{k / 10};{k},5;2" for k in range(N))]),
    "white space": PLAIN.replace(",", "  "),
    "Latin-1": ("t [s],u [V],y [mm]\n" + "\n".join(LINES[1:]) + "\n1e9,1,\xb5").encode("latin-1"),
    "old Macintosh": PLAIN.replace("\n", "\r"),
    "a lone return": but(120, "1.18,2\r3"),
    "a missing word below": but(150, "1.48,NA,2"),
    "blanks behind a number": but(150, "1.48,1 ,2"),
    "nothing": "",
    "UTF-16": PLAIN.encode("utf-16"),
    "binary": b"\0" * 300,
}


def outcome(file, **options):
    """The recording, or the sentence of the error."""
    try:
        record = read(file, **options)
    except PlantfitError as error:
        return str(error)
    return record.t.tobytes(), {k: (s.values.tobytes(), s.unit) for k, s in record.signals.items()}, record.log


@pytest.fixture
def ways(tmp_path, monkeypatch):
    """Both ways through a file, and whether the quick one was taken."""
    taken = []
    quickly = csv._quickly

    def told(*given):
        found = quickly(*given)
        taken.append(found is not None)
        return found

    monkeypatch.setattr(csv, "_quickly", told)

    def both(content, **options):
        file = tmp_path / "x.csv"
        file.write_bytes(content if isinstance(content, bytes) else content.encode())
        monkeypatch.setattr(plain_text, "SHORTEST", 0)
        at_once = outcome(file, **options)
        quick = taken[-1]
        monkeypatch.setattr(plain_text, "SHORTEST", 1 << 60)
        assert outcome(file, **options) == at_once
        assert not taken[-1]
        return quick, at_once

    return both


@pytest.mark.parametrize("name", QUICK)
def test_plain_files_are_read_at_once(name, ways):
    assert ways(QUICK[name])[0]
    ways(QUICK[name], sort=True, duplicates="mean")


@pytest.mark.parametrize("name", BY_LINE)
def test_all_else_is_read_line_by_line(name, ways):
    assert not ways(BY_LINE[name])[0]


@pytest.mark.parametrize(
    "options", [{"decimal": ","}, {"decimal": "."}, {"delimiter": ";"}, {"header": False}, {"skip": 1}, {"period": 0.5}]
)
def test_options_mean_the_same(options, ways):
    ways(PLAIN, **options)
    ways(PLAIN.replace(",", ";"), **options)


def test_a_cut_last_line_and_the_line_of_a_fault_are_named(ways):
    assert "The last line (201) is incomplete and was left out." in ways(QUICK["the last line cut"])[1][2]
    assert "x.csv, line 120: time goes back from 1.17 s to 0.5 s" in ways(QUICK["time goes back"])[1]


def test_broken_files_mean_the_same(ways):
    rng = np.random.default_rng(3)
    words = [
        "",
        ",",
        ",,",
        "\n",
        "\r\n",
        "#",
        '"',
        "/",
        "//",
        "nan",
        "1e400",
        "0x1",
        ";",
        "\t",
        " ",
        "1_0",
        "\ufeff",
        "-",
        "+1",
        "5.",
        ".5",
        "1d5",
        "\0",
    ]
    taken = 0
    for _ in range(150):
        text = PLAIN
        for _ in range(int(rng.integers(1, 4))):
            at, length = int(rng.integers(0, len(text))), int(rng.integers(0, 3))
            text = text[:at] + words[int(rng.integers(0, len(words)))] + text[at + length :]
        taken += ways(text)[0]
    assert 15 < taken < 135


def test_a_long_file_is_read_at_once_by_itself(tmp_path, monkeypatch):
    monkeypatch.setattr(csv, "_parse", None)  # the other way would fail
    (tmp_path / "x.csv").write_text("\n".join([HEADER, *(f"{k},{k}.125,{k}.25" for k in range(100_000))]))
    frame = csv_table(tmp_path / "x.csv")
    assert [c.cells.dtype for c in frame.columns] == [pl.Float64] * 3
    assert frame.columns[1].cells[-1] == 99_999.125
