"""Study files that are wrong in ways no person would think of: SpecError or another error of ours, in one sentence,
soon."""

import pytest

from plantfit.errors import PlantfitError
from plantfit.spec import load, parse

HEAD = """
name = "x"
[recording.a]
file = "x.csv"
"""
TEXT = (
    HEAD
    + """
[model]
equations = "y = K*u"
inputs = { u = "" }
outputs = { y = "" }
[parameters.K]
bounds = [0.0, 1.0]
"""
)
LONG = "9" * 400


def said(text, tmp_path):
    (tmp_path / "x.csv").write_text("time,u,y\n" + "".join(f"{k},{k % 3},{k % 3}\n" for k in range(30)))
    with pytest.raises(PlantfitError) as raised:
        parse(text, tmp_path / "s.toml")
    sentence = str(raised.value)
    assert len(sentence) < 1200
    return sentence


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('inputs = { u = "" }', "inputs = [[1]]"),
        ('inputs = { u = "" }', "inputs = [{}]"),
        ('outputs = { y = "" }', "outputs = [1.5]"),
        ('outputs = { y = "" }', "outputs = 1979-05-27"),
        ("[0.0, 1.0]", f"[0, {LONG}]"),
        ("[0.0, 1.0]", f"[0.0, 1.0]\nvalue = {LONG}"),
        ("[0.0, 1.0]", f"[0.0, 1.0]\n[search]\nseed = {LONG}"),
        ("[0.0, 1.0]", f"[0.0, 1.0]\n[search]\nseed = {'9' * 5000}"),
        ("[0.0, 1.0]", f"[0.0, 1.0]\n[search]\nruns = {LONG}"),
        ("[0.0, 1.0]", f"[0.0, 1.0]\n[scales]\ny = {LONG}"),
        ("[0.0, 1.0]", f"{'[' * 900}1{']' * 900}"),
        ("[0.0, 1.0]", f"[0.0, 1.0]\n[{'.'.join('a' * 900)}]\nb = 1"),
        ("y = K*u", f"y = {'(' * 900}K*u{')' * 900}"),
        ("y = K*u", f"y = {'-' * 9000}K*u"),
        ("y = K*u", f"y = {'+'.join(['K*u'] * 9000)}"),
        ("y = K*u", f"y = {LONG * 20}*K*u"),
        ('file = "x.csv"', 'file = "x\\u0000.csv"'),
        ('file = "x.csv"', 'file = "' + "x" * 5000 + '"'),
        ('name = "x"', f'name = "x"\n{"k" * 90_000} = 1'),
        ('name = "x"', f'name = ["{"k" * 90_000}"]'),
        ("[0.0, 1.0]", "[0.0, 1.0]\n[search]\nmethods = [[]]"),
        ("[0.0, 1.0]", "[0.0, 1.0]\n[search.settings]\nauto = 7"),
        ("[0.0, 1.0]", f"[0.0, 1.0]\n[search]\nmethods = ['pso']\nsettings = {{ pso = {{ population = {LONG} }} }}"),
        ("[0.0, 1.0]", f"[0.0, 1.0]\n[search]\nmethods = ['pso']\nsettings = {{ pso = {{ inertia = -{LONG} }} }}"),
        ("[0.0, 1.0]", "[0.0, 1.0]\nscale = []"),
        ('file = "x.csv"', 'file = "x.csv"\nclean = [7]'),
        ('file = "x.csv"', 'file = "x.csv"\nclean = [{ step = [1] }]'),
        ('file = "x.csv"', 'file = "x.csv"\nclean = [{ step = "lowpass", signal = [[]], cutoff = {} }]'),
        ('file = "x.csv"', 'file = "x.csv"\nclean = [{ step = "cut", start = [] }]'),
        ('file = "x.csv"', 'file = "x.csv"\nclean = [{ step = "drop_outliers", signal = "u", window = "wide" }]'),
        ('file = "x.csv"', 'file = "x.csv"\nclean = [{ step = "shift_time", signal = "u", by = nan }]'),
    ],
    ids=lambda t: t[:24] if isinstance(t, str) else t,
)
def test_one_sentence_each(old, new, tmp_path):
    assert old in TEXT
    said(TEXT.replace(old, new), tmp_path)


@pytest.mark.parametrize(
    ("step", "told"),
    [
        ('{ step = "cut", start = "x" }', "a value is of the wrong kind"),
        ('{ step = "lowpass", cutoff = 1.0 }', "the key 'signal' is missing; add it"),
        (
            '{ step = "lowpass", signal = "u", cutof = 1.0 }',
            "there is no key 'cutof' (did you mean 'cutoff'?); this step takes signal, cutoff",
        ),
        ('{ step = "fill_gaps", signals = "u", longest = 5 }', "there is no key 'signals' (did you mean 'signal'?)"),
        ('{ signal = "u", cutoff = 1.0 }', 'says no step; write step = "NAME". Known steps: drop_outliers,'),
        ('{ step = "resample" }', "the key 'period' is missing; add it"),
        (
            '{ step = "convert_units", units = { u = "kg" } }',
            "signal 'u' has no unit to convert from; state it in units",
        ),
    ],
)
def test_cleaning_steps_are_told_in_words(step, told, tmp_path):
    """Not "ufunc 'greater_equal' did not contain a loop", nor that `lowpass` lacks a name, which study files call
    signal."""
    sentence = said(TEXT.replace('file = "x.csv"', f'file = "x.csv"\nclean = [{step}]'), tmp_path)
    assert told in sentence
    assert "recording.a.clean[0]" in sentence


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("", 'file = "y.csv"', "s.toml, [recording.a]: File "),
        ("", 'time = "when"', "s.toml, [recording.a]: x.csv has no column 'when' for time; it has ['time', 'u', 'y']."),
        (
            "",
            'units = { y = "blub" }',
            "s.toml, [recording.a]: x.csv: units gives 'y' a unit that cannot be used: 'blub' is not a known unit",
        ),
        ("", 'before = { u = "x" }', "s.toml: Recording 'a': before gives 'u' as 'x': 'x' is not a number with a unit"),
        (
            "",
            "skip = 500",
            "s.toml: No measured sample of 'y' is left to fit (recording "
            "'a' lasts from 0 to 29 s, and 0 of its 30 samples",
        ),
        (
            "",
            "fit = [0, 9]\nvalidate = [5, 29]",
            "overlap; unseen data must not be fitted, so choose intervals that do not overlap.",
        ),
        (
            "equations =",
            'kind = "drive"\nequations =',
            "s.toml: [model] has kind = 'drive' and also equations; it can have only one",
        ),
        ('equations = "y = K*u"', "", 's.toml: [model] needs either kind = "..."'),
        ('"y = K*u"', '"y = K*delay(u, L)"', "'L' is none of them"),
    ],
)
def test_a_value_that_does_not_fit_is_told_with_file_and_place(old, new, told, tmp_path):
    if not old:
        old, new = ('file = "x.csv"', new) if new.startswith("file") else ('file = "x.csv"', f'file = "x.csv"\n{new}')
    assert told in said(TEXT.replace(old, new), tmp_path)


def test_a_dead_time_that_begins_below_zero_names_the_file_once(tmp_path):
    text = TEXT.replace("y = K*u", "y = K*delay(u, L)") + '[parameters.L]\nbounds = [-1.0, 5.0]\nunit = "s"\n'
    sentence = said(text, tmp_path)
    assert sentence.startswith(
        "s.toml: parameters.L is a dead time, and its lower bound is -1 s; an input cannot act before it happens"
    )


def test_a_folder_is_no_study_file(tmp_path):
    with pytest.raises(PlantfitError, match="is a folder; name a study file in it"):
        load(tmp_path)


def test_the_text_itself_is_good(tmp_path):
    (tmp_path / "x.csv").write_text("time,u,y\n" + "".join(f"{k},{k % 3},{k % 3}\n" for k in range(30)))
    assert parse(TEXT, tmp_path / "s.toml").name == "x"
    (tmp_path / "s.toml").write_bytes(b"\xef\xbb\xbf" + TEXT.encode())  # a byte order mark is fine
    assert load(tmp_path / "s.toml").name == "x"


def test_a_file_that_is_not_text(tmp_path):
    for content in (TEXT.encode("utf-16"), b"name = '\xff'", bytes(range(256))):
        (tmp_path / "s.toml").write_bytes(content)
        with pytest.raises(PlantfitError, match="not UTF-8 text"):
            load(tmp_path / "s.toml")
    for name in ("a\0b.toml", "x" * 5000, "nowhere/x.toml"):
        with pytest.raises(PlantfitError):
            load(tmp_path / name)
