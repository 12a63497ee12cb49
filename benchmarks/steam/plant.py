"""The steam chamber of one opening in plain floats, for solvers that call back into Python."""

from collections.abc import Callable, Sequence

import numpy as np

TOP, SEGMENTS = 20.0, 9  # bar; equal pieces of the tables on [0, TOP]

Rate = Callable[[float, Sequence[float]], list[float]]
Jacobian = Callable[[float, Sequence[float]], list[list[float]]]


def plant(row: np.ndarray, opening: float) -> tuple[Rate, Jacobian]:
    """d(x1, x2)/dt and its derivative by (x1, x2) with the delayed input on; row (31,) = k[10], A1[10], A2[10], Td."""
    k, a1, a2 = (_pieces(table) for table in np.split(row[:30], 3))

    def look(y: float) -> tuple[int, float]:
        y = min(max(y, 0.0), TOP)
        return min(int(y * (SEGMENTS / TOP)), SEGMENTS - 1), y

    def rate(_: float, x: Sequence[float]) -> list[float]:
        j, y = look(x[0])
        force = (k[j][0] + k[j][1] * y) * opening - x[0] - (a1[j][0] + a1[j][1] * y) * x[1]
        return [x[1], force / (a2[j][0] + a2[j][1] * y)]

    def jacobian(_: float, x: Sequence[float]) -> list[list[float]]:
        j, y = look(x[0])
        on = 1.0 if y == x[0] else 0.0  # the tables are flat outside [0, TOP]
        damping, inertia = a1[j][0] + a1[j][1] * y, a2[j][0] + a2[j][1] * y
        force = (k[j][0] + k[j][1] * y) * opening - x[0] - damping * x[1]
        slope = on * (k[j][1] * opening - a1[j][1] * x[1] - a2[j][1] * force / inertia) - 1.0
        return [[0.0, 1.0], [slope / inertia, -damping / inertia]]

    return rate, jacobian


def _pieces(table: np.ndarray) -> list[tuple[float, float]]:
    """(value at 0, slope) of each straight piece, as Python floats."""
    slope = np.diff(table) * (SEGMENTS / TOP)
    start = table[:-1] - slope * (TOP / SEGMENTS) * np.arange(SEGMENTS)
    return list(zip(start.tolist(), slope.tolist(), strict=True))
