"""The noise of one output, correlated in time and shared by samples with the same error of a sensor, by restricted
likelihood.

    noise = L^-1 (e + sqrt(shared) U u),  e and u white, L the filter of an autoregression
    (1)

The autoregression is written by its partial correlations, so that it is stationary (Barndorff-Nielsen, Schou, J.
Multivariate Anal. 3 (1973) 408, eq. 4), and begins stationary in every stretch. Its order has the least BIC.
"""

from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np
from scipy import sparse
from scipy.linalg import cho_solve, cholesky, solve_triangular
from scipy.optimize import minimize
from scipy.sparse.linalg import spsolve_triangular
from scipy.special import stdtrit

from plantfit.errors import SearchError
from plantfit.sobol import Sobol

MOST = 6  # largest order
WORSE = 2  # orders one after the other that do not lower BIC, after which none is tried
WIDEST = 3.8  # inverse hyperbolic tangent of a partial correlation: 0.999
FAINT, STRONG = -12.0, 14.0  # logarithms of the shared variance over the white one
CURVED = 0.02  # step of second differences
DRAWS, DEGREES, WIDER = 64, 5.0, 1.1  # of the noise, by Student's t a little wider than its likelihood
FEWEST = 8.0  # effective draws, below which all count the same
ROUNDED = 1e-12  # of the largest eigenvalue
RANK = 1e-8  # of the largest singular value

Form = Literal["edges in proportion", "edges", "own in proportion", "own"]


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of one output: `lengths` of its stretches of samples one after another. Of every recording, where samples
    share errors of the sensor: which error (n,) each has, numbers from 0 or NaN, and the output's size (n,) there."""

    output: str
    lengths: tuple[int, ...]
    errors: tuple[np.ndarray, ...] = ()
    sizes: tuple[np.ndarray, ...] = ()

    def unit(self, form: Form) -> float:
        """The root mean square of what the errors are multiplied by, so that what is shared compares with noise."""
        if not form.endswith("proportion"):
            return 1.0
        sizes = np.concatenate([s[np.isfinite(e)] for e, s in zip(self.errors, self.sizes, strict=True)])
        return max(float(np.sqrt(np.mean(sizes**2))), 1e-300)

    def spread(self, form: Form) -> sparse.csr_matrix:
        """What errors of unit variance, times `unit`, do to the rows (n, errors).

        `edges`: the error of a slot is the difference of those of its two edges, which it shares with its neighbours,
        and the last slot's with the first: over a turn of the disc they are nothing in the mean.
        """
        found, unit = [], self.unit(form)
        for numbers, size in zip(self.errors, self.sizes, strict=True):
            there = np.flatnonzero(np.isfinite(numbers))
            number = numbers[there].astype(int)
            shape = len(numbers), int(np.max(number, initial=0)) + 1
            times = size[there] / unit if form.endswith("proportion") else np.ones(len(there))
            own = sparse.csr_matrix((times, (there, number)), shape)
            if form.startswith("edges"):
                own = sparse.csr_matrix((times, (there, (number + 1) % shape[1])), shape) - own
            found.append(own)
        return sparse.csr_matrix(sparse.block_diag(found, format="csr"))


@dataclass(frozen=True, eq=False)
class Noise:
    """`partial` correlations (p,) of the autoregression, the `shared` variance over that of the white part, and which
    `form` it has; `variance` of the white part in the rows' unit."""

    partial: np.ndarray
    shared: float
    form: Form | None
    variance: float
    rows: Rows
    spread: sparse.csr_matrix | None

    @property
    def order(self) -> int:
        return len(self.partial)

    @property
    def correlation(self) -> float:
        """Of neighbouring samples, without what is shared."""
        return float(self.partial[0]) if len(self.partial) else 0.0

    @property
    def deviation(self) -> float:
        """Standard deviation of a sample, without what is shared."""
        return float(np.sqrt(self.variance * _predictors(self.partial)[1][0]))

    @property
    def shared_variance(self) -> float:
        """Of the errors that samples share: of shares of the output, or in the rows' unit; 0 without such."""
        return 0.0 if self.form is None else self.variance * self.shared / self.rows.unit(self.form) ** 2

    @property
    def skipped(self) -> np.ndarray | None:
        """By what share (n,) of the output the mean over all slots lies below that over samples, where edges are wrong.

        A sample that skips slots falls into a slot with a chance that grows with its length. The slot before, which it
        tells, has its late edge early and is short. So speeds are high by the variance of an edge in the mean over
        samples, in which measured values are right, and not over slots, in which the errors are nothing.
        """
        if self.form != "edges in proportion":
            return None
        found = []
        for numbers in self.rows.errors:
            count = np.max(numbers[np.isfinite(numbers)], initial=0.0) + 1.0
            ahead = np.mod(np.diff(numbers), count)
            ahead = ahead[np.isfinite(ahead)]
            skips = float(np.mean((ahead > 1.5) & (ahead < count - 1.5))) if len(ahead) else 0.0
            found.append(np.where(np.isfinite(numbers), skips, 0.0))
        return self.shared_variance * np.concatenate(found)

    @property
    def degrees(self) -> float:
        """How many independent samples the rows are worth."""
        filters, variances = _predictors(self.partial)
        adds_up = 1.0 / ((1.0 - np.sum(filters[-1])) ** 2 * variances[0])
        return float(sum(self.rows.lengths) / max(adds_up, 1.0))

    def with_(self, x: np.ndarray) -> "Noise":
        """The same at other unknowns (see `unknowns`), its variance not estimated."""
        shared = float(np.exp(x[self.order])) if self.spread is not None else 0.0
        return Noise(np.tanh(x[: self.order]), shared, self.form, self.variance, self.rows, self.spread)

    @property
    def unknowns(self) -> np.ndarray:
        """Inverse hyperbolic tangents of the partial correlations, then the logarithm of what is shared."""
        own = np.arctanh(self.partial)
        return own if self.spread is None else np.r_[own, np.log(self.shared)]

    def products(self, columns: np.ndarray) -> tuple[np.ndarray, float]:
        """columns' V^-1 columns for columns (n, k), and the log-determinant of V, V the covariance over `variance`."""
        filtered, logarithm = self._filtered()
        a = filtered @ columns
        found = a.T @ a
        if self.spread is not None:
            b, root = self._shared_part(filtered)
            c = solve_triangular(root, b.T @ a, lower=True)
            found = found - c.T @ c
            logarithm += 2.0 * float(np.sum(np.log(np.diag(root))))
        return found, logarithm

    def variance_of(self, columns: np.ndarray) -> np.ndarray:
        """Covariance (k, k) of columns' noise, for columns (n, k)."""
        filtered, _ = self._filtered()
        solved = np.asarray(spsolve_triangular(sparse.csr_matrix(filtered.T), columns, lower=False))
        found = solved.T @ solved
        if self.spread is not None:
            shared = self.spread.T @ columns
            found = found + self.shared * (shared.T @ shared)
        return self.variance * found

    def whitened(self, column: np.ndarray) -> np.ndarray:
        """A column (n,) less what is expected of its shared errors, filtered."""
        filtered, _ = self._filtered()
        a = filtered @ column
        if self.spread is None:
            return a
        b, root = self._shared_part(filtered)
        return a - b @ cho_solve((root, True), b.T @ a)

    def rooted(self, columns: np.ndarray) -> np.ndarray:
        """V^-1/2 columns for columns (n, k): rows that are independent and alike where the noise is as it is taken."""
        filtered, _ = self._filtered()
        a = filtered @ columns
        if self.spread is None:
            return a
        b = (filtered @ self.spread) * np.sqrt(self.shared)
        w, q = np.linalg.eigh((b.T @ b).toarray())
        there = w > ROUNDED * max(float(w[-1]), 1.0)
        # (1 + B B')^-1/2 = 1 - B Q ((1 - (1 + w)^-1/2)/w) Q' B' for B'B = Q w Q'
        turned = q[:, there].T @ (b.T @ a)
        return a - b @ (q[:, there] @ (((1.0 - 1.0 / np.sqrt(1.0 + w[there])) / w[there])[:, None] * turned))

    def _shared_part(self, filtered: sparse.csr_matrix) -> tuple[sparse.csr_matrix, np.ndarray]:
        """Shared errors after the filter, B (n, errors), and the lower root (errors, errors) of 1 + B'B."""
        b = (filtered @ self.spread) * np.sqrt(self.shared)
        inner = (b.T @ b).toarray()
        inner[np.diag_indices_from(inner)] += 1.0
        return b, cholesky(inner, lower=True)

    def _filtered(self) -> tuple[sparse.csr_matrix, float]:
        """L of eq. (1) as a sparse matrix, and the log-determinant of the covariance that it whitens."""
        filters, variances = _predictors(self.partial)
        p, place = self.order, np.concatenate([np.arange(n) for n in self.rows.lengths])
        order = np.minimum(place, p)
        scale, weight = 1.0 / np.sqrt(variances[order]), np.zeros((p + 1, max(p, 1)))
        for k, own in enumerate(filters):
            weight[k, :k] = own
        n, most = len(place), min(p, len(place) - 1)
        diagonals = [scale, *(-(scale * weight[order, i])[i + 1 :] for i in range(most))]
        offsets = [-i for i in range(most + 1)]
        filtered = sparse.csr_matrix(sparse.diags(diagonals, offsets, shape=(n, n), format="csr"))
        return filtered, float(np.sum(np.log(variances[order])))


def _predictors(partials: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Predictors of the orders 0 to p (Levinson, Durbin), and the variances (p + 1,) of what they leave over that of
    the last."""
    filters, variances = [np.zeros(0)], [1.0]
    for k in partials:
        last = filters[-1]
        filters.append(np.r_[last - k * last[::-1], k])
        variances.append(variances[-1] * (1.0 - k * k))
    return filters, np.array(variances) / variances[-1]


def restricted(noise: Noise, columns: np.ndarray) -> tuple[float, float]:
    """Restricted log-likelihood and variance of the white part, of columns (n, 1 + d): residuals and what parameters
    do to them, as `in_basis` gives them (Harville, J. Am. Statist. Assoc. 72 (1977) 320, eq. 5.1)."""
    gram, logarithm = noise.products(columns)
    root = cholesky(gram[1:, 1:], lower=True)
    projected = solve_triangular(root, gram[1:, 0], lower=True)
    left = len(columns) - len(root)
    variance = max(gram[0, 0] - float(projected @ projected), 1e-300) / max(left, 1)
    logarithm += 2.0 * float(np.sum(np.log(np.diag(root))))
    return -0.5 * (left * np.log(variance) + logarithm), float(variance)


def in_basis(columns: np.ndarray) -> np.ndarray:
    """The same residuals beside orthonormal columns (n, r) of the same span: what a parameter cannot tell from others
    is left out, whatever the noise is."""
    slopes = columns[:, 1:] / np.maximum(np.linalg.norm(columns[:, 1:], axis=0), 1e-300)
    u, s, _ = np.linalg.svd(slopes, full_matrices=False)
    return np.c_[columns[:, :1], u[:, s > RANK * np.max(s, initial=0.0)]]


def estimated(rows: Rows, columns: np.ndarray) -> Noise:
    """The noise with the largest restricted likelihood, of the order with the least BIC.

    Of shared errors that form is taken which is most likely where nothing else correlates the samples. Raises
    SearchError where fewer samples than parameters are left.
    """
    if len(columns) <= columns.shape[1]:
        raise SearchError(
            f"{len(columns)} samples of {rows.output!r} cannot show how its noise is correlated beside "
            f"{columns.shape[1] - 1} parameters; leave generalised least squares out."
        )
    columns = in_basis(columns)
    plain = Noise(np.zeros(0), 0.0, None, 1.0, rows, None)
    first = plain
    if rows.errors:
        forms: tuple[Form, ...] = ("edges in proportion", "edges", "own in proportion", "own")
        with_errors = [Noise(np.zeros(0), 1.0, form, 1.0, rows, rows.spread(form)) for form in forms]
        found = [_largest(noise, columns, np.zeros(1)) for noise in with_errors]
        value, first = max(found, key=lambda pair: pair[0])
        if value - restricted(plain, columns)[0] <= np.log(len(columns)):
            first = plain
    best, kept, later = np.inf, first, 0
    tail = first.unknowns
    start = np.zeros(0)
    for p in range(MOST + 1):
        if p and p >= max(rows.lengths):
            break
        begin = Noise(np.zeros(p), first.shared, first.form, 1.0, rows, first.spread)
        value, noise = _largest(begin, columns, np.r_[start, np.zeros(p - len(start)), tail])
        start = noise.unknowns[:p]
        criterion = -2.0 * value + p * np.log(len(columns))
        if criterion < best:
            best, kept, later = criterion, noise, 0
        else:
            later += 1
            if later == WORSE:
                break
    return _sized(kept, columns)


def _sized(noise: Noise, columns: np.ndarray) -> Noise:
    return Noise(noise.partial, noise.shared, noise.form, restricted(noise, columns)[1], noise.rows, noise.spread)


def _largest(noise: Noise, columns: np.ndarray, start: np.ndarray) -> tuple[float, Noise]:
    """The largest restricted likelihood over the unknowns of `noise`, and the noise there."""
    if not len(start):
        return restricted(noise, columns)[0], noise
    limits = [(-WIDEST, WIDEST)] * noise.order + [(FAINT, STRONG)] * (len(start) - noise.order)
    found = minimize(partial(_loss, noise, columns), start, method="L-BFGS-B", bounds=limits)
    return -float(found.fun), noise.with_(found.x)


def _loss(noise: Noise, columns: np.ndarray, x: np.ndarray) -> float:
    return -restricted(noise.with_(x), columns)[0]


def drawn(noise: Noise, columns: np.ndarray, seed: int = 0) -> tuple[list[Noise], np.ndarray]:
    """Noises that the rows allow, and their log-weights: importance draws from the restricted likelihood about its
    maximum, with a flat prior on partial correlations."""
    columns, x = in_basis(columns), noise.unknowns
    if not len(x):
        return [noise] * DRAWS, np.zeros(DRAWS)
    axes = np.eye(len(x)) * CURVED
    f = partial(_loss, noise, columns)
    curvature = np.zeros((len(x),) * 2)
    for i in range(len(x)):
        for j in range(i + 1):
            a, b = axes[i], axes[j]
            curvature[i, j] = curvature[j, i] = (f(x + a + b) - f(x + a - b) - f(x - a + b) + f(x - a - b)) / (
                4.0 * CURVED**2
            )
    w, q = np.linalg.eigh(curvature)
    root = q / np.sqrt(np.maximum(w, 1.0))
    u = stdtrit(DEGREES, Sobol(len(x), np.random.default_rng(seed)).random(DRAWS))
    points = np.clip(x + WIDER * u @ root.T, -STRONG, STRONG)
    points[:, : noise.order] = np.clip(points[:, : noise.order], -WIDEST, WIDEST)
    noises = [_sized(noise.with_(p), columns) for p in points]
    likely = np.array([restricted(n, columns)[0] + np.sum(np.log1p(-(n.partial**2))) for n in noises])
    # less the density of u by Student's t, but for a constant
    return noises, likely + 0.5 * (DEGREES + 1.0) * np.sum(np.log1p(u**2 / DEGREES), axis=1)


def shares(logarithms: np.ndarray) -> np.ndarray:
    """Weights (k,) of draws that sum to 1; equal where too few would count."""
    weights = np.exp(logarithms - np.max(logarithms))
    weights /= np.sum(weights)
    return weights if 1.0 / np.sum(weights**2) >= FEWEST else np.full(len(weights), 1.0 / len(weights))


__all__ = ["Noise", "Rows", "drawn", "estimated", "in_basis", "restricted", "shares"]
