"""The parts that a network may have: their nodes, laws, units and bounds.

Every domain has a quantity across a part and one through it. A mass, an inertia, a heat capacity and a tank store the
quantity across them, measured against node 0, as a capacitor does (the mobility analogy: F. A. Firestone, A new analogy
between mechanical and electrical systems, J. Acoust. Soc. Am. 4, 1933, 249-267).
"""

from dataclasses import dataclass, field
from typing import Literal

Law = Literal[
    "resists",  # across = p * through
    "conducts",  # through = p * across
    "stores across",  # d across/dt = through/p
    "stores through",  # d through/dt = across/p
    "is elastic",  # through = p * integral of across
    "sets across",
    "sets through",
    # lead * across of port 1 = follow * across of port 2; lead * through of port 2 = follow * through of port 1
    "transforms",
    "curve",  # through = a function of across
]


@dataclass(frozen=True)
class Quantity:
    """A quantity as it is named in `measure` (letter or word) and in equations (letter), with its unit."""

    letter: str
    word: str
    unit: str


@dataclass(frozen=True)
class Domain:
    """`holds` says which parts settle the quantity across at a node; `start` are bounds of an initial value that
    nobody measured."""

    name: str
    across: Quantity
    through: Quantity
    holds: str
    integral: Quantity | None = None
    start: tuple[float, float] | None = None


ELECTRIC = Domain("electric", Quantity("v", "voltage", "V"), Quantity("i", "current", "A"), "a resistor or a capacitor")
TRANSLATION = Domain(
    "translation",
    Quantity("v", "velocity", "m/s"),
    Quantity("F", "force", "N"),
    "a mass or a damper",
    Quantity("x", "position", "m"),
)
ROTATION = Domain(
    "rotation", Quantity("w", "speed", "rad/s"), Quantity("M", "torque", "N*m"), "an inertia or a rotary_damper",
    Quantity("phi", "angle", "rad"),
)  # fmt: skip
THERMAL = Domain(
    "thermal", Quantity("T", "temperature", "degC"), Quantity("Q", "heat flow", "W"),
    "a heat_capacity or a heat_resistance",
    start=(-50.0, 500.0),
)  # fmt: skip
HYDRAULIC = Domain(
    "hydraulic", Quantity("h", "level", "m"), Quantity("q", "flow", "m^3/s"), "a tank or a pipe", start=(0.0, 10.0)
)
DOMAINS = (ELECTRIC, TRANSLATION, ROTATION, THERMAL, HYDRAULIC)


@dataclass(frozen=True)
class Part:
    """A kind of part. `nodes` are the words of its nodes; a part with a `grounded` port leads to node 0.

    `unit`, `bounds` and `what` are those of its parameter, which has the name of the part; a part without `unit` has
    none. `given` says whether a source follows an input or is a parameter, or has a gain from an input. `second` is the
    domain of the second port of a part that transforms, whose last node it is; with `lead` its parameter belongs to the
    first port.
    """

    kind: str
    domain: Domain
    nodes: tuple[str, ...]
    law: Law
    what: str
    unit: str = ""
    bounds: tuple[float, float] | None = None
    scale: str = "log"
    given: Literal["", "input", "parameter", "gain"] = ""
    second: Domain | None = None
    lead: bool = False
    curve: str = ""  # of {p}, the parameter, and {x}, the quantity across
    constants: dict[str, str] = field(default_factory=dict)

    @property
    def grounded(self) -> bool:
        """Whether the part leads from its only node to node 0."""
        return len(self.nodes) == 1

    @property
    def states(self) -> bool:
        return self.law in ("stores across", "stores through", "is elastic")


def _input(kind: str, domain: Domain, nodes: tuple[str, ...], across: bool) -> Part:
    quantity = domain.across if across else domain.through
    return Part(
        kind,
        domain,
        nodes,
        "sets across" if across else "sets through",
        f"{quantity.word}, an input",
        quantity.unit,
        given="input",
    )


def _constant(
    kind: str, domain: Domain, nodes: tuple[str, ...], across: bool, bounds: tuple[float, float], what: str
) -> Part:
    unit = (domain.across if across else domain.through).unit
    return Part(
        kind, domain, nodes, "sets across" if across else "sets through", what, unit, bounds, "linear", "parameter"
    )


_ENDS = ("from", "to")
# below it the flow through a valve is proportional to the level
_G = {"gravity": "9.81 m/s^2", "small_level": "0.001 m"}

PARTS: dict[str, Part] = {
    p.kind: p
    for p in (
        Part("resistor", ELECTRIC, _ENDS, "resists", "resistance", "ohm", (1e-2, 1e7)),
        Part("capacitor", ELECTRIC, _ENDS, "stores across", "capacitance", "F", (1e-12, 1.0)),
        Part("inductor", ELECTRIC, _ENDS, "stores through", "inductance", "H", (1e-7, 10.0)),
        _input("source", ELECTRIC, ("plus", "minus"), True),
        _input("current_source", ELECTRIC, _ENDS, False),
        _constant("battery", ELECTRIC, ("plus", "minus"), True, (0.0, 1000.0), "voltage of the battery"),
        Part("motor", ELECTRIC, ("plus", "minus", "shaft"), "transforms", "constant of torque and of back-EMF",
             "V*s/rad", (1e-4, 10.0),
             second=ROTATION),
        Part("mass", TRANSLATION, ("node",), "stores across", "mass", "kg", (1e-3, 1e5)),
        Part("spring", TRANSLATION, _ENDS, "is elastic", "stiffness", "N/m", (1e-1, 1e8)),
        Part("damper", TRANSLATION, _ENDS, "conducts", "viscous damping", "N*s/m", (1e-4, 1e6)),
        Part(
            "friction", TRANSLATION, _ENDS, "curve", "Coulomb friction", "N", (1e-4, 1e5),
            curve="coulomb({x}, {p}, slow_slip)",
            constants={"slow_slip": "0.001 m/s"},
        ),
        _input("force", TRANSLATION, ("node",), False),
        _input("velocity", TRANSLATION, ("node",), True),
        _constant("constant_force", TRANSLATION, ("node",), False, (-1e4, 1e4), "constant force, as a weight"),
        Part("inertia", ROTATION, ("node",), "stores across", "moment of inertia", "kg*m^2", (1e-8, 1e4)),
        Part("torsion_spring", ROTATION, _ENDS, "is elastic", "torsional stiffness", "N*m/rad", (1e-4, 1e8)),
        Part("rotary_damper", ROTATION, _ENDS, "conducts", "viscous damping", "N*m*s/rad", (1e-9, 1e4)),
        Part(
            "rotary_friction", ROTATION, _ENDS, "curve", "Coulomb friction", "N*m", (1e-6, 1e3),
            curve="coulomb({x}, {p}, slow_turn)",
            constants={"slow_turn": "0.1 rad/s"},
        ),
        _input("torque", ROTATION, ("node",), False),
        _input("speed", ROTATION, ("node",), True),
        _constant("constant_torque", ROTATION, ("node",), False, (-1e3, 1e3), "constant torque, as of a load"),
        Part("gear", ROTATION, ("fast", "slow"), "transforms", "turns of the first shaft for one of the second", "1",
             (0.01, 1000.0),
             second=ROTATION),
        Part("wheel", ROTATION, ("shaft", "rim"), "transforms", "radius", "m", (1e-3, 10.0), second=TRANSLATION,
             lead=True),
        Part("heat_capacity", THERMAL, ("node",), "stores across", "heat capacity", "J/K", (1e-2, 1e7)),
        Part("heat_resistance", THERMAL, _ENDS, "resists", "resistance to heat", "K/W", (1e-5, 1e4)),
        Part("heater", THERMAL, ("node",), "sets through", "heat flow for one unit of its input", "W", (1e-4, 1e5),
             given="gain"),
        _input("heat_flow", THERMAL, ("node",), False),
        _input("temperature", THERMAL, ("node",), True),
        _constant("surroundings", THERMAL, ("node",), True, (-50.0, 100.0), "temperature of the surroundings"),
        Part("tank", HYDRAULIC, ("node",), "stores across", "cross section", "m^2", (1e-5, 1e3)),
        Part("valve", HYDRAULIC, _ENDS, "curve", "effective opening (Torricelli)", "m^2", (1e-8, 1.0),
             curve="{p}*sqrt(2*gravity)*{x}/sqrt(smooth_abs({x}, small_level))", constants=_G),
        Part("pipe", HYDRAULIC, _ENDS, "resists", "resistance to laminar flow", "s/m^2", (1e-2, 1e8)),
        Part("pipe_inertia", HYDRAULIC, _ENDS, "stores through", "inertia, length/(g area)", "s^2/m^2", (1e-2, 1e8)),
        Part("pump", HYDRAULIC, _ENDS, "sets through", "flow for one unit of its input", "m^3/s", (1e-8, 1.0),
             given="gain"),
        _input("inflow", HYDRAULIC, ("node",), False),
        _input("level", HYDRAULIC, ("node",), True),
    )
}  # fmt: skip
GROUND = "0"
