"""The steam chamber by name: steps of its valve, by the tables of one opening or by constants of the user's own."""

from collections.abc import Mapping
from dataclasses import replace
from json import dumps
from typing import Any

import numpy as np

from plantfit.errors import SimulationError
from plantfit.recording.record import Recording
from plantfit.rig.offered.contract import Asked, Number, OfferedRig, RigRecord, truth_of
from plantfit.rig.offered.driven import driven_by
from plantfit.rig.steam_chamber import NODES, SteamChamberRig, smooth_truth

PLANT = {"k": "bar/%", "A1": "s", "A2": "s^2", "Td": "s"}
_SAID = "; with all four of k, A1, A2, Td given the plant is the same at every opening, else tables of the opening"


def _numbers() -> tuple[Number, ...]:
    return (
        Number("k", PLANT["k"], None, f"static gain{_SAID}"),
        Number("A1", PLANT["A1"], None, "damping: y'' A2 + y' A1 + y = k u(t - Td)"),
        Number("A2", PLANT["A2"], None, "inertia of the response"),
        Number("Td", PLANT["Td"], None, "dead time of the valve", open=False, most=30.0),
        Number(
            "tables_of",
            "%",
            None,
            "the tables of this opening at every opening, so that the valve may move under pressure",
            most=100.0,
        ),
        Number("noise", "bar", 0.05, "rms noise of a sample", "noise", open=False),
        Number("bits", "1", 12, "bits of the input card", "noise", least=4, open=False, most=24, whole=True),
        Number(
            "transducer_limit",
            "%",
            0.1,
            "limit of the transducer's error, of full scale",
            "noise",
            open=False,
            most=10.0,
        ),
        Number("card_limit", "%", 0.3, "limit of the card's error, of full scale", "noise", open=False, most=10.0),
        Number("drift", "1", 0.0, "rms share by which the supply wanders", "noise", open=False, most=0.5),
        Number("span", "bar", 39.0, "full scale of the transducer", "setting"),
        Number("valve_rate", "%/s", None, "fastest move of the valve; at once unless given", "setting"),
    )


def _record(asked: Asked) -> RigRecord:
    n = asked.numbers
    period, duration = asked.period or RIG.period, asked.duration
    own = [name for name in PLANT if name in asked.given]
    if own and "tables_of" in n:
        raise SimulationError(f"Rig 'steam_chamber': {own[0]} and tables_of are given; give one plant.")
    if own and len(own) < len(PLANT):
        lacking = next(p for p in PLANT if p not in own)
        raise SimulationError(
            f"Rig 'steam_chamber': {own[0]} is given, but {lacking} is not; give all of {', '.join(PLANT)}, or none."
        )
    limits = {"pressure transducer": n["transducer_limit"], "analog input card": n["card_limit"]}
    rig = SteamChamberRig(
        span=n["span"], bits=int(n["bits"]), noise=n["noise"], error_limits=limits, errors=any(limits.values()),
        drift=n["drift"],
        valve_rate=n.get("valve_rate", np.inf), period=period,
    )  # fmt: skip
    drive, driven = driven_by(asked.excitation or "40%", "u", "%", duration or (RIG.duration if own else _LONG), period)
    openings = np.asarray(drive["u"])
    if own:
        flat = {name: n[name] if name == "Td" else np.full(len(NODES), n[name]) for name in PLANT}
        rig = replace(rig, truth=lambda _: flat)
    elif "tables_of" in n:
        shared = smooth_truth(n["tables_of"])
        rig = replace(rig, truth=lambda _: shared)
    elif len(np.unique(openings)) > 1:
        raise SimulationError(
            f"Rig 'steam_chamber': the valve takes {len(np.unique(openings))} openings, "
            f"but the rig's tables belong to one; give {', '.join(PLANT)} for a plant "
            "that is the same at all, tables_of for tables that are, or one opening."
        )
    moves = bool(own) or "tables_of" in n
    run = rig.record(
        drive if moves else float(openings[0]),
        asked.seed,
        float(drive.t[-1] - drive.t[0]) if _lasts(asked, own) else None,
    )
    asked = asked._replace(duration=float(run.recording.t[-1]))
    units = PLANT
    determined: dict[str, Any] = {p: {"value": run.truth["parameters"][p], "unit": units[p]} for p in PLANT}
    if own:
        determined = {p: {"value": n[p], "unit": units[p]} for p in PLANT}
    else:
        determined |= {"nodes": {"value": NODES.tolist(), "unit": "bar"}}
    recording = run.recording
    if not own and len(np.unique(openings)) == 1:
        recording = replace(recording, log=(*recording.log, _ONCE))
    truth = truth_of(RIG, asked, {"instrument_errors_bar": run.truth["instrument_errors_bar"]}, determined, driven)
    return RigRecord(recording, run.exact, truth, lambda file, name: _study(file, name, n, bool(own)))


_LONG = 300.0
_ONCE = (
    "One step passes each pressure once: of the tables it tells part of the entries, and sums of the others. Openings "
    "that change under "
    "pressure tell them apart (--set tables_of=40% --excitation 10%,25%,15%)."
)


def _lasts(asked: Asked, own: list[str]) -> bool:
    return bool(own) or asked.duration is not None or isinstance(asked.excitation, Recording)


_CONSTANTS = """\
[model]
equations = \"\"\"
x1' = x2
x2' = (k*delay(u, Td) - x1 - A1*x2)/A2
y = x1
\"\"\"
inputs = { u = "%" }
states = { x1 = { unit = "bar", initial = 0 }, x2 = { unit = "bar/s", initial = 0 } }
outputs = { y = "bar" }

[parameters.k]
bounds = [0.001, 20.0]
unit = "bar/%"
scale = "log"

[parameters.A1]
bounds = [0.1, 1000.0]
unit = "s"
scale = "log"

[parameters.A2]
bounds = [0.1, 1e5]
unit = "s^2"
scale = "log"

[parameters.Td]
bounds = [0.0, 30.0]
unit = "s"
"""


def _study(file: str, name: str, n: Mapping[str, float], constants: bool) -> str:
    told = "Steps of a steam chamber's valve from rest" + (
        ": four constants." if constants else ": tables over the pressure, a dead time."
    )
    model = _CONSTANTS if constants else '[model]\nkind = "steam_chamber"\n'
    text = "".join(f"# {line}\n" for line in told.splitlines()) + f"# Run it with:  plantfit run {name}.toml\n"
    text += f"name = {dumps(name, ensure_ascii=False)}\n\n[recording.steps]\nfile = {dumps(file, ensure_ascii=False)}\n"
    text += f"before = {{ u = 0.0 }}    # the valve was closed\n\n{model}"
    for key, limit, said in (
        ("transducer", n["transducer_limit"], "pressure transducer"),
        ("card", n["card_limit"], "input card"),
    ):
        if limit:  # the error at full scale less that at zero: two even errors make a triangular one
            text += (
                f"\n[uncertainty.{key}]  # {said}: {limit:g} % of span at "
                "zero and at full scale; its zero was set before the step\n"
            )
            text += (
                f'of = "y"\nkind = "full scale"\nlimit = {2 * limit!r}\nunit = "%"\nspan = {n["span"]!r}\nshape = '
                f'"triangular"\n'
            )
    search = (
        ""
        if constants or "tables_of" not in n
        else 'methods = ["least_squares"]  # 31 parameters with exact derivatives\nruns = 1\n'
    )
    return f"{text}\n[search]\nseed = 1\n{search}"


RIG = OfferedRig(
    "steam_chamber",
    "Steps of a valve into a steam-filled chamber: the opening, and the pressure by a transducer and its card.",
    _numbers(),
    _record,
    duration=_LONG,
    period=0.1,
    excitation="an opening from rest (40%), several one after another (20%,60%,30%,80%), or a CSV file with a signal u",
)
