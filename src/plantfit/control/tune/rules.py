"""Classical tuning rules on a reduced plant, as gains of the ideal (ISA) PID."""

from typing import NamedTuple

from plantfit.control.pid import Gains
from plantfit.control.tune.reduction import Reduced

FILTER = 10.0  # a rule's derivative is filtered with Td / 10


class Isa(NamedTuple):
    """K (1 + 1/(Ti s) + Td s) with set-point weight b; K in input per output, times in s."""

    K: float
    Ti: float
    Td: float = 0.0
    b: float = 1.0

    def gains(self, ratio: float = FILTER) -> Gains:
        """In parallel form, the derivative on the measurement alone, filtered with Td / `ratio`."""
        return Gains(self.K, self.K / self.Ti, self.K * self.Td, self.b, 0.0, self.Td / ratio)


RULES = {
    "SIMC": "S. Skogestad, J. Process Control 13 (2003) 291; tau_c = theta",
    "AMIGO": "K. Astrom, T. Hagglund, J. Process Control 14 (2004) 635",
    "lambda": "K. Astrom, T. Hagglund, Advanced PID Control (2006), section 6.5; closed loop as fast as the open one",
    "Ziegler-Nichols": "J. Ziegler, N. Nichols, Trans. ASME 64 (1942) 759, step response",
    "Cohen-Coon": "G. Cohen, G. Coon, Trans. ASME 75 (1953) 827",
}


def rule_gains(rule: str, plant: Reduced, derivative: bool = True) -> Isa | None:
    """The PID (or PI, without `derivative`) of a rule of `RULES`; None where it has no answer for an integrating plant.

    A plant that is reduced to first order gets SIMC's PI where it has no second lag; the other rules take first order
    with dead time.
    """
    return {"SIMC": _simc, "AMIGO": _amigo, "lambda": _lambda, "Ziegler-Nichols": _ziegler, "Cohen-Coon": _cohen}[rule](
        plant, derivative
    )


def _simc(plant: Reduced, derivative: bool) -> Isa | None:
    """Series form (eqs. 23 to 25) turned into the ideal one (eq. 36)."""
    k, lag, second, dead = plant.second_order if derivative else (*plant.first_order[:2], 0.0, plant.first_order[2])
    if plant.integrating:
        gain, ti = 1.0 / (k * 2.0 * dead), 8.0 * dead
    else:
        gain, ti = lag / (k * 2.0 * dead), min(lag, 8.0 * dead)
    share = 1.0 + second / ti
    return Isa(gain * share, ti * share, second / share)


def _amigo(plant: Reduced, derivative: bool) -> Isa | None:
    k, t, dead = plant.first_order
    if plant.integrating:
        return (
            Isa(0.45 / (k * dead), 8.0 * dead, 0.5 * dead, 0.0)
            if derivative
            else Isa(0.35 / (k * dead), 13.4 * dead, 0.0, 0.0)
        )
    b = 0.0 if dead / (dead + t) <= 0.5 else 1.0
    if derivative:
        ti = dead * (0.4 * dead + 0.8 * t) / (dead + 0.1 * t)
        return Isa((0.2 + 0.45 * t / dead) / k, ti, 0.5 * dead * t / (0.3 * dead + t), b)
    gain = 0.15 / k + (0.35 - dead * t / (dead + t) ** 2) * t / (k * dead)
    return Isa(gain, 0.35 * dead + 13.0 * dead * t**2 / (t**2 + 12.0 * dead * t + 7.0 * dead**2), 0.0, b)


def _lambda(plant: Reduced, derivative: bool) -> Isa | None:
    k, t, dead = plant.first_order
    if plant.integrating:
        return None
    if derivative:
        return Isa((0.5 * dead + t) / (k * (0.5 * dead + t)), t + 0.5 * dead, t * dead / (dead + 2.0 * t))
    return Isa(t / (k * (dead + t)), t)


def _ziegler(plant: Reduced, derivative: bool) -> Isa | None:
    k, t, dead = plant.first_order
    a = k * dead if plant.integrating else k * dead / t
    return Isa(1.2 / a, 2.0 * dead, 0.5 * dead) if derivative else Isa(0.9 / a, 3.0 * dead)


def _cohen(plant: Reduced, derivative: bool) -> Isa | None:
    if plant.integrating:
        return None
    k, t, dead = plant.first_order
    a, r = k * dead / t, dead / (dead + t)
    if derivative:
        ti, td = dead * (2.5 - 2.0 * r) / (1.0 - 0.39 * r), dead * 0.37 * (1.0 - r) / (1.0 - 0.81 * r)
        return Isa(1.35 / a * (1.0 + 0.18 * r / (1.0 - r)), ti, td)
    return Isa(0.9 / a * (1.0 + 0.92 * r / (1.0 - r)), dead * (3.3 - 3.0 * r) / (1.0 + 1.2 * r))
