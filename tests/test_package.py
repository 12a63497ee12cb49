"""What the package promises as a whole: its errors, its licence, its pins."""

import re
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from plantfit import errors

ROOT = Path(__file__).resolve().parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
PINS = dict(
    line.split("==")
    for line in (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    if line and not line.startswith("#")
)


def _normal(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _errors(base=errors.PlantfitError):
    for child in base.__subclasses__():
        if child.__module__ == errors.__name__:
            yield child
            yield from _errors(child)


def test_version_is_one():
    assert metadata.version("plantfit") == PROJECT["version"]


def test_licence_is_the_one_declared():
    text = (ROOT / "LICENSE").read_text("utf-8")
    assert "Apache License" in text
    assert "Version 2.0, January 2004" in text
    assert "END OF TERMS AND CONDITIONS" in text
    assert PROJECT["license"] == "Apache-2.0"


@pytest.mark.parametrize("extra", [None, *PROJECT["optional-dependencies"]])
def test_every_dependency_is_pinned_inside_its_range(extra):
    wanted = PROJECT["dependencies"] if extra is None else PROJECT["optional-dependencies"][extra]
    pins = {_normal(n): v for n, v in PINS.items()}
    extras = set(PROJECT["optional-dependencies"])
    for requirement in wanted:
        if own := re.fullmatch(r"plantfit\[([\w,]+)\]", requirement):  # an extra made of others
            assert set(own[1].split(",")) <= extras
            continue
        name, low = re.fullmatch(r"([\w.-]+)(?:\[[\w,]+\])?>=([\d.]+)(?:;.*)?", requirement).groups()  # pyrefly: ignore[missing-attribute]
        assert _normal(name) in pins, f"{name} has no line in constraints.txt"
        assert _numbers(pins[_normal(name)]) >= _numbers(low)


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(n) for n in re.findall(r"\d+", version))


def test_pins_are_exact_and_name_no_address():
    text = (ROOT / "constraints.txt").read_text("utf-8")
    assert all(
        re.fullmatch(r"[\w.-]+==[\w.]+( ; python_version [<>=]+ '[\d.]+')?|#.*", line)
        for line in text.splitlines()
        if line
    )
    assert "://" not in text


@pytest.mark.parametrize("error", list(_errors()), ids=lambda e: e.__name__)
def test_every_error_is_drawn_in_the_tree_and_has_its_exit_code(error):
    assert f"{error.__name__} " in (errors.__doc__ or "")
    assert 0 < error.exit_code < 256


def test_exit_codes_differ_between_families():
    codes = [e.exit_code for e in errors.PlantfitError.__subclasses__() if e.__module__ == errors.__name__]
    assert len(set(codes)) == len(codes)


def test_equation_error_points_at_the_character():
    shown = str(errors.EquationError("unknown name", "a = 1\nb = c", line=1, column=4))
    assert shown.split("\n") == ["unknown name", "    b = c", "        ^"]


@pytest.mark.parametrize("status", list(errors.Status))
def test_every_status_has_a_sentence(status):
    assert status.sentence.endswith(".")


def test_the_range_of_pythons_is_said_alike():
    """`requires-python` rules: the Makefile asks it, the README and the classifiers repeat it."""
    low, high = (int(n) for n in re.fullmatch(r">=3\.(\d+),<3\.(\d+)", PROJECT["requires-python"]).groups())  # pyrefly: ignore[missing-attribute]
    versions = [f"3.{n}" for n in range(low, high)]
    assert [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if "Python :: 3." in c] == versions
    readme = (ROOT / "README.md").read_text("utf-8")
    assert f"python3 ({versions[0]} to {versions[-1]})" in readme
    assert f"Python {', '.join(versions[:-1])} or {versions[-1]}" in readme
    assert "tools/python_version.py" in (ROOT / "Makefile").read_text("utf-8")
    code = (
        "import runpy; f = runpy.run_path('tools/python_version.py')['allowed']; "
        "print([f('{}', (3, n)) for n in range(9, 16)])"
    )
    told = subprocess.run(
        [sys.executable, "-c", code.format(PROJECT["requires-python"])], cwd=ROOT, capture_output=True, text=True
    )
    assert told.stdout.strip() == str([low <= n < high for n in range(9, 16)]), told.stderr
    assert subprocess.run([sys.executable, "tools/python_version.py"], cwd=ROOT).returncode == 0


@pytest.mark.thorough
def test_the_core_imports_no_extra():
    """Whatever an extra brings, and what SALib brings, stays out of the import of every room."""
    rooms = [
        "recording",
        "problem",
        "study",
        "spec",
        "trust",
        "report",
        "control",
        "rig",
        "fitting",
        "intervals_compared",
    ]
    rooms += ["cli.main", "cli.commands.understand.sensitivity"]
    heavy = [
        "SALib",
        "pandas",
        "matplotlib",
        "distributed",
        "fastexcel",
        "psycopg",
        "serial",
        "control",
        "osqp",
        "blackjax",
        "optax",
    ]
    loaded = f"print([n for n in {heavy} if n in sys.modules])"
    code = (
        f"import sys, importlib\nfor room in {rooms}:\n    module = importlib.import_module('plantfit.' + room)\n"
        f"    for name in getattr(module, '__all__', ()): getattr(module, name)\n{loaded}"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert told.stdout.strip() == "[]", told.stderr


def test_extras_that_no_other_test_takes_away_explain_themselves(tmp_path, monkeypatch):
    """`postgres`, `cluster`, `board`, `trust` and `posterior` are taken away in test_postgres, test_cluster,
    test_cli_record, test_cli_sensitivity and test_cli_intervals."""
    from plantfit.bridges import python_control
    from plantfit.recording import read

    monkeypatch.setitem(sys.modules, "fastexcel", None)
    (tmp_path / "x.xlsx").write_bytes(b"PK")
    with pytest.raises(
        errors.MissingExtra,
        match=r"x\.xlsx needs the package fastexcel; install it with: pip install 'plantfit\[xlsx\]'",
    ):
        read(tmp_path / "x.xlsx")
    monkeypatch.setitem(sys.modules, "control", None)
    head = python_control._CONTROL.partition("A, C =")[0]  # of every file that `plantfit export --to control` writes
    with pytest.raises(
        ImportError, match=r"needs the package control; install it with: pip install 'plantfit\[control\]'"
    ):
        exec(head, {})


def test_everything_vendored_is_in_the_notice_with_its_licence():
    notice = (ROOT / "NOTICE").read_text("utf-8")
    cases = ROOT / "src" / "plantfit" / "cases"
    vendored = [p for p in cases.rglob("*") if p.name.endswith((".csv", ".csv.gz", ".dat", ".mat", ".parquet"))]
    assert len(vendored) >= 10
    for path in vendored:
        case = path.relative_to(cases).parts[0]
        assert re.search(rf"^{case}/", notice, re.M), path
    named = re.findall(r"src/plantfit/cases/\S*LICENSE\S*\.txt", notice)
    assert len(named) >= 5
    assert all((ROOT / name).is_file() for name in named)
    assert {str(p.relative_to(ROOT)) for p in cases.rglob("LICENSE*")} == set(named)
    for name in ("CITATION.cff", "SECURITY.md", "NOTICE", "LICENSE"):
        assert name in (ROOT / "MANIFEST.in").read_text("utf-8")
    assert f"version: {PROJECT['version']}" in (ROOT / "CITATION.cff").read_text("utf-8")


def test_nothing_but_slow_tests_is_left_out_before_a_landing():
    """The everyday tests are a choice of those that `.ci/run` runs."""
    assert "make test ALL=1" in (ROOT / ".ci" / "run").read_text("utf-8")


def test_of_further_cases_the_first_are_everyday_ones(tmp_path):
    (tmp_path / "conftest.py").write_text((ROOT / "tests" / "conftest.py").read_text("utf-8"))
    (tmp_path / "test_some.py").write_text(
        """
import pytest
@pytest.mark.further(2)
@pytest.mark.parametrize("case", [pytest.param(0, marks=pytest.mark.slow), 1, 2, 3, 4])
def test_cases(case): pass
@pytest.mark.thorough
def test_dear(): pass
def test_plain(): pass
"""
    )

    def run(kinds):
        words = [sys.executable, "-m", "pytest", "-v", "-p", "no:cacheprovider", "-m", kinds, str(tmp_path)]
        told = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        return re.findall(r"::(test_\S+) PASSED", told)

    everyday = ["test_cases[1]", "test_cases[2]", "test_plain"]
    assert run("not slow and not thorough") == everyday
    assert run("thorough") == ["test_cases[3]", "test_cases[4]", "test_dear"]
    assert run("slow") == ["test_cases[0]"]
