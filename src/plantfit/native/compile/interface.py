"""Whether the jaxlib of this process serves the interface that native loops are written for; asked once, before the
first loop."""

import ctypes
from functools import cache
from importlib.metadata import version

import plantfit.runtime  # noqa: F401
from plantfit.native.compile import ffi_handler
from plantfit.native.compile.compilation import address_of, engine_of, key_of
from plantfit.native.compile.processor import available

# isort: split
import numpy as np

import jax

PROBE = "plantfit_native_probe"


@cache
def refusal() -> str | None:
    """None where native loops can be called, else one sentence that says why they cannot.

    A function of the interface's version `VERSION` is registered, which XLA refuses where it does not serve that
    version, and called, to compare the sizes of the structs that it is given with those that it knows.
    """
    what = f"Native loops do not run with jaxlib {version('jaxlib')}"
    then = (
        "loops run as XLA scans, which gives the same answers to rounding but takes longer; see README.md for "
        "versions of jax that fit."
    )
    major, minor = ffi_handler.VERSION
    try:
        seen = _sizes_seen()
    except Exception:  # its type changed from version to version of jaxlib
        return f"{what} (XLA does not serve version {major}.{minor} of its interface for foreign functions); {then}"
    if seen != ffi_handler.SIZES:
        return f"{what} (its structs have the sizes {list(seen)}, and {list(ffi_handler.SIZES)} are known); {then}"
    return None


def engine() -> str:
    """What runs the loops over time in this process: "native" or "scan". Their bits differ."""
    return "native" if available() and refusal() is None else "scan"


def _sizes_seen() -> tuple[int, ...]:
    from plantfit.native.primitive import capsule

    text = ffi_handler.size_probe()
    key = key_of(text)
    address = address_of(text, key, ())
    jax.ffi.register_ffi_target(PROBE, capsule(address), platform="cpu")
    called = jax.ffi.ffi_call(PROBE, [jax.ShapeDtypeStruct((1,), np.float64)], has_side_effect=True)
    with jax.ensure_compile_time_eval(), jax.default_device(jax.devices("cpu")[0]):
        jax.block_until_ready(jax.jit(called)(np.zeros(1)))
    return tuple(
        (ctypes.c_int64 * len(ffi_handler.SIZES)).from_address(engine_of(key).get_global_value_address("seen"))
    )
