"""How jax runs under plantfit: float64, one thread, a compilation cache that outlives the process.

Import this module before jax computes. One XLA thread and one BLAS thread, because reductions change their
last bits with the number of threads; cores are used by that many workers instead.

What stays in a process that imports it: float64 as jax's default, XLA's pool of one thread where jax had not computed before,
BLAS limited to one thread, and jax's compilation cache where none was chosen. Environment variables are as they were.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager

from plantfit.folders import code_folder

_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"


@contextmanager
def _environment(**given: str) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in given}
    os.environ.update(given)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


import scipy.linalg  # noqa: F401  (loads the BLAS that jax uses, so that it can be limited)
from threadpoolctl import threadpool_limits

import jax

_own = os.environ.get("XLA_FLAGS", "")
# XLA reads both once, when its client is made; the size of its pool of threads on a CPU has no flag (xla/pjrt/utils.cc)
with _environment(NPROC="1", XLA_FLAGS=_own if "xla_cpu_multi_thread_eigen" in _own else f"{_own} {_FLAGS}".strip()):
    jax.devices("cpu")
threadpool_limits(1, user_api="blas")
jax.config.update("jax_enable_x64", True)
if jax.config.jax_compilation_cache_dir is None and (_xla := code_folder("xla")) is not None:
    jax.config.update("jax_compilation_cache_dir", str(_xla))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
