"""Which parameters the data fix only in combination."""

from dataclasses import dataclass

import numpy as np

FLAT = 0.5  # standard deviation of the logarithm along a direction: a factor of 1.6 either way


@dataclass(frozen=True)
class Direction:
    """A way to move several parameters together that the outputs hardly notice.

    `weights` are relative changes (d ln p), the largest 1; `relative_sd` is how far the data let
    the parameters move along it (standard deviation of the logarithm, limited by the box).
    """

    weights: dict[str, float]
    relative_sd: float

    @property
    def sentence(self) -> str:
        up = [n for n, w in self.weights.items() if w > 0]
        down = [n for n, w in self.weights.items() if w < 0]
        strength = ", ".join(f"{n} {100 * w:+.0f} %" for n, w in self.weights.items())
        if len(self.weights) == 1:
            return f"The data leave {up[0] if up else down[0]} open to about {_percent(self.relative_sd)}."
        if not down:
            how = f"{_list(up)} can grow together"
        else:
            how = f"{_list(up)} can grow while {_list(down)} shrink{'s' if len(down) == 1 else ''}"
        return (
            f"{how} ({strength}) and the simulated outputs hardly change; only what stays constant along this line is determined, "
            f"here {self.constant}. Along it the values are open to about {_percent(self.relative_sd)}."
        )

    @property
    def constant(self) -> str:
        """Combinations of two that do not change along the direction, in symbols."""
        names = sorted(self.weights, key=lambda n: -abs(self.weights[n]))
        lead = names[0]
        found = []
        for other in names[1:]:
            power = self.weights[lead] / self.weights[other]
            sign, size = ("/", power) if power > 0 else ("*", -power)
            tail = other if abs(size - 1) < 0.08 else f"{other}^{size:.2g}"
            found.append(f"{lead}{sign}{tail}")
        return ", ".join(found)


def flat_directions(hessian: np.ndarray, values: np.ndarray, width: np.ndarray, names: tuple[str, ...]) -> list[Direction]:
    """Directions along which the data fix the parameters less well than by a factor.

    `hessian` (d, d): information about the values in their units (inverse covariance of white
    residuals), `values` (d,), `width` (d,) of the box. In logarithms of the values, with the box
    as prior.
    """
    size = np.where(np.abs(values) > 1e-9 * width, np.abs(values), width)
    information = hessian * size[:, None] * size[None, :] + np.diag(12.0 * (size / width) ** 2)
    eigenvalues, vectors = np.linalg.eigh(information)
    found = []
    for value, vector in zip(eigenvalues, vectors.T, strict=True):
        sd = 1.0 / np.sqrt(max(value, 1e-300))
        if sd < FLAT:
            continue
        vector = vector / vector[np.argmax(np.abs(vector))]
        keep = {n: float(w) for n, w in zip(names, vector, strict=True) if abs(w) >= 0.1}
        found.append(Direction(keep, float(sd)))
    return found


def _list(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _percent(sd: float) -> str:
    return f"{100 * sd:.0f} %" if sd < 1 else f"a factor of {np.exp(min(sd, 20)):.2g}"
