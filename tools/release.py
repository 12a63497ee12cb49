"""A dry run of a release: sdist and wheel built twice bit for bit alike, both installed in environments of their own.

`--quick` installs the wheel with pip on this Python alone. Otherwise pip, uv and pipx install both on every Python of the range that
is found here; which were found and which not is said. Nothing is uploaded.
"""

import argparse
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import venv
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
COPIED = ("src", "pyproject.toml", "README.md", "LICENSE", "NOTICE", "CITATION.cff", "SECURITY.md", "CHANGELOG.md", "MANIFEST.in")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
TRIED = ["methods"]  # of the command line, in the installed package


def ran(command: list[str | Path], **options) -> str:
    """The output of a command that must succeed."""
    done = subprocess.run([str(word) for word in command], text=True, stdout=subprocess.PIPE, **options)
    if done.returncode:
        sys.exit(f"{' '.join(map(str, command))} ended with code {done.returncode}\n{done.stdout}")
    return done.stdout


def tool_python(folder: Path) -> Path:
    """An environment with what builds and installs."""
    venv.create(folder, with_pip=True)
    python = _python(folder)
    ran([python, "-m", "pip", "install", "-q", "--disable-pip-version-check", *PROJECT["build-system"]["requires"], "uv", "pipx"])
    return python


def built(folder: Path, python: Path) -> dict[str, Path]:
    """ "sdist" and "wheel", built from a clean copy; the wheel is made of what the sdist holds."""
    source, out = folder / "source", folder / "out"
    source.mkdir(parents=True)
    out.mkdir()
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in COPIED:
        shutil.copytree(ROOT / name, source / name, ignore=ignored) if (ROOT / name).is_dir() else shutil.copy2(ROOT / name, source)
    stamp = subprocess.run(["git", "log", "-1", "--format=%ct"], cwd=ROOT, capture_output=True, text=True).stdout.strip() or "1700000000"
    for path in (source, *source.rglob("*")):  # times of files are written into the sdist
        os.utime(path, (int(stamp), int(stamp)))
        path.chmod(0o755 if path.is_dir() else 0o644)
    environment = os.environ | {"SOURCE_DATE_EPOCH": stamp}
    build = "import sys; from setuptools import build_meta as b; print(b.build_{}(sys.argv[1]))"
    ran([python, "-c", build.format("sdist"), out], cwd=source, env=environment, stderr=subprocess.DEVNULL)
    (sdist,) = out.glob("*.tar.gz")
    _same_every_time(sdist, int(stamp))
    unpacked = folder / "unpacked"
    shutil.unpack_archive(sdist, unpacked, filter="data")
    (inside,) = unpacked.iterdir()
    ran([python, "-c", build.format("wheel"), out], cwd=inside, env=environment, stderr=subprocess.DEVNULL)
    (wheel,) = out.glob("*.whl")
    return {"sdist": sdist, "wheel": wheel}


def _same_every_time(sdist: Path, stamp: int) -> None:
    """setuptools writes the time and the user into the archive; they become those of the commit and nobody's."""
    import gzip
    import io
    import tarfile

    plain = io.BytesIO()
    with tarfile.open(sdist) as old, tarfile.open(fileobj=plain, mode="w", format=tarfile.PAX_FORMAT) as new:
        for member in sorted(old.getmembers(), key=lambda m: m.name):
            member.uid = member.gid = 0
            member.uname = member.gname = ""
            member.mtime, member.pax_headers = stamp, {}
            new.addfile(member, old.extractfile(member) if member.isfile() else None)
    with sdist.open("wb") as file, gzip.GzipFile("", "wb", 9, file, mtime=stamp) as packed:
        packed.write(plain.getvalue())


def digests(files: dict[str, Path]) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files.values()}


def pythons() -> Iterator[tuple[str, Path | None]]:
    """The versions that `requires-python` allows, and an interpreter of each, or None."""
    low, high = (int(n) for n in re.fullmatch(r">=3\.(\d+),<3\.(\d+)", PROJECT["project"]["requires-python"]).groups())  # pyrefly: ignore[missing-attribute]
    for minor in range(low, high):
        version = f"3.{minor}"
        places = [shutil.which(f"python{version}"), *sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))]
        yield version, next((Path(p) for p in places if p and _is(Path(p), version)), None)


def _is(python: Path, version: str) -> bool:
    if version == f"{sys.version_info.major}.{sys.version_info.minor}" and python.name.startswith("python"):
        python = Path(sys.executable)
    code = "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"
    done = subprocess.run([str(python), "-c", code], capture_output=True, text=True)
    return done.returncode == 0 and done.stdout.strip() == version


def _python(place: Path) -> Path:
    return place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def installed(how: str, python: Path, package: Path, folder: Path, tools: Path) -> None:
    """Install the package with pip, uv or pipx into a folder of its own, and call its command."""
    folder.mkdir(parents=True)
    constraints = ROOT / "constraints.txt"
    script = "Scripts/plantfit.exe" if os.name == "nt" else "bin/plantfit"
    place = folder / "environment"
    if how == "pip":
        ran([python, "-m", "venv", place])
        ran([_python(place), "-m", "pip", "install", "-q", "--disable-pip-version-check", "--constraint", constraints, package])
    elif how == "uv":
        ran([tools, "-m", "uv", "venv", "-q", "--python", python, place])
        ran([tools, "-m", "uv", "pip", "install", "-q", "--python", _python(place), "--constraint", constraints, package])
    else:
        homes = {"PIPX_HOME": str(folder / "home"), "PIPX_BIN_DIR": str(folder / "environment" / "bin"), "USE_EMOJI": "0"}
        words = [tools, "-m", "pipx", "install", "-q", "--python", python, f"--pip-args=--constraint {constraints}", package]
        ran(words, env=os.environ | homes)
    ran([place / script, *TRIED], cwd=folder)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the wheel with pip on this Python alone")
    parser.add_argument("--keep", type=Path, help="a folder for what was built")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tools = tool_python(folder / "tools")
        first, second = built(folder / "one", tools), built(folder / "two", tools)
        if digests(first) != digests(second):
            sys.exit(f"Two builds differ: {digests(first)}, {digests(second)}")
        for file, digest in digests(first).items():
            print(digest, file, flush=True)
        if given.keep:
            given.keep.mkdir(parents=True, exist_ok=True)
            for path in first.values():
                shutil.copy2(path, given.keep)
        for version, python in [(sys.version.split()[0], Path(sys.executable))] if given.quick else pythons():
            if python is None:
                print(f"Python {version}: not found here, not tried", flush=True)
                continue
            for how in ("pip",) if given.quick else ("pip", "uv", "pipx"):
                for kind in ("wheel",) if given.quick else ("wheel", "sdist"):
                    installed(how, python, first[kind], folder / f"{version}-{how}-{kind}", tools)
                    print(f"Python {version}: {kind} installed with {how}, `plantfit {' '.join(TRIED)}` runs", flush=True)
                    shutil.rmtree(folder / f"{version}-{how}-{kind}")
    print("Alike in two builds. Nothing was uploaded.")


if __name__ == "__main__":
    main()
