"""Commands import what they need: what a new process has loaded after the doors of the package, and the names of
lazy rooms."""

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import plantfit
from plantfit import lazy

SOURCE = Path(__file__).resolve().parent.parent / "src" / "plantfit"
HEATER = SOURCE / "cases" / "heater" / "first_order.toml"
HEAVY = (
    "jax",
    "numpy",
    "scipy",
    "scipy.stats",
    "scipy.signal",
    "scipy.optimize",
    "polars",
    "pint",
    "sqlalchemy",
    "jinja2",
    "plotly",
)
SLOW_OF_SCIPY = ("scipy.stats", "scipy.signal", "scipy.interpolate")
LAZY = sorted(p.parent.name for p in SOURCE.glob("*/__init__.py") if "names_of(" in p.read_text("utf-8"))

_COMMAND = """
import sys
sys.argv = ["plantfit", *sys.argv[1:]]
from plantfit.cli.start import run
try:
    run()
except SystemExit as end:
    code = end.code or 0
else:
    code = 0
print("LOADED", code, *sorted(sys.modules))
"""


def _loaded(code: str, *arguments: str, folder: Path | None = None) -> tuple[set[str], list[str], str]:
    """The modules that a new process has loaded at its end, the words before them, and what it said on standard
    error."""
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, timeout=300, cwd=folder
    )
    lines = [line for line in done.stdout.splitlines() if line.startswith("LOADED")]
    assert lines, done.stderr
    words = lines[-1].split()[1:]
    return set(words[1:]), words[:1], done.stderr


def test_importing_plantfit_loads_nothing_heavy():
    loaded, _, _ = _loaded("import sys, plantfit\nprint('LOADED', 0, *sys.modules)")
    assert "plantfit" in loaded
    assert not loaded & set(HEAVY)


def test_help_loads_nothing_heavy():
    loaded, code, told = _loaded(_COMMAND, "--help")
    assert code == ["0"], told
    assert not loaded & set(HEAVY)


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(
    ("right", "wrong", "sentence"),
    [
        ("[search]", "[serch]", "key 'serch' is not known; did you mean 'search'?"),
        ("budget = 4000", 'budget = "many"', "search.budget = 'many' cannot be used"),
        ("[parameters.K]", "[parameters.K", "is not valid TOML"),
    ],
)
def test_a_slip_in_a_study_file_is_told_before_anything_heavy_is_loaded(tmp_path, command, right, wrong, sentence):
    text = HEATER.read_text("utf-8")
    assert right in text
    (tmp_path / "wrong.toml").write_text(text.replace(right, wrong), "utf-8")
    loaded, code, told = _loaded(_COMMAND, command, "wrong.toml", folder=tmp_path)
    assert code == ["7"]
    assert sentence in told
    assert not loaded & set(HEAVY)


def test_a_check_loads_what_it_simulates_with_and_nothing_of_scipy():
    """scipy.linalg alone takes a fifth of the time of jax."""
    loaded, code, told = _loaded(_COMMAND, "check", str(HEATER))
    assert code == ["0"], told
    assert {"jax", "polars", "pint"} <= loaded
    rooms = {"scipy.linalg", "scipy.special", "scipy.optimize", *SLOW_OF_SCIPY}
    assert not loaded & {*rooms, "sqlalchemy", "plotly", "plantfit.report.html"}


def test_blas_runs_on_one_thread_also_where_scipy_is_loaded_later():
    """Sums change their last bits with the number of threads."""
    code = (
        "import plantfit.runtime\nimport scipy.linalg, threadpoolctl\n"
        "print('LOADED', *(p['num_threads'] for p in threadpoolctl.threadpool_info() if p['user_api'] == 'blas'))"
    )
    threads, first, told = _loaded(code)
    assert first, told
    assert {*first, *threads} == {"1"}


@pytest.mark.thorough
def test_a_run_loads_no_distributions_of_scipy(tmp_path):
    """A search for what is missing may try linear models, which need scipy.signal."""
    loaded, code, told = _loaded(_COMMAND, "run", str(HEATER), "--no-diagnose", folder=tmp_path)
    assert code == ["0"], told
    assert (tmp_path / "first_order.html").is_file()
    assert not loaded & set(SLOW_OF_SCIPY)


def test_all_public_names_of_the_package_resolve():
    for name in plantfit.__all__:
        assert getattr(plantfit, name) is not None
    assert set(plantfit.__all__) <= set(dir(plantfit))


def test_the_rooms_that_are_lazy_are_found():
    assert {"models", "problem", "recording", "report", "spec", "study", "trust"} <= set(LAZY)


@pytest.mark.parametrize("room", LAZY)
def test_names_of_a_lazy_room_are_those_that_editors_see(room):
    module = import_module(f"plantfit.{room}")
    tree = ast.parse((SOURCE / room / "__init__.py").read_text("utf-8"))
    (block,) = [n for n in tree.body if isinstance(n, ast.If)]
    seen = {a.name: n.module for n in block.body if isinstance(n, ast.ImportFrom) for a in n.names}
    assert module.__dict__["_places"] == seen
    assert sorted(module.__all__) == sorted(seen)
    assert set(seen) <= set(dir(module))
    for name, place in seen.items():
        assert getattr(module, name) is getattr(import_module(str(place)), name)


@pytest.mark.parametrize("room", LAZY)
@pytest.mark.thorough
def test_a_module_never_hides_the_name_that_it_shares(room):
    """trust/intervals/covariance.py holds the function `covariance`, which the room gives, also after the module was
    imported."""
    code = (
        "import sys\nfrom importlib import import_module\n"
        f"room = import_module('plantfit.{room}')\n"
        "for name, place in room._places.items():\n"
        "    import_module(place)\n"
        "wrong = [n for n, place in room._places.items() if getattr(room, n) is not getattr(sys.modules[place], n)]\n"
        "print('LOADED', 0, *wrong)"
    )
    wrong, _, _ = _loaded(code)
    assert not wrong


def test_a_name_that_a_room_lacks_is_an_attribute_error():
    from plantfit import trust

    with pytest.raises(AttributeError, match=r"module 'plantfit\.trust' has no attribute 'covarince'"):
        _ = trust.covarince  # pyrefly: ignore[missing-attribute]
    assert isinstance(trust, lazy._Room)


def test_modules_that_import_jax_are_set_up_by_the_runtime_first():
    """Each in a process of its own would take minutes; so each before any other of plantfit but the root, in one."""
    names = [
        ".".join(("plantfit", *p.relative_to(SOURCE).with_suffix("").parts))
        for p in sorted(SOURCE.rglob("*.py"))
        if any(line.startswith(("import jax", "from jax")) for line in p.read_text("utf-8").splitlines())
        and p.name != "runtime.py"
    ]
    assert len(names) > 100
    wrong = [name for name in names if not _runtime_comes_first(name, set())]
    assert not wrong


def _runtime_comes_first(name: str, seen: set[str]) -> bool:
    """Whether a module, read from its top, imports plantfit.runtime, itself or by another module, before jax."""
    path = SOURCE.joinpath(*name.split(".")[1:])
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    for node in ast.parse(path.read_text("utf-8")).body:
        if isinstance(node, ast.Import):
            modules = [a.name for a in node.names]
        elif isinstance(node, ast.ImportFrom):
            modules = [f"{node.module}.{a.name}" if node.module == "plantfit" else str(node.module) for a in node.names]
        else:
            continue
        for module in modules:
            if module == "plantfit.runtime":
                return True
            if module.split(".")[0] == "jax":
                return False
            if module.startswith("plantfit.") and module.count(".") > 1 and module not in seen:
                seen.add(module)
                if _runtime_comes_first(module, seen):
                    return True
    return False


_UNITS = (
    "from plantfit import units as u\nprint('LOADED', 0, u.factor('V s', 'mV s'), u.factor('Nm', 'N*mm'), "
    "u.known('PWM'))"
)


@pytest.mark.thorough
def test_units_are_the_same_from_an_empty_a_kept_and_a_damaged_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PLANTFIT_CACHE", str(tmp_path / "cache"))
    empty, _, told = _loaded(_UNITS)
    assert "True" in empty, told
    assert [float(word) for word in empty - {"True"}] == pytest.approx([1000.0] * (len(empty) - 1))
    kept = sorted((tmp_path / "cache").glob("pint-*/definitions/*.pickle"))
    assert kept
    assert _loaded(_UNITS)[0] == empty
    for damaged in (b"damaged", b""):
        for file in kept:
            file.write_bytes(damaged)
        assert _loaded(_UNITS)[0] == empty
        assert [file.read_bytes() for file in sorted(kept)] != [damaged] * len(kept)  # made anew
    one = max(kept, key=lambda file: file.stat().st_size)
    for place in (200, one.stat().st_size // 2):  # a flipped bit may be a number that loads
        content = bytearray(one.read_bytes())
        content[place] ^= 1
        one.write_bytes(content)
        assert _loaded(_UNITS)[0] == empty
    # nothing is left beside them
    assert [folder.name for folder in (tmp_path / "cache").glob("pint-*/*")] == ["definitions"]
