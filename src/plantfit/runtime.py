"""How jax runs under plantfit: float64, one thread, a compilation cache that outlives the process.

Import this module before jax. One XLA thread and one BLAS thread, because reductions change their
last bits with the number of threads; cores are used by that many workers instead.
"""

import os
import stat
import warnings
from functools import cache
from pathlib import Path

from plantfit.errors import PlantfitWarning

_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


def cache_folder() -> Path:
    """The user's cache folder for plantfit (`PLANTFIT_CACHE`, else `XDG_CACHE_HOME`, else ~/.cache)."""
    own = os.environ.get("PLANTFIT_CACHE")
    if own:
        return Path(own)
    place = os.environ.get("XDG_CACHE_HOME")
    return Path(place or os.path.expanduser("~/.cache")) / "plantfit"  # Path.home() raises where there is none


@cache
def code_folder(kind: str) -> Path | None:
    """The folder of compiled code of a kind, made for this user alone; None where there can be none or others can write to it.

    Whoever writes to it runs code as this user, so one that is not safe is not used, and that is said.
    """
    whole = cache_folder().absolute()
    folder = whole / kind
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        open_to_others = next((f for f in (whole, folder) if not _is_own(f)), None)
    except OSError:
        return None  # a read-only home costs time only
    if open_to_others is None:
        return folder
    said_once(
        f"The cache folder {open_to_others} can be written by other users, so no compiled code is taken from it or kept in it; "
        f"make it yours alone with `chmod go-w {open_to_others}`, or set PLANTFIT_CACHE to another folder."
    )
    return None


def said_once(sentence: str) -> None:
    """Warn with a sentence, once in this process."""
    if sentence not in _SAID:
        _SAID.add(sentence)
        warnings.warn(sentence, PlantfitWarning, stacklevel=2)


_SAID: set[str] = set()


def _is_own(folder: Path) -> bool:
    """Whether only this user (and root) can write to a folder. On Windows the rights of the user's folder say so."""
    if os.name != "posix":
        return True
    facts = folder.stat()
    return facts.st_uid in (0, os.getuid()) and not facts.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


os.environ["NPROC"] = "1"  # the size of XLA's pool of threads on a CPU; no flag has it (xla/pjrt/utils.cc)
if "xla_cpu_multi_thread_eigen" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = (os.environ.get("XLA_FLAGS", "") + " " + _FLAGS).strip()

import scipy.linalg  # noqa: F401  (loads the BLAS that jax uses, so that it can be limited)
from threadpoolctl import threadpool_limits

import jax

threadpool_limits(1, user_api="blas")
jax.config.update("jax_enable_x64", True)
if (_xla := code_folder("xla")) is not None:
    jax.config.update("jax_compilation_cache_dir", str(_xla))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
