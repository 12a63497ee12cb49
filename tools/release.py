"""A dry run of a release: sdist and wheel built twice bit for bit alike, the wheel installed in an environment of its own."""

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]
COPIED = ("src", "pyproject.toml", "README.md", "LICENSE", "NOTICE", "CITATION.cff", "SECURITY.md", "CHANGELOG.md")


def built(folder: Path) -> dict[str, str]:
    """Name and hash of what is built from a clean copy."""
    source, out = folder / "source", folder / "out"
    source.mkdir()
    for name in COPIED:
        ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(ROOT / name, source / name, ignore=ignored) if (ROOT / name).is_dir() else shutil.copy2(ROOT / name, source)
    stamp = subprocess.run(["git", "log", "-1", "--format=%ct"], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    environment = os.environ | {"SOURCE_DATE_EPOCH": stamp or "1700000000"}
    subprocess.run([sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(out), "."], cwd=source, check=True, env=environment)
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(out.iterdir())}


def main() -> None:
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as two:
        first, second = built(Path(one)), built(Path(two))
        if first != second:
            sys.exit(f"Two builds differ: {first}, {second}")
        (wheel,) = (Path(one) / "out").glob("*.whl")
        for name, digest in first.items():
            print(digest, name)
        place = Path(one) / "installed"
        venv.create(place, with_pip=True)
        python = place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
        constraints = str(ROOT / "constraints.txt")
        subprocess.run([str(python), "-m", "pip", "install", "-q", "--constraint", constraints, str(wheel)], check=True)
        command = [str(python), "-c", "from plantfit.cli.start import run; run()", "methods"]
        subprocess.run(command, check=True, cwd=one, stdout=subprocess.DEVNULL)
    print("Alike in two builds, and installed in an environment of its own. Nothing was uploaded.")


if __name__ == "__main__":
    main()
