"""What a search may ask of a problem: one protocol, whatever the records are and however they are computed."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np


class Evaluator(Protocol):
    """Pure functions of (z, arguments), z a point of the unit cube (d,) and `zs` several (n, d); jax compiles them.

    `BatchedRecords` takes records that move through one compiled loop, `RecordByRecord` one record after another,
    `MovingAndSteady` some each way, and `Smoothed` adds the bends of tables to any of them. With m rows the cost is the
    mean of their squares.

    A block is a part of the rows that depends on some coordinates only: `local` gives these for every block,
    `recordings` which recordings it holds, in the order of its rows.
    """

    @property
    def local(self) -> Sequence[np.ndarray] | np.ndarray: ...

    @property
    def local_dimension(self) -> int:
        """Most coordinates that the rows of one recording are derived by."""
        ...

    @property
    def recordings(self) -> Sequence[Sequence[str]]: ...

    @property
    def compiled_in(self) -> Any:
        """What the programs of the functions depend on beside predictor, space and the shapes of arguments; it can be
        pickled.

        No measured number is in it: a record with the same times, or any of the same shape, is another argument of the
        same program.
        """
        ...

    def arguments(self, data: Mapping[str, Any]) -> Any:
        """What the functions take beside z, a pytree, from `Problem.data`."""
        ...

    def costs(self, zs: Any, arguments: Any, /) -> Any:
        """Costs (n,)."""
        ...

    def values_and_gradients(self, zs: Any, arguments: Any, /) -> tuple[Any, Any]:
        """Costs (n,) and gradients (n, d)."""
        ...

    def residuals(self, z: Any, arguments: Any, /) -> Any:
        """Scaled residuals (m,), simulated minus measured; recording by recording, output by output."""
        ...

    def residuals_and_jacobian(self, z: Any, arguments: Any, /) -> tuple[Any, Any]:
        """Residuals (m,) and dense derivatives (m, d)."""
        ...

    def blocks(self, z: Any, arguments: Any, /) -> list[tuple[Any, Any]]:
        """For every block its residuals (k,) and their derivatives (k, q) by its own coordinates."""
        ...

    def only(self, arguments: Any, wanted: np.ndarray, /) -> Any:
        """Arguments for `blocks` with which the blocks that are not `wanted`, (blocks,) of bool, may be anything, to
        save their time."""
        ...
