"""What a command says when it fails: one sentence; for an error inside plantfit also where the log with its
traceback lies."""

import os
import platform
import sys
import tempfile
import time
import traceback
from pathlib import Path

LONGEST = 1500  # characters of a sentence: files are not read out on the screen
INSIDE = 70  # EX_SOFTWARE of sysexits.h


def shortened(text: str, longest: int = LONGEST) -> str:
    """A text that is too long without its middle."""
    if len(text) <= longest:
        return text
    return f"{text[: longest * 2 // 3]} [... {len(text) - longest} characters ...] {text[-longest // 3 :]}"


def inside(error: BaseException) -> str:
    """The sentence for an error that is not meant for users; writes the log that it names."""
    from plantfit.study.store.addresses import VARIABLE, concealed

    addresses = [*(a for a in sys.argv[1:] if "://" in a), os.environ.get(VARIABLE, "")]
    first = (str(error).splitlines() or [""])[0].strip()
    what = shortened(concealed(f"{type(error).__name__}: {first}" if first else type(error).__name__, *addresses), 300)
    log = _written(concealed(_text(error), *addresses))
    more = f"send {log} with a report of it, please" if log else "no log of it could be written"
    return (
        f"An error inside plantfit ended this command ({what}); what was finished is kept. It is a fault of "
        f"plantfit: {more}."
    )


def _text(error: BaseException) -> str:
    from importlib.metadata import PackageNotFoundError, version

    packages = []
    for name in ("plantfit", "jax", "jaxlib", "numpy", "scipy", "polars", "pydantic", "sqlalchemy"):
        try:
            packages.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            packages.append(f"{name} not installed")
    facts = f"Python {platform.python_version()}, {platform.platform()}; {', '.join(packages)}"
    return "\n".join([f"plantfit {' '.join(sys.argv[1:])}", facts, "", *traceback.format_exception(error)])


def _written(text: str) -> Path | None:
    """Where the log lies: the cache folder, else the folder for temporary files."""
    name = f"plantfit-{time.strftime('%Y%m%d-%H%M%S')}-"
    for folder in (_cache_logs, lambda: Path(tempfile.gettempdir())):
        try:
            handle, place = tempfile.mkstemp(dir=folder(), prefix=name, suffix=".log")  # for this user alone
            with os.fdopen(handle, "w", encoding="utf-8", errors="backslashreplace") as file:
                file.write(text)
            return Path(place)
        except (OSError, RuntimeError, ImportError):
            continue
    return None


def _cache_logs() -> Path:
    from plantfit.folders import cache_folder

    folder = cache_folder().absolute() / "logs"
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    return folder
