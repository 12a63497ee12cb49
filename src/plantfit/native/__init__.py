"""Loops over scalars as native SIMD code over a batch."""

from plantfit.native.machine import available
from plantfit.native.scan import native_scan, supported
from plantfit.native.unsupported import NativeUnsupported

__all__ = ["NativeUnsupported", "available", "native_scan", "supported"]
