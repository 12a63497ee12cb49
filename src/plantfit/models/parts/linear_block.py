"""Linear blocks of order 1 to 3 in continuous time with static gain 1, for models with nonlinear ends."""

from dataclasses import dataclass
from typing import Any

import plantfit.runtime  # noqa: F401  (float64 before the first array)
from plantfit.models.model import Declared, Named


@dataclass(frozen=True)
class ModalBlock:
    """A sum of first order modes.

        tau_i z_i' = v - z_i,   w = sum c_i z_i,   c_n = 1 - c_1 - ... - c_{n-1}

    Parameters tau1.. (s) and the shares c1.. of the modes; modes may change places.
    """

    order: int

    def parameters(self) -> tuple[Declared, ...]:
        times = [
            Declared(f"tau{i + 1}", "s", (0.01, 1e4), "log", sentence="time constant of a mode")
            for i in range(self.order)
        ]
        shares = [
            Declared(f"c{i + 1}", "", (-10.0, 10.0), sentence="share of the mode in the output")
            for i in range(self.order - 1)
        ]
        return (*times, *shares)

    def states(self, unit: str | None) -> dict[str, str | None]:
        return {f"z{i + 1}": unit for i in range(self.order)}

    def derivative(self, x: Named, v: Any, p: Named) -> Named:
        return {f"z{i + 1}": (v - x[f"z{i + 1}"]) / p[f"tau{i + 1}"] for i in range(self.order)}

    def output(self, x: Named, p: Named) -> Any:
        last = x[f"z{self.order}"]
        return last + sum(p[f"c{i + 1}"] * (x[f"z{i + 1}"] - last) for i in range(self.order - 1))

    def rest(self, v: Any) -> Named:
        """States at rest under v."""
        return {f"z{i + 1}": v for i in range(self.order)}


@dataclass(frozen=True)
class CompanionBlock:
    """One differential equation, which may oscillate.

        a_n w^(n) + ... + a_2 w'' + a_1 w' + w = v

    Parameters a1 (s), a2 (s^2), a3 (s^3); states z1 = w, z2 = w', z3 = w''. With positive
    coefficients it is stable to order 2, and at order 3 when a1 a2 > a3.
    """

    order: int

    def parameters(self) -> tuple[Declared, ...]:
        units = ("s", "s^2", "s^3")
        return tuple(
            Declared(
                f"a{i + 1}",
                units[i],
                (0.01 ** (i + 1), 1e3 ** (i + 1)),
                "log",
                sentence=f"coefficient of derivative {i + 1}",
            )
            for i in range(self.order)
        )

    def states(self, unit: str | None) -> dict[str, str | None]:
        return {
            f"z{i + 1}": None if unit is None else f"({unit or '1'})/s^{i}" if i else unit for i in range(self.order)
        }

    def derivative(self, x: Named, v: Any, p: Named) -> Named:
        known = x["z1"] + sum(p[f"a{i}"] * x[f"z{i + 1}"] for i in range(1, self.order))
        rates = {f"z{i}": x[f"z{i + 1}"] for i in range(1, self.order)}
        return {**rates, f"z{self.order}": (v - known) / p[f"a{self.order}"]}

    def output(self, x: Named, p: Named) -> Any:
        return x["z1"]

    def rest(self, v: Any) -> Named:
        """States at rest under v."""
        return {f"z{i + 1}": v if i == 0 else 0.0 * v for i in range(self.order)}


Block = ModalBlock | CompanionBlock
BLOCKS: dict[str, type[ModalBlock] | type[CompanionBlock]] = {"modal": ModalBlock, "companion": CompanionBlock}
