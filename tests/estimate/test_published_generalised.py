"""Generalised least squares against a published analysis: follicles of mares, Pierson and Ginther, Anim. Reprod. Sci.
14 (1987) 219, with noise of first order within each mare, restricted likelihood.

Figures: Pinheiro and Bates, Mixed-Effects Models in S and S-PLUS (2000), and the regression test missing.Rout of the R
package nlme, which leaves two rows out.
"""

import numpy as np
import pytest

from plantfit.problem.correlated.noise import Noise, Rows, _largest, _sized, in_basis

# by mare: samples in a cycle, and the counts from three samples before its first ovulation on
MARES = {
    1: (22, "20 15 19 16 13 10 12 14 13 20 22 15 18 17 14 18 14 16 17 18 18 17 14 12 12 14 10 11 16"),
    2: (20, "6 6 8 7 16 10 13 9 7 6 8 8 6 8 7 9 6 4 5 8 11 13 10 6 7 6 5"),
    3: (19, "13 11 10 6 8 6 9 9 10 8 14 13 14 16 20 21 25 23 19 22 16 21 19 20 17 24"),
    4: (22, "9 9 7 6 7 6 1 1 1 5 6 3 5 3 6 8 6 5 6 8 11 14 8 9 10 7 7 6 11"),
    5: (22, "10 12 12 17 9 10 3 12 13 9 4 7 4 12 14 12 15 17 15 13 18 19 13 9 12 8 10 5 14"),
    6: (22, "16 17 13 17 15 9 8 5 9 8 8 13 14 13 14 14 11 17 21 21 21 20 17 18 22 10 11 11 12"),
    7: (20, "18 13 14 12 11 8 5 8 10 11 10 12 10 9 12 14 16 13 11 13 13 11 11 8 14 4 7"),
    8: (24, "13 9 15 15 12 8 10 6 9 8 10 6 8 13 12 12 15 21 25 21 21 24 20 20 18 20 20 19 12 7 8"),
    9: (18, "10 14 12 10 7 12 10 8 10 15 15 12 19 15 16 15 17 14 16 15 11 10 7 4 8"),
    10: (22, "11 16 15 12 11 6 11 12 11 16 15 11 7 14 20 22 23 21 21 23 22 22 17 17 17 17 14 12 11"),
    11: (20, "9 8 8 8 8 6 7 8 10 10 14 13 8 8 8 9 16 12 10 12 12 9 6 9 7 5 5"),
}


@pytest.mark.parametrize(
    ("left_out", "phi", "values", "errors", "size"),
    [
        ((), 0.7532, (12.2164, -2.7747, -0.8996), None, 4.6162),
        (((1, 0), (10, 19)), 0.75, (12.13, -2.68, -0.86), (0.657, 0.644, 0.690), 4.58),
    ],
)
def test_follicles_of_mares_are_those_of_nlme(left_out, phi, values, errors, size):
    times, counts, lengths = [], [], []
    for mare, (cycle, text) in MARES.items():
        y = np.array(text.split(), dtype=float)
        kept = [k for k in range(len(y)) if (mare, k) not in left_out]
        times.append(((np.arange(len(y)) - 3) / cycle)[kept])
        counts.append(y[kept])
        lengths.append(len(kept))
    t, y = 2.0 * np.pi * np.concatenate(times), np.concatenate(counts)
    slopes = np.c_[np.ones(len(t)), np.sin(t), np.cos(t)]
    columns, rows = in_basis(np.c_[y, slopes]), Rows("follicles", tuple(lengths))
    noise = _sized(_largest(Noise(np.zeros(1), 0.0, None, 1.0, rows, None), columns, np.zeros(1))[1], columns)
    gram, _ = noise.products(np.c_[y, slopes])
    covariance = np.linalg.inv(gram[1:, 1:])
    assert noise.correlation == pytest.approx(phi, abs=6e-4)
    np.testing.assert_allclose(covariance @ gram[1:, 0], values, atol=5e-3)
    if errors is not None:
        np.testing.assert_allclose(np.sqrt(np.diag(covariance) * noise.variance), errors, atol=6e-4)
    assert noise.deviation == pytest.approx(size, abs=1e-3)
