"""C compiled at run time into the user's cache folder; a missing compiler is fetched through apt when that is
allowed."""

import hashlib
import os
import platform
import shutil
import subprocess
import sysconfig
from functools import cache
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

from plantfit.folders import cache_folder

FLAGS = ("-O3", "-march=native", "-std=gnu11", "-fPIC", "-shared", "-Wno-psabi")


@cache
def compiler() -> str | None:
    """The C compiler's path, or None; as root on Debian it tries `apt-get install gcc` once."""
    found = shutil.which("gcc") or shutil.which("cc")
    if found is None and hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("apt-get"):
        subprocess.run(["apt-get", "install", "-y", "-qq", "gcc", "libc6-dev"], capture_output=True, check=False)
        found = shutil.which("gcc")
    return found


def build(source: Path, *flags: str) -> Path | None:
    """The shared library of a C file, compiled unless the cache has it; None when there is no compiler."""
    cc = compiler()
    if cc is None:
        return None
    recipe = "\n".join([source.read_text(), *FLAGS, *flags, cc, _cpu()])
    library = cache_folder() / "benchmarks" / f"{source.stem}-{hashlib.sha256(recipe.encode()).hexdigest()[:16]}.so"
    if not library.exists():
        library.parent.mkdir(parents=True, exist_ok=True)
        part = library.with_suffix(f".{os.getpid()}")
        subprocess.run([cc, *FLAGS, *flags, str(source), "-o", str(part), "-lm"], check=True)
        os.replace(part, library)
    return library


def extension(source: Path) -> Any | None:
    """A Python extension module from one C file; None without a compiler or without Python's headers."""
    headers = sysconfig.get_path("include")
    if not Path(headers, "Python.h").exists():
        return None
    library = build(source, f"-I{headers}", f"-I{np.get_include()}")
    if library is None:
        return None
    loader = ExtensionFileLoader(source.stem, str(library))
    spec = spec_from_file_location(source.stem, library, loader=loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


def _cpu() -> str:
    """What -march=native stands for; a cache folder may be shared by several machines."""
    info = Path("/proc/cpuinfo")
    if not info.exists():
        return platform.processor()
    return "".join(line for line in info.read_text().splitlines()[:30] if line.startswith(("model name", "flags")))
