"""Loops over scalars as SIMD machine code over a batch: see "How native loops are made" in docs/architecture.md."""

from plantfit.native.compile.processor import available
from plantfit.native.scan import native_scan, supported
from plantfit.native.unsupported import NativeUnsupported

__all__ = ["NativeUnsupported", "available", "native_scan", "supported"]
