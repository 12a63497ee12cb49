"""The sentences that the verdict can say, read from its code: for each call of `say` the literal pieces of its text."""

import ast
import re
from pathlib import Path

import plantfit.trust.verdict

FOLDER = Path(plantfit.trust.verdict.__file__).parent


def _pieces(node: ast.AST) -> list[str]:
    """Literal pieces in the order of the text, with three words or more."""
    found = [n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)]
    return [p.strip(" .,:;(") for p in found if len(re.findall(r"[A-Za-z]{2,}", p)) >= 3]


def said() -> dict[str, list[str]]:
    """Place of every call of `say` (file:line) to the pieces of its text."""
    found: dict[str, list[str]] = {}
    for path in sorted(FOLDER.glob("*.py")):
        for function in (n for n in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(n, ast.FunctionDef)):
            texts: dict[str, list[str]] = {}
            for n in ast.walk(function):
                if isinstance(n, ast.Assign) and isinstance(n.targets[0], ast.Name):
                    texts.setdefault(n.targets[0].id, []).extend(_pieces(n.value))
                if isinstance(n, ast.AugAssign) and isinstance(n.target, ast.Name):
                    texts.setdefault(n.target.id, []).extend(_pieces(n.value))
            for n in ast.walk(function):
                if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and n.func.id == "say":
                    names = [m.id for m in ast.walk(n.args[1]) if isinstance(m, ast.Name)]
                    found[f"{path.name}:{n.lineno}"] = [
                        *_pieces(n.args[1]),
                        *(p for name in names for p in texts.get(name, [])),
                    ]
    return found
