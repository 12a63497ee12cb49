"""The error for loops without a native form."""

from plantfit.errors import PlantfitError


class NativeUnsupported(PlantfitError):
    """A loop body uses something that has no native form; `what` is the primitive or the reason."""

    exit_code = 9

    def __init__(self, what: str):
        self.what = what
        super().__init__(
            f"Native loops cannot do {what!r}; run this loop with "
            "jax.lax.scan instead (native_scan(..., fallback=True))."
        )


class StackExceeded(NativeUnsupported):
    """The arrays of a loop are larger than the stack allows; those of a narrower block may fit."""
