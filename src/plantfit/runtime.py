"""How jax runs under plantfit: float64, one thread, a compilation cache that outlives the process.

Import this module before jax. One XLA thread and one BLAS thread, because reductions change their
last bits with the number of threads; cores are used by that many workers instead.
"""

import os

from plantfit.folders import code_folder

_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


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
