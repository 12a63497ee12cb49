"""Levenberg-Marquardt steps of several bounded least-squares searches at once, by QR decomposition."""

from dataclasses import dataclass

import numpy as np

ENOUGH = 1e-4  # share of the predicted decrease that makes a step good
FINISHED = 1e-12  # relative decrease that an undamped step promises at an optimum
NEAR = 1e-6  # relative promised decrease from which on it is worth looking whether the optimum is reached
ROUNDING = (
    1e-4  # relative promised decrease below which a search that finds no better point has met the limits of float64
)
REFUSED = 3  # refused steps in a row, each with a promise below ROUNDING of NEAR, that show these limits
HOPELESS = 1e16  # damping at which no step leads down any more
DAMPING, EASIEST = 1e-3, 1e-14
FLAT = 1e-10  # smallest scale of a coordinate, as a share of the largest
RANK = 1e-13  # singular value, as a share of the largest, below which a direction is not resolved


@dataclass(frozen=True, eq=False)
class Rows:
    """Residuals r (n, k) and derivatives (n, k, d) at n points, in k rows whose mean square is the cost; full cube
    points (n, D)."""

    r: np.ndarray
    jacobian: np.ndarray
    points: np.ndarray

    @property
    def squares(self) -> np.ndarray:
        """Sum of the squared rows (n,), k times the cost; +inf where a point could not be simulated."""
        with np.errstate(over="ignore", invalid="ignore"):
            squares = np.sum(self.r**2, axis=1)
        return np.where(np.isnan(squares), np.inf, squares)


@dataclass(eq=False)
class Lanes:
    """Searches under way; leading axis: search.

    `x` (n, d) cube points of the coordinates that are searched, `points` (n, D) the full ones, `squares` r'r, `scale`
    the column norms so far. `refused` counts steps in a row that led nowhere at the limits of float64; `most` limits
    the steps. `independent` and `asked` (the user's own start) are facts of the start; `mark` is r'r when the limit was
    set, `again` tells that a search was set aside before.
    """

    x: np.ndarray
    points: np.ndarray
    squares: np.ndarray
    r: np.ndarray
    jacobian: np.ndarray
    scale: np.ndarray
    damping: np.ndarray
    growth: np.ndarray
    steps: np.ndarray
    refused: np.ndarray
    most: np.ndarray
    independent: np.ndarray
    asked: np.ndarray
    mark: np.ndarray
    again: np.ndarray

    @classmethod
    def begin(cls, x: np.ndarray, rows: Rows, independent: np.ndarray, asked: np.ndarray, most: int) -> "Lanes":
        """Searches at their starts x (n, d)."""
        n, scale, none = len(x), _norms(rows.jacobian), np.zeros(len(x), int)
        limit = np.where(asked, np.iinfo(int).max, most)
        return cls(
            x, rows.points, rows.squares, rows.r, rows.jacobian, scale, np.full(n, DAMPING), np.full(n, 2.0), none,
            none, limit,
            independent, asked, rows.squares, np.zeros(n, bool),
        )  # fmt: skip

    def __getitem__(self, which: np.ndarray) -> "Lanes":
        return Lanes(*(a[which] for a in vars(self).values()))

    def __len__(self) -> int:
        return len(self.x)

    def join(self, other: "Lanes") -> "Lanes":
        return Lanes(*(np.concatenate(pair) for pair in zip(vars(self).values(), vars(other).values(), strict=True)))

    @property
    def held(self) -> np.ndarray:
        """Coordinates (n, d) on a bound against which the gradient presses them."""
        slope = _times(self.jacobian, self.r)
        return ((self.x <= 0.0) & (slope > 0)) | ((self.x >= 1.0) & (slope < 0))

    def propose(self) -> tuple[np.ndarray, np.ndarray]:
        """A damped Gauss-Newton step (n, d) of every lane inside the box, and the decrease (n,) that its linear model
        promises.

        Scaled by the largest column norms so far (More 1978, Lecture Notes in Mathematics 630:105, sec. 6) and solved
        by the QR decomposition of the rows on top of the damping (the same, sec. 3): J'J would lose half of the digits.
        Coordinates that are held stay; those that a step would carry outside end on the bound and the others are solved
        for again (projected Newton: Bertsekas 1982, SIAM J. Control Optim. 20:221).
        """
        n, d = self.x.shape
        scale = np.maximum(self.scale, np.maximum(FLAT * self.scale.max(axis=1, keepdims=True), 1e-150))
        columns = self.jacobian / scale[:, None, :]
        root = np.sqrt(self.damping)[:, None, None] * np.eye(d)
        low, high = -self.x * scale, (1.0 - self.x) * scale
        fixed, p = self.held, np.zeros((n, d))
        for _ in range(d + 1):
            held = np.where(fixed, p, 0.0)
            free = np.where(fixed[:, None, :], 0.0, columns)
            left = self.r + _product(columns, held)
            # a fixed coordinate solves 1 p = 0 and is set afterwards
            damped = np.where(fixed[:, None, :], np.eye(d), root)
            system = np.concatenate([np.concatenate([free, damped], axis=1), _padded(left, d)[:, :, None]], axis=2)
            triangle = np.asarray(np.linalg.qr(system, mode="r"))
            p = np.where(fixed, held, -np.linalg.solve(triangle[:, :d, :d], triangle[:, :d, d:])[:, :, 0])
            outside = ~fixed & ((p < low) | (p > high))
            if not np.any(outside):
                break
            p, fixed = np.clip(p, low, high), fixed | outside
        p = np.clip(p, low, high)
        change = _product(columns, p)
        return p / scale, -np.sum(change * (2.0 * self.r + change), axis=1)

    def take(self, promised: np.ndarray, trial: np.ndarray, rows: Rows) -> np.ndarray:
        """Accept or refuse every step, choose the next dampings (Nielsen 1999, IMM-REP-1999-05, eq. 2.5); which
        lanes ended (n,)."""
        squares = rows.squares
        with np.errstate(invalid="ignore", divide="ignore"):
            gained = self.squares - squares
            ratio = np.where(np.isfinite(squares) & (promised > 0), gained / promised, -1.0)
        good = ratio > ENOUGH
        self.x = np.where(good[:, None], trial, self.x)
        self.points = np.where(good[:, None], rows.points, self.points)
        self.squares = np.where(good, squares, self.squares)
        self.r = np.where(good[:, None], rows.r, self.r)
        self.jacobian = np.where(good[:, None, None], rows.jacobian, self.jacobian)
        self.scale = np.maximum(self.scale, _norms(self.jacobian))
        easier = self.damping * np.maximum(1 / 3, 1 - (2 * np.clip(ratio, 0, 2) - 1) ** 3)
        self.damping = np.maximum(np.where(good, easier, self.damping * self.growth), EASIEST)
        self.growth = np.where(good, 2.0, 2.0 * self.growth)
        self.steps = self.steps + 1
        self.refused = np.where(good | (promised > ROUNDING * NEAR * self.squares), 0, self.refused + 1)
        near = np.flatnonzero((promised <= NEAR * self.squares) | (self.damping > HOPELESS))
        ended = (self.damping > HOPELESS) | (self.refused >= REFUSED) | (self.squares == 0.0)
        if len(near):
            ended[near] |= self[near].promise() <= FINISHED * self.squares[near]
        return ended

    def promise(self) -> np.ndarray:
        """Decrease of r'r (n,) that the undamped Gauss-Newton step of the coordinates that are not held promises.

        Relative to r'r it is the square of the relative offset of Bates and Watts 1981, Technometrics 23:179: how far
        the residual is from being orthogonal to all that the coordinates can change. Columns that change nothing over
        the whole box do not count.
        """
        norms, size = _norms(self.jacobian), np.sqrt(self.squares)
        counts = ~self.held & (2.0 * norms > FINISHED * size[:, None])
        columns = np.where(counts[:, None, :], self.jacobian / np.maximum(norms, 1e-300)[:, None, :], 0.0)
        left, singular, _ = np.linalg.svd(columns, full_matrices=False)
        seen = singular > RANK * np.maximum(singular[:, :1], 1e-300)
        along = _times(left, self.r)
        return np.sum(np.where(seen, along, 0.0) ** 2, axis=1)


def _norms(jacobian: np.ndarray) -> np.ndarray:
    """Norms (n, d) of the columns of Jacobians (n, k, d), also where their squares are too large for a float."""
    with np.errstate(over="ignore"):
        found = np.linalg.norm(jacobian, axis=1)
    if np.all(np.isfinite(found)):
        return found
    largest = np.max(np.abs(jacobian), axis=1, initial=1e-300)
    return np.where(np.isinf(found), largest * np.linalg.norm(jacobian / largest[:, None], axis=1), found)


def _times(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Transposed matrices (n, k, d) times vectors (n, k)."""
    return (np.swapaxes(matrix, 1, 2) @ vector[:, :, None])[:, :, 0]


def _product(matrix: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Matrices (n, k, d) times vectors (n, d)."""
    return (matrix @ vector[:, :, None])[:, :, 0]


def _padded(vector: np.ndarray, more: int) -> np.ndarray:
    return np.concatenate([vector, np.zeros((len(vector), more))], axis=1)
