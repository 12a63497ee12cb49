"""Print the lowest version of every dependency that pyproject.toml allows, as constraints for pip."""

import re
import sys
import tomllib
from pathlib import Path

project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))["project"]
lists = [project["dependencies"], *(deps for name, deps in project["optional-dependencies"].items() if name not in ("bench", "rivals"))]
lowest: dict[str, str] = {}
for line in (line for deps in lists for line in deps):
    found = re.match(r"([A-Za-z0-9_.-]+)(?:\[[^\]]*\])?>=([0-9.]+)$", line)
    if found:
        lowest[found[1]] = found[2]
lowest["jaxlib"] = lowest["jax"]  # of other versions pip would take a newer one
for tool in ("ruff", "pyrefly", "hypothesis", "pytest", "pytest-xdist"):  # they check the code, which does not run on them
    lowest.pop(tool, None)
sys.stdout.write("".join(f"{name}=={version}\n" for name, version in sorted(lowest.items())))
