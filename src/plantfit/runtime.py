"""How jax runs under plantfit: float64, one thread, a compilation cache that outlives the process.

Import this module before jax. One XLA thread and one BLAS thread, because reductions change their
last bits with the number of threads; cores are used by that many workers instead.
"""

import os
from pathlib import Path

_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


def cache_folder() -> Path:
    """The user's cache folder for plantfit (`PLANTFIT_CACHE`, else `XDG_CACHE_HOME`, else ~/.cache)."""
    own = os.environ.get("PLANTFIT_CACHE")
    if own:
        return Path(own)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "plantfit"


os.environ["NPROC"] = "1"  # the size of XLA's pool of threads on a CPU; no flag has it (xla/pjrt/utils.cc)
if "xla_cpu_multi_thread_eigen" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = (os.environ.get("XLA_FLAGS", "") + " " + _FLAGS).strip()

import scipy.linalg  # noqa: F401  (loads the BLAS that jax uses, so that it can be limited)
from threadpoolctl import threadpool_limits

import jax

threadpool_limits(1, user_api="blas")
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_compilation_cache_dir", str(cache_folder() / "xla"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
