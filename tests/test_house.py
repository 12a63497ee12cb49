"""The house is as docs/architecture.md says: its sub-rooms, and the files that pages and docstrings name."""

import ast
import importlib
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

import plantfit

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src" / "plantfit"
MOST = 15
ROOMS = sorted(p.name for p in SOURCE.iterdir() if (p / "__init__.py").exists())
FILES = sorted(p.stem for p in SOURCE.glob("*.py") if not p.stem.startswith("_"))
DOTTED = re.compile(rf"`(?:plantfit\.)?((?:{'|'.join([*ROOMS, *FILES])})(?:\.\w+)+)(?:\([^`]*\))?`")
NAMED = re.compile(rf"(?<![\w./])((?:{'|'.join(ROOMS)})(?:/[a-z_0-9]+)*/(?:[a-z_0-9]+\.py\b)?)")


def folders() -> list[Path]:
    found = [p for p in sorted(SOURCE.rglob("*")) if p.is_dir() and p.name != "__pycache__"]
    # not what a moved folder left behind
    return [p for p in found if any(e.name != "__pycache__" for e in p.iterdir())]


@pytest.mark.parametrize("folder", folders(), ids=lambda p: str(p.relative_to(SOURCE)))
def test_no_folder_has_more_entries_than_one_can_survey(folder):
    entries = [p.name for p in folder.iterdir() if p.name != "__pycache__"]
    assert len(entries) <= MOST, f"{len(entries)} entries; make a sub-room, and name it in docs/architecture.md"


def test_every_package_says_what_it_holds():
    for init in SOURCE.rglob("__init__.py"):
        assert ast.get_docstring(ast.parse(init.read_text("utf-8"))), f"{init.relative_to(SOURCE)} has no docstring"


def test_files_that_pages_and_docstrings_name_exist():
    pages = [*(ROOT / "docs").glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md", *SOURCE.rglob("*.py")]
    wrong = [
        f"{page.relative_to(ROOT)}: {name}"
        for page in pages
        for name in NAMED.findall(page.read_text("utf-8"))
        if not (SOURCE / name).exists() and not (ROOT / "tests" / name).exists()
    ]
    assert not wrong, "\n".join(wrong)


def test_dotted_names_in_docstrings_and_comments_lead_somewhere():
    wrong = [
        f"{page.relative_to(ROOT)}: {name}"
        for page in SOURCE.rglob("*.py")
        for name in DOTTED.findall(page.read_text("utf-8"))
        if not (name.endswith(".py") and (SOURCE / name).exists()) and not leads(name)
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "name", ["simulate.tight", "optimize.basins.Basins", "answer.undiagnose", "models.parts.tables.lockup"]
)
def test_a_dotted_name_that_leads_nowhere_is_found(name):
    assert DOTTED.findall(f"see `{name}`") == [name]
    assert not leads(name)


def leads(name: str) -> bool:
    """Whether `room.file.name` is there; `answer.diagnose` is of an `Answer`, which the room defines."""
    room, *parts = name.split(".")
    found = importlib.import_module(f"plantfit.{room}")
    own = getattr(found, room.title(), None)
    for part in parts:
        try:
            found = getattr(found, part, None) or importlib.import_module(f"{found.__name__}.{part}")
        except (ModuleNotFoundError, AttributeError):
            return len(parts) == 1 and hasattr(own, part)
    return True


def test_every_sub_room_stands_on_the_page():
    page = (ROOT / "docs" / "architecture.md").read_text("utf-8")
    table = page[page.index("## Sub-rooms") : page.index("## Where do I put")]
    missing = [
        f"{p.parent.name}/{p.name}"
        for p in folders()
        if p.parent.parent == SOURCE and p.parent.name not in ("cases", "rig") and f"`{p.name}/`" not in table
    ]
    assert not missing, missing


def test_no_function_hides_a_sub_room():
    hidden = []
    for found in pkgutil.walk_packages(plantfit.__path__, "plantfit."):
        if found.ispkg:
            importlib.import_module(found.name)
            room, _, name = found.name.rpartition(".")
            if not isinstance(getattr(importlib.import_module(room), name), ModuleType):
                hidden.append(found.name)
    assert hidden == []


@pytest.mark.parametrize("stage", ["final_problem import finish", "runner.begin("])
def test_the_stages_of_an_answer_stand_in_one_place(stage):
    """`fit`, commands, stored studies and workers go through `stages.py`."""
    found = [str(p.relative_to(SOURCE)) for p in SOURCE.rglob("*.py") if stage in p.read_text("utf-8")]
    assert found == ["stages.py"]


@pytest.mark.thorough
def test_public_functions_are_annotated_in_full():
    """Functions and methods that a reader or an editor may call; of rooms `trust`, `report`, `findings` those within
    too."""
    bare = []
    for path in SOURCE.rglob("*.py"):
        place = path.relative_to(SOURCE)
        tree = ast.parse(path.read_text("utf-8"))
        whole = place.parts[0] in ("trust", "report", "findings") or place.name == "stages.py"
        found = ast.walk(tree) if whole else public(tree)
        bare += [f"{place}:{getattr(f, 'lineno', 0)} {getattr(f, 'name', '')}" for f in found if lacks_annotations(f)]
    assert bare == []


def public(tree: ast.Module | ast.ClassDef) -> Iterator[ast.AST]:
    for node in tree.body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public(node)
        elif not getattr(node, "name", "_").startswith("_"):
            yield node


def lacks_annotations(node: ast.AST) -> bool:
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return False
    given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
    bare = [a for a in given if a is not None and a.arg not in ("self", "cls", "_") and a.annotation is None]
    return bool(bare) or (node.returns is None and node.name not in ("__init__", "__post_init__"))


@pytest.mark.parametrize(
    "text", ["def f(a) -> None: ...", "def f(a: int): ...", "class A:\n    def f(self, *a) -> None: ..."]
)
def test_a_function_without_annotations_is_found(text):
    assert [lacks_annotations(f) for f in public(ast.parse(text))] == [True]


EVALUATE = SOURCE / "problem" / "evaluate"


def evaluators() -> set[str]:
    """Classes of the evaluators' room that have what the protocol asks for."""
    protocol = next(
        n for n in ast.parse((EVALUATE / "evaluator.py").read_text("utf-8")).body if isinstance(n, ast.ClassDef)
    )
    # those may be fields
    asked = {n.name for n in protocol.body if isinstance(n, ast.FunctionDef)} - {"local", "recordings"}
    found = set()
    for path in EVALUATE.glob("*.py"):
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.ClassDef) and node.name != "Evaluator":
                own = {n.name for n in node.body if isinstance(n, ast.FunctionDef)}
                own |= {
                    n.target.id for n in node.body if isinstance(n, ast.AnnAssign) and isinstance(n.target, ast.Name)
                }
                if asked <= own:
                    found.add(node.name)
    return found


def told_apart(text: str, names: set[str]) -> list[int]:
    """Lines that ask of something whether it is one of these classes: by isinstance, by its type, or by a match."""
    if not any(name in text for name in names):
        return []  # most files: parsing all takes seconds
    lines = []
    for node in ast.walk(ast.parse(text)):
        kinds: list[ast.AST] = []
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in ("isinstance", "issubclass")
        ):
            kinds = list(node.args[1:])
        elif isinstance(node, ast.Compare) and any(_type_of(side) for side in (node.left, *node.comparators)):
            kinds = [node.left, *node.comparators]
        elif isinstance(node, ast.MatchClass):
            kinds = [node.cls]
        if any(isinstance(n, ast.Name) and n.id in names for kind in kinds for n in ast.walk(kind)):
            lines.append(node.lineno if isinstance(node, ast.expr) else kinds[0].lineno)  # pyrefly: ignore[missing-attribute]
    return lines


def _type_of(node: ast.AST) -> bool:
    return isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "type"


def test_no_evaluator_is_told_apart_by_its_class():
    """Each of them is asked by the protocol alone; the planted lines show that another way would be seen."""
    names = evaluators()
    assert names == {"BatchedRecords", "RecordByRecord", "MovingAndSteady", "Smoothed"}
    for planted in (
        "if isinstance(e, BatchedRecords):\n    pass", "x = isinstance(e, (int, Smoothed))",
        "if type(e) is RecordByRecord:\n    pass",
        "match e:\n    case MovingAndSteady():\n        pass", "x = isinstance(e, int | Smoothed)",
    ):  # fmt: skip
        assert told_apart(planted, names) == [2 if planted.startswith("match") else 1], planted
    assert not told_apart("x = isinstance(e, Model)\ny = BatchedRecords(e)", names)
    wrong = [
        f"{path.relative_to(ROOT)}:{line}"
        for path in SOURCE.rglob("*.py")
        for line in told_apart(path.read_text("utf-8"), names)
    ]
    assert not wrong, wrong
