"""The code is held to the table of rooms in docs/architecture.md."""

import ast
import re
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src" / "plantfit"
ALWAYS = {"errors", "folders", "lazy", "plugins", "runtime", "units"}
# where the contracts are written that "contracts" means
CONTRACTS = {"optimize", "models", "space", "problem", "trust"}


def rooms_of_table() -> dict[str, set[str]]:
    """Room -> rooms that its row names; "all above" and "contracts" spelled out."""
    rows = re.findall(
        r"^\| `([\w./]+)` \|[^|]*\|([^|]*)\|$", (ROOT / "docs" / "architecture.md").read_text("utf-8"), re.M
    )
    named: dict[str, set[str]] = {}
    for room, allowed in rows:
        text = allowed.strip()
        names = set(named) if text == "all above" else {n.strip() for n in text.split(",") if n.strip()}
        if "contracts" in names:
            names = names - {"contracts"} | CONTRACTS
        named[_room(room)] = names
    return named


def _room(written: str) -> str:
    return written.removesuffix("/").removesuffix(".py")


def closure(named: dict[str, set[str]]) -> dict[str, set[str]]:
    """What a room may import: what its row names, and what those may import."""

    def reach(room: str, seen: set[str]) -> set[str]:
        for other in named[room] - seen:
            seen.add(other)
            reach(other, seen)
        return seen

    return {room: reach(room, set()) | ALWAYS | {room} for room in named}


def modules() -> dict[str, Path]:
    found = {}
    for path in SOURCE.rglob("*.py"):
        parts = ("plantfit", *path.relative_to(SOURCE).with_suffix("").parts)
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports_of(source: str, known: set[str]) -> list[tuple[str, int]]:
    """Modules of plantfit that a text imports anywhere in it, with their lines."""
    return imports_in(ast.parse(source), known)


def imports_in(tree: ast.Module, known: set[str]) -> list[tuple[str, int]]:
    """`imports_of` of a parsed text."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(a.name, node.lineno) for a in node.names if a.name.split(".")[0] == "plantfit"]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import; write plantfit.room.module"
            if (node.module or "").split(".")[0] == "plantfit":
                for alias in node.names:
                    inner = f"{node.module}.{alias.name}"
                    found.append((inner if inner in known else str(node.module), node.lineno))
    return found


MODULES = modules()
NAMED = rooms_of_table()


@cache
def looked_through() -> tuple[dict[str, list[tuple[str, int]]], list[str]]:
    """What each module imports, and where one prints; each is parsed once, and by the process that runs these tests
    alone."""
    edges, prints = {}, []
    for name, path in MODULES.items():
        tree = ast.parse(path.read_text("utf-8"))
        edges[name] = imports_in(tree, set(MODULES))
        prints += [
            f"{name}:{node.lineno}"
            for node in ast.walk(tree)
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "print"
        ]
    return edges, prints


def test_the_table_is_read_whole():
    assert {"recording", "simulate", "optimize", "problem", "trust", "fitting", "cli", "testing"} <= set(NAMED)
    assert all(other in NAMED for names in NAMED.values() for other in names)


def test_every_room_of_the_code_has_a_row():
    rooms = {name.split(".")[1] for name in MODULES if "." in name}
    assert rooms <= set(NAMED), f"no row in docs/architecture.md for {sorted(rooms - set(NAMED))}"


def test_optimize_and_simulate_never_meet():
    allowed = closure(NAMED)
    assert "simulate" not in allowed["optimize"]
    assert "optimize" not in allowed["simulate"]


@pytest.mark.thorough
def test_rooms_import_only_what_their_row_allows():
    allowed = closure(NAMED)
    # the package itself holds only lazy names and is everyone's root
    wrong = [
        f"{name}:{line} imports {target}"
        for name, edges in looked_through()[0].items()
        if "." in name
        for target, line in edges
        if "." in target and target.split(".")[1] not in allowed[name.split(".")[1]]
    ]
    assert not wrong, "\n".join(wrong)


def test_no_import_cycles():
    state: dict[str, int] = {}
    edges, _ = looked_through()

    def visit(name: str, path: tuple[str, ...]) -> None:
        if state.get(name) == 2:
            return
        assert state.get(name) != 1, " -> ".join([*path[path.index(name) :], name])
        state[name] = 1
        for target, _ in edges.get(name, []):
            if target != "plantfit":
                visit(target, (*path, name))
        state[name] = 2

    for name in MODULES:
        if name != "plantfit":
            visit(name, ())


def test_only_cli_prints():
    prints = looked_through()[1]
    assert [p for p in prints if p.startswith("plantfit.cli.")], "what prints is not seen"
    wrong = [p for p in prints if not p.startswith(("plantfit.cli.", "plantfit.cli:"))]
    assert not wrong, f"print() outside cli: {wrong}"


def test_the_checks_see_a_wrong_import():
    known = {"plantfit.simulate", "plantfit.simulate.steps.grid", "plantfit.optimize"}
    assert imports_of("def f():\n    from plantfit.simulate.steps import grid", known) == [
        ("plantfit.simulate.steps.grid", 2)
    ]
    assert imports_of("from plantfit.optimize import minimise\nimport numpy", known) == [("plantfit.optimize", 1)]


def _loaded(statement: str, module: str) -> bool:
    code = f"import sys\n{statement}\nsys.exit({module!r} in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert not done.stderr, done.stderr
    return done.returncode == 1


@pytest.mark.parametrize("module", ["jax", "numpy", "scipy", "polars"])
def test_importing_plantfit_loads_nothing_heavy(module):
    assert not _loaded("import plantfit", module)


def test_help_answers_without_jax():
    if not (SOURCE / "cli" / "main.py").exists():
        pytest.fail("plantfit.cli.main does not exist in this tree")
    script = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["scripts"]["plantfit"]
    module, function = script.split(":")
    code = (
        f"import sys\nsys.argv = ['plantfit', '--help']\nfrom {module} import {function} as main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert not end.code\nassert 'jax' not in sys.modules"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "demo" in done.stdout
