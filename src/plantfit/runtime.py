"""How jax runs under plantfit: float64, one thread, a compilation cache that outlives the process.

Import this module before jax computes. One XLA thread and one BLAS thread, because reductions change their
last bits with the number of threads; cores are used by that many workers instead.

What stays in a process that imports it: float64 as jax's default, NPROC and XLA_FLAGS, by which XLA gets a pool of one
thread where jax had not computed before, OPENBLAS_NUM_THREADS and the limit of one thread for BLAS, and jax's
compilation cache where none was chosen. XLA reads the variables when its client is made; making it here would let them
go, but then a process that is forked after the import could not compute.
"""

import os

from plantfit.folders import code_folder

_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


os.environ["NPROC"] = "1"  # the size of XLA's pool of threads on a CPU; no flag has it (xla/pjrt/utils.cc)
if "xla_cpu_multi_thread_eigen" not in os.environ.get("XLA_FLAGS", ""):
    os.environ["XLA_FLAGS"] = (os.environ.get("XLA_FLAGS", "") + " " + _FLAGS).strip()

os.environ["OPENBLAS_NUM_THREADS"] = (
    "1"  # of scipy's BLAS, which jax uses too and loads later: it takes a fifth of the time of jax
)
import numpy  # noqa: F401  (loads its BLAS, so that it can be limited)
from threadpoolctl import threadpool_limits

import jax

threadpool_limits(1, user_api="blas")
jax.config.update("jax_enable_x64", True)
if jax.config.values["jax_compilation_cache_dir"] is None and (_xla := code_folder("xla")) is not None:
    jax.config.update("jax_compilation_cache_dir", str(_xla))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
