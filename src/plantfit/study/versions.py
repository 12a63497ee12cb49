"""What a result was computed with: bits are promised for equal versions on an equal CPU."""

import importlib.metadata
import platform
from pathlib import Path

# raised whenever a search takes other steps than before; a study is finished by the searches that it was begun with
SEARCHES = 2
PACKAGES = ("plantfit", "jax", "jaxlib", "numpy", "scipy")


def versions() -> dict[str, str]:
    """Versions of Python, plantfit, its searches, jax, jaxlib, numpy and scipy, what runs loops over time, and the
    operating system."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    from plantfit.native.compile.interface import engine  # imports jax

    return found | {
        "searches": str(SEARCHES),
        "engine": engine(),
        "system": f"{platform.system()} {platform.machine()}",
    }


def cpu_model(cpuinfo: Path = Path("/proc/cpuinfo")) -> str:
    """The CPU as it calls itself, else the architecture."""
    try:
        lines = cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    for line in lines:
        key, _, value = line.partition(":")
        if key.strip() == "model name" and value.strip():
            return value.strip()
    return platform.processor() or platform.machine() or "unknown"
