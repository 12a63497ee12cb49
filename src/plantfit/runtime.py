"""How jax runs under plantfit: float64, one thread, a compilation cache that outlives the process.

Import this module before jax computes. One XLA thread and one BLAS thread, because reductions change their
last bits with the number of threads; cores are used by that many workers instead.

What stays in a process that imports it: float64 as jax's default, NPROC and XLA_FLAGS, by which XLA gets a pool of one
thread where jax had not computed before, OPENBLAS_NUM_THREADS and the limit of one thread for BLAS, and jax's
compilation cache where none was chosen. XLA reads the variables when its client is made; making it here would let them
go, but then a process that is forked after the import could not compute.
"""

import os
from collections.abc import Callable
from functools import cache, wraps
from typing import Any

import jaxlib.version

from plantfit.folders import code_folder

_FLAGS = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
# XLA compiles a program in 32 parts for 32 threads. With one thread that is up to a tenth more work, on some machines
# up to a half, for the same machine code (`python -m benchmarks.compile_time`, column pl/pa). An XLA that does not know
# a flag ends the process, so that it is set where it was tried.
_TRIED, _WHOLE = ("0.10.",), "--xla_cpu_parallel_codegen_split_count=1"
# What XLA emits for many small arrays, as those of an optimizer, is as fast without fused loops and expensive passes,
# and is compiled in an eighth to two thirds of the time (`python -m benchmarks.compile_time`). Loops over samples
# that run in XLA, as filters and controllers do, are not: up to twice as slow.
QUICK: dict[str, Any] = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}

os.environ["NPROC"] = "1"  # the size of XLA's pool of threads on a CPU; no flag has it (xla/pjrt/utils.cc)
if "xla_cpu_multi_thread_eigen" not in os.environ.get("XLA_FLAGS", ""):
    _whole = f" {_WHOLE}" if jaxlib.version.__version__.startswith(_TRIED) else ""
    os.environ["XLA_FLAGS"] = (os.environ.get("XLA_FLAGS", "") + " " + _FLAGS + _whole).strip()

os.environ["OPENBLAS_NUM_THREADS"] = (
    "1"  # of scipy's BLAS, which jax uses too and loads later: it takes a fifth of the time of jax
)
import numpy  # noqa: F401  (loads its BLAS, so that it can be limited)
from threadpoolctl import threadpool_limits

import jax
from jax.core import Tracer

threadpool_limits(1, user_api="blas")
jax.config.update("jax_enable_x64", True)
if jax.config.values["jax_compilation_cache_dir"] is None and (_xla := code_folder("xla")) is not None:
    jax.config.update("jax_compilation_cache_dir", str(_xla))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


@cache
def compiler_options() -> dict[str, Any]:
    """`QUICK`, or nothing where this XLA does not know it."""
    if not jaxlib.version.__version__.startswith(_TRIED):
        try:
            jax.jit(lambda: 0.0).lower().compile(dict(QUICK))
        except Exception:  # another XLA
            return {}
    return dict(QUICK)


def jit(function: Callable, **options: Any) -> Any:
    """`jax.jit`, compiled by `QUICK`; called with what is traced it is a part of that program."""
    alone, part = jax.jit(function, compiler_options=compiler_options(), **options), jax.jit(function, **options)

    @wraps(function)
    def called(*args: Any, **named: Any) -> Any:
        traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((args, named)))
        return (part if traced else alone)(*args, **named)

    return called
