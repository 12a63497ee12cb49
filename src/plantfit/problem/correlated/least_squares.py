"""Generalised least squares: the parameters and the correlation of the noise from the same residuals.

Least squares weighs every sample alike. Where the noise of neighbours is alike, and where an error of the sensor comes
back, other weights know the parameters better: those of the inverse covariance of the noise (Aitken, Proc. R. Soc.
Edinb. 55 (1936) 42). The covariance is estimated from the residuals of each output (`correlated_noise`), and what is
not known of it widens the intervals: estimates are averaged over the noises that the residuals allow.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear
from scipy.special import fdtrc, stdtrit  # scipy.stats takes a third of a second to load

import plantfit.runtime  # noqa: F401
from plantfit.errors import SearchError
from plantfit.problem.correlated.limits import FEW
from plantfit.problem.correlated.noise import Noise, Rows, drawn, estimated, shares
from plantfit.problem.correlated.weighted_answer import Difference, OutputNoise, Weighted
from plantfit.problem.evaluate.points import residuals, residuals_and_jacobian
from plantfit.problem.measure.long_run import NORMAL
from plantfit.problem.problem import Problem

GAP = 1.5  # sampling periods between two samples, from which on they are no neighbours
MOST_ERRORS = 3000  # of a sensor that are estimated with the parameters
EXACT = 1e-10  # of the outputs' spread: residuals below are rounding
ROUNDS, STEPS = 4, 20  # of the noise, and of Gauss-Newton with each
ENDED = 1e-3  # standard errors that the last step, and the last noise, may move a value
HALVED = 8  # times that a step is halved
MEAN_OF_SQUARES = 0.4  # share to which the mean square of edges' errors is known that a mean speed was corrected by
EDGE = 1e-6  # of the cube: closer to a bound counts as on it
NOTICED = 0.1  # standard errors that the two estimates differ by at least, for the difference to tell anything
RANK = 1e-10  # of the largest eigenvalue of the scaled normal matrix


@dataclass(frozen=True, eq=False)
class _Linear:
    """Residuals (m,), derivatives (m, d + k) by the cube coordinates and by starts, and further rows of what is known
    beside the samples."""

    residuals: np.ndarray
    slopes: np.ndarray
    known: np.ndarray  # (l,), by rows (l, d + k) of `known_slopes`, in standard deviations
    known_slopes: np.ndarray


@dataclass(frozen=True, eq=False)
class _Output:
    """Where the rows of an output stand among all, in the order of `rows`."""

    places: np.ndarray
    rows: Rows


def weighted_least_squares(problem: Problem, values: Mapping[str, float]) -> Weighted:
    """From the least-squares answer `values` of a final problem, on any model.

    Raises SearchError where the residuals are rounding alone, or fewer samples than parameters are left of an output.
    """
    begun = z = np.asarray(problem.space.cube(problem.space.vector(values)), dtype=float)
    fitted = _Fit(problem)
    fitted.check(z)
    noises: list[Noise] = []
    test: Difference | None = None
    for i in range(ROUNDS):
        here = fitted.linear(z)
        noises = [estimated(o.rows, np.c_[here.residuals, here.slopes][o.places]) for o in fitted.outputs]
        fitted.allow_for(noises)
        moved = fitted.descended(z, noises)
        ended = np.max(np.abs(moved - z) / np.maximum(fitted.errors(moved, noises), 1e-300), initial=0.0) <= ENDED
        z = moved
        if i == 0:  # before a noise that grows with the estimate explains everything
            test = fitted.tested(begun, z, noises)
        if ended or (test is not None and test.differs):
            break
    return fitted.told(z, noises, test)


class _Fit:
    """A problem whose start corrections move with the parameters."""

    def __init__(self, problem: Problem):
        self.problem = problem.unsmoothed
        self.smoothing = problem.smoothing
        self.space, self.dimension = problem.space, problem.space.dimension
        self.starts = [(n, o) for n, own in problem.start_corrections.items() for o in own]
        self.remarks: list[str] = []
        self.weights = self._weights()
        self.outputs: list[_Output] = []
        self.high = np.zeros(len(self.weights))

    def allow_for(self, noises: Sequence[Noise]) -> None:
        """Take off what the shared errors add to the mean of their samples (`Noise.skipped`)."""
        for o, noise in zip(self.outputs, noises, strict=True):
            share = noise.skipped
            if share is not None:
                self.high[o.places] = share * np.concatenate(o.rows.sizes)

    def check(self, z: np.ndarray) -> None:
        """Find the rows of every output; raise SearchError where there is no noise to be seen."""
        found = residuals(self.problem, z)
        self.outputs = self._rows(found)
        for o in self.outputs:
            name = o.rows.output
            measured = np.concatenate(self.problem.parts.of_output(name)) / float(self.problem.scales[name])
            if np.sqrt(np.mean(found[o.places] ** 2)) <= EXACT * max(float(np.std(measured)), 1e-300):
                raise SearchError(
                    f"The model follows {name} to rounding, so there is no noise whose correlation could be "
                    "estimated; leave generalised least squares out."
                )

    def linear(self, z: np.ndarray) -> _Linear:
        """Everything about z, in rows of unweighted scaled residuals."""
        r, jacobian = residuals_and_jacobian(self.problem, z)
        size = float(np.sqrt(np.mean(r**2)))
        columns, known, known_slopes = self._start_columns(z, len(r))
        if self.smoothing is not None:
            bends, by = self.smoothing.weighted(z)
            known = np.r_[known, bends / size]
            known_slopes = np.vstack([known_slopes, np.hstack([by / size, np.zeros((len(by), len(self.starts)))])])
        slopes = np.hstack([jacobian, columns]) / self.weights[:, None]
        return _Linear(r / self.weights - self.high, slopes, known, known_slopes)

    def descended(self, z: np.ndarray, noises: Sequence[Noise]) -> np.ndarray:
        """Gauss-Newton with the noise given, inside the box, from z to where its steps are small."""
        here = self.linear(z)
        cost = self._cost(here, noises)
        for _ in range(STEPS):
            matrix, gradient = self._normal(here, noises)
            step = _bounded_step(matrix, gradient, z)
            factor, better = 1.0, None
            for _ in range(HALVED):
                z_new = np.clip(z + factor * step[: self.dimension], 0.0, 1.0)
                other = self._moved(factor * step[self.dimension :])
                there = other.linear(z_new)
                new = other._cost(there, noises) if np.all(np.isfinite(there.residuals)) else np.inf
                if new <= cost:
                    better = z_new, other, there, new
                    break
                factor *= 0.5
            if better is None:
                break
            z, other, here, cost = better
            self.problem = other.problem
            if factor == 1.0 and np.max(np.abs(step) * np.sqrt(np.maximum(np.diag(matrix), 0.0))) <= ENDED:
                break
        return z

    def errors(self, z: np.ndarray, noises: Sequence[Noise]) -> np.ndarray:
        """Standard errors (d,) in the cube, the noise taken as known."""
        matrix, _ = self._normal(self.linear(z), noises)
        return np.sqrt(np.maximum(np.diag(_inverse(matrix)[0])[: self.dimension], 0.0))

    def told(self, z: np.ndarray, noises: Sequence[Noise], test: Difference | None) -> Weighted:
        """Values with intervals that allow for what is not known of the noise."""
        here = self.linear(z)
        both = [np.c_[here.residuals, here.slopes][o.places] for o in self.outputs]
        draws = [drawn(n, c, seed=i) for i, (n, c) in enumerate(zip(noises, both, strict=True))]
        weights = shares(np.sum([logs for _, logs in draws], axis=0))
        if not any(len(n.unknowns) for n in noises):
            weights = np.ones(1)  # all draws are the same
        matrix, gradient = self._normal(here, noises)
        covariance, open_ = _inverse(matrix)
        centre, d = -covariance @ gradient, self.dimension
        spread = np.zeros_like(covariance)
        for k, weight in enumerate(weights):
            own, slope = self._normal(here, [made[k] for made, _ in draws])
            inverse, _ = _inverse(own)
            off = -inverse @ slope - centre
            spread += weight * (inverse + np.outer(off, off))
        spread *= np.outer(uneven := self._uneven(here, noises, covariance), uneven)
        spread += self._gains(here, noises, covariance)
        freedom = [len(o.places) - d for o in self.outputs]
        wide = _widened(covariance, self._products(here.slopes, noises), freedom)
        cube, error = spread[:d, :d] * np.outer(wide[:d], wide[:d]), np.sqrt(np.diag(spread)[:d]) * wide[:d]
        slopes = self.space.slopes(z)
        low, high = (self._physical(z + side * NORMAL * error) for side in (-1.0, 1.0))
        names = self.space.names
        open_ = open_ | any(n.degrees < FEW for n in noises)
        interval = {n: (None, None) if open_[i] else (float(low[i]), float(high[i])) for i, n in enumerate(names)}
        physical = cube * np.outer(slopes, slopes)
        physical[open_[:d], :] = physical[:, open_[:d]] = 0.0
        values = np.asarray(self.space.physical(z))
        return Weighted(z, values, physical, interval, self._told(here, noises), test, tuple(self.remarks))

    def tested(self, begun: np.ndarray, z: np.ndarray, noises: Sequence[Noise]) -> Difference | None:
        """Hausman's test of the least-squares answer against z: the variance of the difference is that of least
        squares less that of the better estimate."""
        here = self.linear(z)
        size, weight = float(np.sqrt(np.mean(here.residuals**2))), self.weights**2
        weighted = here.slopes * weight[:, None] / size**2
        own = here.slopes.T @ weighted + here.known_slopes.T @ here.known_slopes
        middle = here.known_slopes.T @ here.known_slopes
        for o, noise in zip(self.outputs, noises, strict=True):
            middle = middle + noise.variance_of(weighted[o.places])
        inverse, _ = _inverse(own)
        # by how much what shared errors add to the mean moves least squares is known: it is no difference
        begun = begun + (inverse @ (weighted.T @ self.high))[: self.dimension]
        better, open_ = _inverse(self._normal(here, noises)[0])
        d = self.dimension
        inside = np.flatnonzero((np.minimum(begun, z) > EDGE) & (np.maximum(begun, z) < 1.0 - EDGE) & ~open_[:d])
        error = np.sqrt(np.maximum(np.diag(better), 0.0))[inside]
        if not len(inside) or np.any(error == 0.0):
            return None
        more = (inverse @ middle @ inverse - better)[np.ix_(inside, inside)] / np.outer(error, error)
        w, q = np.linalg.eigh(more)
        told = w > NOTICED**2
        if not np.any(told):
            return None
        apart = (z - begun)[inside] / error
        statistic, degrees = float(np.sum((q[:, told].T @ apart) ** 2 / w[told])), int(told.sum())
        chance = float(fdtrc(degrees, max(min(n.degrees for n in noises) - 1.0, 1.0), statistic / degrees))
        worst = int(np.argmax(np.abs(apart) / np.sqrt(np.maximum(np.diag(more), NOTICED**2))))
        name = self.space.names[inside[worst]]
        before, after = (float(np.asarray(self.space.physical(v))[inside[worst]]) for v in (begun, z))
        return Difference(statistic, degrees, chance, name, before, after)

    # -- rows -------------------------------------------------------------------------------------

    def _weights(self) -> np.ndarray:
        """Roots (m,) of how often the squares of each recording count."""
        own = self.problem.weights
        counts = self.problem.parts.counts
        return np.concatenate([np.full(c, 1.0 if own is None else np.sqrt(own[n])) for n, c in counts.items()])

    def _rows(self, found: np.ndarray) -> list[_Output]:
        problem, index, measured = self.problem, self.problem.data["index"], self.problem.data["measured"]
        places: dict[str, list[np.ndarray]] = {o: [] for o in problem.outputs}
        lengths: dict[str, list[int]] = {o: [] for o in problem.outputs}
        errors: dict[str, list[np.ndarray]] = {o: [] for o in problem.outputs}
        sizes: dict[str, list[np.ndarray]] = {o: [] for o in problem.outputs}
        start = 0
        for name, own in index.items():
            experiment = problem.experiments[name]
            for output in problem.outputs:
                here, scale = own[output], float(problem.scales[output])
                rows = np.arange(start, start + len(here))
                start += len(here)
                if not len(here):
                    continue
                numbers = experiment.error_numbers(output)
                places[output].append(rows)
                lengths[output] += _stretches(experiment.recording.t[here])
                errors[output].append(np.full(len(here), np.nan) if numbers is None else numbers[here])
                sizes[output].append(measured[name][output] / scale + (found / self.weights)[rows])
        return [
            _Output(np.concatenate(places[o]), Rows(o, tuple(lengths[o]), *self._errors(o, errors[o], sizes[o])))
            for o in problem.outputs
        ]

    def _errors(
        self, output: str, numbers: Sequence[np.ndarray], sizes: Sequence[np.ndarray]
    ) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
        """Numbers of shared errors from 0 and sizes, by recording; nothing where there are none, or too many."""
        if all(np.all(np.isnan(own)) for own in numbers):
            return (), ()
        least = [np.min(own[np.isfinite(own)], initial=np.inf) for own in numbers]
        numbers = [own - (low if low < 0 else 0.0) for own, low in zip(numbers, least, strict=True)]
        count = sum(int(np.max(own[np.isfinite(own)], initial=-1)) + 1 for own in numbers)
        if count > MOST_ERRORS:
            self.remarks.append(
                f"{output}: its samples share {count} errors, and generalised least squares estimates at most "
                f"{MOST_ERRORS}, so it takes them for noise of the samples"
            )
            return (), ()
        return tuple(numbers), tuple(sizes)

    def _moved(self, starts: np.ndarray) -> "_Fit":
        """The same with start corrections moved."""
        if not len(starts):
            return self
        changed = {n: dict(own) for n, own in self.problem.start_corrections.items()}
        for (name, output), step in zip(self.starts, starts, strict=True):
            changed[name][output] += float(step) * float(self.problem.scales[output])
        other = object.__new__(_Fit)
        other.__dict__.update(self.__dict__, problem=self.problem.with_starts(changed))
        return other

    def _start_columns(self, z: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What starts do to the residuals (m, k), in scales of their outputs, and what is known of those that are no
        samples of the fit: standard deviations that they are off (l,), with derivatives (l, d + k)."""
        k = len(self.starts)
        columns = np.zeros((count, k))
        for output in dict.fromkeys(o for _, o in self.starts):
            own = [i for i, (_, o) in enumerate(self.starts) if o == output]
            step = np.zeros(k)
            step[own] = 1e-3
            above, below = (residuals(self._moved(side * step).problem, z) for side in (1.0, -1.0))
            slope, start = (above - below) / 2e-3, 0
            for name, rows in self.problem.parts.counts.items():
                for i in own:
                    if self.starts[i][0] == name:
                        columns[start : start + rows, i] = slope[start : start + rows]
                start += rows
        known, by = [], []
        r = residuals(self.problem, z) / self.weights if k else np.zeros(0)
        for i, (name, output) in enumerate(self.starts):
            measured = np.flatnonzero(np.isfinite(self.problem.experiments[name].recording[output]))
            index = self.problem.data["index"][name][output]
            if not (len(index) and index[0] == measured[0]):
                [own] = [o.places for o in self.outputs if o.rows.output == output]
                size = max(float(np.sqrt(np.mean(r[own] ** 2))), 1e-300)
                correction = self.problem.start_corrections[name][output] / float(self.problem.scales[output])
                known.append(correction / size)
                by.append(np.eye(1, self.dimension + k, self.dimension + i)[0] / size)
        return columns, np.array(known), np.array(by).reshape(len(by), self.dimension + k)

    # -- the weighted problem ---------------------------------------------------------------------

    def _products(self, columns: np.ndarray, noises: Sequence[Noise]) -> list[np.ndarray]:
        """columns' V^-1 columns of each output, for columns (m, k) over all rows."""
        return [
            noise.products(columns[o.places])[0] / noise.variance for o, noise in zip(self.outputs, noises, strict=True)
        ]

    def _normal(self, here: _Linear, noises: Sequence[Noise]) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrix (d + k, d + k) and gradient (d + k,)."""
        known = np.c_[here.known, here.known_slopes]
        found = known.T @ known + sum(self._products(np.c_[here.residuals, here.slopes], noises))
        return found[1:, 1:], found[1:, 0]

    def _cost(self, here: _Linear, noises: Sequence[Noise]) -> float:
        own = self._products(here.residuals[:, None], noises)
        return float(here.known @ here.known) + sum(float(p[0, 0]) for p in own)

    def _physical(self, z: np.ndarray) -> np.ndarray:
        """Values at cube points that may lie outside of the box, not beyond their physical limits."""
        values = np.asarray(self.space.physical(z))
        limits = np.array([c.limits for c in self.space.coordinates]).reshape(-1, 2)
        return np.clip(values, limits[:, 0], limits[:, 1])

    def _gains(self, here: _Linear, noises: Sequence[Noise], covariance: np.ndarray) -> np.ndarray:
        """What the estimates (d + k,) vary by because the mean of an output with wrong edges is known to the square of
        their errors only."""
        found = np.zeros_like(covariance)
        for o, noise in zip(self.outputs, noises, strict=True):
            if noise.form == "edges in proportion" and noise.spread is not None:
                size = noise.shared_variance * np.hypot(MEAN_OF_SQUARES, 3.0 * np.sqrt(2.0 / noise.spread.shape[1]))
                columns = np.c_[np.concatenate(o.rows.sizes), here.slopes[o.places]]
                moved = covariance @ noise.products(columns)[0][1:, 0] / noise.variance
                found += size**2 * np.outer(moved, moved)
        return found

    def _uneven(self, here: _Linear, noises: Sequence[Noise], covariance: np.ndarray) -> np.ndarray:
        """How many times as large as by noise of one size standard errors (d + k,) are, where the samples that tell a
        parameter have more of it than others (White, Econometrica 48 (1980) 817, eq. 3); never less than once."""
        middle = here.known_slopes.T @ here.known_slopes
        for o, noise in zip(self.outputs, noises, strict=True):
            rows = noise.rooted(np.c_[here.residuals, here.slopes][o.places]) / np.sqrt(noise.variance)
            middle = middle + (rows[:, 1:] * rows[:, :1]).T @ (rows[:, 1:] * rows[:, :1])
        own = np.maximum(np.diag(covariance), 1e-300)
        return np.sqrt(np.maximum(np.diag(covariance @ middle @ covariance) / own, 1.0))

    def _told(self, here: _Linear, noises: Sequence[Noise]) -> tuple[OutputNoise, ...]:
        found = []
        for o, noise in zip(self.outputs, noises, strict=True):
            white = noise.whitened(here.residuals[o.places])
            left = float(white[1:] @ white[:-1]) / max(float(white @ white), 1e-300)
            name, problem = o.rows.output, self.problem
            unit = problem.model.outputs[name] or None
            found.append(OutputNoise(name, unit, noise, float(problem.scales[name]), len(o.places), left))
        return tuple(found)


def _stretches(times: np.ndarray) -> list[int]:
    """Lengths of the stretches of samples that follow one another, for their times (k,)."""
    if len(times) < 2:
        return [len(times)]
    steps = np.diff(times)
    ends = np.flatnonzero(np.abs(steps) > GAP * abs(float(np.median(steps)))) + 1
    return [int(n) for n in np.diff(np.r_[0, ends, len(times)])]


def _bounded_step(matrix: np.ndarray, gradient: np.ndarray, z: np.ndarray) -> np.ndarray:
    """The step (d + k,) to the least cost of the linear problem in the box."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    w, q = np.linalg.eigh(matrix / np.outer(size, size))
    there = w > RANK * w[-1]
    rows = np.sqrt(w[there])[:, None] * q[:, there].T
    aim = -(q[:, there].T @ (gradient / size)) / np.sqrt(w[there])
    low, high = np.full(len(matrix), -np.inf), np.full(len(matrix), np.inf)
    low[: len(z)], high[: len(z)] = -z * size[: len(z)] - 1e-12, (1.0 - z) * size[: len(z)] + 1e-12
    return lsq_linear(rows, aim, (low, high), method="trf" if len(z) > 60 else "bvls").x / size


def _inverse(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance where the normal matrix has rank, and which coordinates (d,) lie in a direction that it has not."""
    size = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    none = size == 0.0
    size = np.where(none, 1.0, size)
    w, q = np.linalg.eigh(matrix / np.outer(size, size))
    there = w > RANK * max(w[-1], 1e-300)
    found = (q[:, there] / w[there]) @ q[:, there].T / np.outer(size, size)
    return found, none | (np.sum(q[:, ~there] ** 2, axis=1) > 1e-6)


def _widened(covariance: np.ndarray, parts: Sequence[np.ndarray], degrees: Sequence[float]) -> np.ndarray:
    """What standard errors (d,) are multiplied by, for the degrees of freedom that the size of each output's noise was
    estimated with (Satterthwaite, Biometrics Bull. 2 (1946) 110, eq. 17)."""
    variance = np.maximum(np.diag(covariance), 1e-300)
    inverse = np.zeros(len(covariance))
    for part, own in zip(parts, degrees, strict=True):
        share = np.einsum("ij,jk,ki->i", covariance, part, covariance) / variance
        inverse += np.clip(share, 0.0, 1.0) ** 2 / max(own, 1.0)
    return stdtrit(1.0 / np.maximum(inverse, 1e-9), 0.975) / NORMAL


__all__ = ["weighted_least_squares"]
