"""Many rows of a least-squares problem in few: the triangle of a QR decomposition.

By numpy, not inside a compiled program: jax (0.10) runs batches of QR on the pool of threads that the
program itself runs on, and two of them at once wait for each other for ever.
"""

import numpy as np
import scipy  # scipy.linalg is loaded at its first use

ROWS = 256  # of the pieces that are taken in one after the other, so that they stay in the cache
PANEL = 8  # columns that are reflected together
TINY = 1e-200  # below it numbers only slow the arithmetic down: their squares are not even denormal


def triangle(rows: np.ndarray) -> np.ndarray:
    """R (min(m, n), n) of `rows` (m, n) with R'R = rows'rows; rows may be few, columns may be zero. NaN and infinity give NaN."""
    m, n = rows.shape
    if m <= 2 * ROWS or not 0 < n <= ROWS // 4:
        found = np.linalg.qr(_settled(rows), mode="r") if np.all(np.isfinite(rows)) else np.full((min(m, n), n), np.nan)
    else:
        found = np.zeros((n, n), order="F")
        for first in range(0, m, ROWS):
            piece = np.asfortranarray(_settled(rows[first : first + ROWS]))
            # the QR decomposition of a triangle on top of more rows
            found, _, _, _ = scipy.linalg.lapack.dtpqrt(0, min(PANEL, n), found, piece, overwrite_a=True, overwrite_b=True)
        found = np.triu(found)
    found = np.asarray(found)
    return found if np.all(np.isfinite(found)) else np.full(found.shape, np.nan)


def _settled(rows: np.ndarray) -> np.ndarray:
    return np.where(np.abs(rows) < TINY, 0.0, rows)


def compressed(blocks: list[tuple[np.ndarray, np.ndarray, np.ndarray]], dimension: int) -> tuple[np.ndarray, np.ndarray]:
    """Residuals (k,) and derivatives (k, d) with the same mean square, gradient and Gauss-Newton matrix as those of `blocks`.

    A block is residuals (m,), derivatives (m, q) and the q coordinates that they are by; k is about q + 1 for each block.
    """
    r, jacobian = [], []
    for residuals, derivatives, own in blocks:
        small = triangle(np.column_stack([derivatives, residuals]))
        r.append(small[:, -1])
        jacobian.append(np.zeros((len(small), dimension)))
        jacobian[-1][:, own] = small[:, :-1]
    factor = np.sqrt(sum(map(len, r)) / sum(len(b[0]) for b in blocks))
    return factor * np.concatenate(r), factor * np.concatenate(jacobian)
