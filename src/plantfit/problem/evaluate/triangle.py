"""Many rows of a least-squares problem in few: the triangle of a QR decomposition.

By numpy, not inside a compiled program: jax (0.10) runs batches of QR on the pool of threads that the
program itself runs on, and two of them at once wait for each other for ever.
"""

import numpy as np
import scipy  # scipy.linalg is loaded at its first use

ROWS = 256  # of the pieces that are taken in one after the other, so that they stay in the cache
PANEL = 8  # columns that are reflected together
TINY = 1e-200  # below it numbers only slow the arithmetic down: their squares are not even denormal


def triangle(rows: np.ndarray, beside: np.ndarray | None = None) -> np.ndarray:
    """R (min(m, n), n) of `rows` (m, n) with R'R = rows'rows; rows may be few, columns may be zero. NaN and infinity
    give NaN.

    `beside` (m,) is one more column, the last.
    """
    m, n = len(rows), rows.shape[1] + (beside is not None)
    if m <= 2 * ROWS or not 0 < n <= ROWS // 4:
        whole = rows if beside is None else np.column_stack([rows, beside])
        found = (
            np.linalg.qr(_settled(whole), mode="r") if np.all(np.isfinite(whole)) else np.full((min(m, n), n), np.nan)
        )
    else:
        found = _piece_by_piece(rows, beside, m, n)
    found = np.asarray(found)
    return found if np.all(np.isfinite(found)) else np.full(found.shape, np.nan)


def _piece_by_piece(rows: np.ndarray, beside: np.ndarray | None, m: int, n: int) -> np.ndarray:
    taken_in, width = scipy.linalg.lapack.dtpqrt, rows.shape[1]
    found, panel = np.zeros((n, n), order="F"), min(PANEL, n)
    work, size, tiny = (np.empty((ROWS, n), dtype, order="F") for dtype in (float, float, bool))
    for first in range(0, m, ROWS):
        count = min(ROWS, m - first)
        if count < ROWS:
            work, size, tiny = (np.empty((count, n), dtype, order="F") for dtype in (float, float, bool))
        work[:, :width] = rows[first : first + count]
        if beside is not None:
            work[:, width] = beside[first : first + count]
        np.less(np.abs(work, out=size), TINY, out=tiny)
        np.copyto(work, 0.0, where=tiny)
        # the QR decomposition of a triangle on top of more rows; what lies below the triangle stays zero
        found, _, _, _ = taken_in(0, panel, found, work, overwrite_a=True, overwrite_b=True)
    return found


def _settled(rows: np.ndarray) -> np.ndarray:
    return np.where(np.abs(rows) < TINY, 0.0, rows)


def compressed(
    blocks: list[tuple[np.ndarray, np.ndarray, np.ndarray]], dimension: int
) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (k,) and derivatives (k, d) with the same mean square, gradient and Gauss-Newton matrix as those of
    `blocks`.

    A block is residuals (m,), derivatives (m, q) and the q coordinates that they are by; k is about q + 1 for each
    block.
    """
    r, jacobian = [], []
    for residuals, derivatives, own in blocks:
        small = triangle(derivatives, residuals)
        r.append(small[:, -1])
        jacobian.append(np.zeros((len(small), dimension)))
        jacobian[-1][:, own] = small[:, :-1]
    factor = np.sqrt(sum(map(len, r)) / sum(len(b[0]) for b in blocks))
    return factor * np.concatenate(r), factor * np.concatenate(jacobian)
