"""What an importer reads of the plant: modelDescription.xml of FMI 2.0."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np

import plantfit
from plantfit.bridges.plant import Plant, one_line
from plantfit.units import per_second, si_base


def description(plant: Plant, nominal: Sequence[float], guid: str) -> str:
    """modelDescription.xml; `nominal` are the sizes of the states. Value references count as `fmi2.c` says."""
    name = one_line(plant.answer.problem.name)
    step = float(np.median(np.diff(plant.t)))
    root = ET.Element(
        "fmiModelDescription", fmiVersion="2.0", modelName=name or plant.name, guid=guid,
        description=one_line(plant.story[0]),
        generationTool=f"plantfit {plantfit.__version__}", variableNamingConvention="flat", numberOfEventIndicators="0",
    )  # fmt: skip
    common = {
        "modelIdentifier": plant.name,
        "canNotUseMemoryManagementFunctions": "true",
        "canGetAndSetFMUstate": "true",
    }
    kinds = [("CoSimulation", {"canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "true"})]
    if not plant.model.delays:
        kinds.insert(0, ("ModelExchange", {}))
    for kind, more in kinds:
        files = ET.SubElement(ET.SubElement(root, kind, {**common, **more}), "SourceFiles")
        ET.SubElement(files, "File", name=f"{plant.name}_fmu.c")
    rows = variables(plant, nominal)
    given = {u: one_line(u) for u in (row["unit"] for row in rows) if u}
    if given:
        units = ET.SubElement(root, "UnitDefinitions")
        for unit, shown in given.items():
            base = si_base(unit)
            own = ET.SubElement(units, "Unit", name=shown)
            if base is not None:
                factor, offset, powers = base
                ET.SubElement(
                    own,
                    "BaseUnit",
                    {**{k: str(v) for k, v in powers.items()}, "factor": repr(factor), "offset": repr(offset)},
                )
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", name="logStatusError")
    begin, end = float(plant.t[0]), float(plant.t[-1])
    ET.SubElement(root, "DefaultExperiment", startTime=repr(begin), stopTime=repr(end), stepSize=repr(step))
    listed = ET.SubElement(root, "ModelVariables")
    for row in rows:
        own = {"name": row["name"], "valueReference": str(row["reference"]), **row["kind"]}
        if row["description"]:
            own["description"] = one_line(row["description"])
        unit = {"unit": given[row["unit"]]} if row["unit"] else {}
        ET.SubElement(ET.SubElement(listed, "ScalarVariable", own), "Real", {**row["real"], **unit})
    structure = ET.SubElement(root, "ModelStructure")
    places = {what: [k + 1 for k, row in enumerate(rows) if row["what"] == what] for what in ("rate", "output")}
    for tag, own in (
        ("Outputs", places["output"]),
        ("Derivatives", places["rate"]),
        ("InitialUnknowns", places["rate"] + places["output"]),
    ):
        held = ET.SubElement(structure, tag)
        for k in own:
            ET.SubElement(held, "Unknown", index=str(k))
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def variables(plant: Plant, nominal: Sequence[float]) -> list[dict[str, Any]]:
    """A row for each variable in the order of value references: `what`, `reference`, name, unit, description,
    attributes of the variable and of its real number. Inputs before the start are there where a dead time reads
    them."""
    model, states = plant.model, list(plant.vector.states)
    late, read = {d.parameter for d in model.delays}, {d.input for d in model.delays}
    rows: list[dict[str, Any]] = []
    errors = {row["name"]: row["standard_error"] for row in plant.answer.findings["parameters"]}
    names = _names(plant)
    groups = {
        "parameter": [p.name for p in model.parameters], "before": model.inputs, "input": model.inputs, "state": states,
        "rate": states,
        "output": plant.vector.outputs,
    }  # fmt: skip
    references = {key: k for k, key in enumerate((what, n) for what, members in groups.items() for n in members)}

    def add(what: str, name: str, unit: str | None, kind: Sequence[str], real: dict[str, str], told: str = "") -> None:
        attributes = dict(zip(("causality", "variability", "initial"), kind, strict=False))
        own = {
            "what": what,
            "reference": references[what, name],
            "name": names[what, name],
            "unit": unit,
            "description": told,
        }
        rows.append({**own, "kind": attributes, "real": real})

    for d in model.parameters:
        error = errors.get(d.name)
        kind, real = (
            ("parameter", "fixed" if d.name in late else "tunable", "exact"),
            {"start": repr(float(plant.p[d.name]))},
        )
        add("parameter", d.name, d.unit, kind, real, f"standard error {error:.3g}" if error else "")
    for n in (n for n in model.inputs if n in read):
        real = {"start": repr(float(plant.before[n]))}
        add(
            "before",
            n,
            model.inputs[n],
            ("parameter", "fixed", "exact"),
            real,
            "the input before the start, for its dead time",
        )
    for n, unit in model.inputs.items():
        add("input", n, unit, ("input", "continuous"), {"start": repr(float(plant.inputs[n][0]))})
    first = len(rows) + 1
    for n, size in zip(states, nominal, strict=True):
        real = {"start": repr(float(plant.x0[n])), "nominal": repr(float(size))}
        add("state", n, model.states[n], ("local", "continuous", "exact"), real)
    for k, n in enumerate(states):
        unit = model.states[n]
        add(
            "rate",
            n,
            per_second(unit) if unit else None,
            ("local", "continuous", "calculated"),
            {"derivative": str(first + k)},
        )
    for n, unit in model.outputs.items():
        add("output", n, unit, ("output", "continuous", "calculated"), {})
    return rows


def _names(plant: Plant) -> dict[tuple[str, str], str]:
    """A name of its own for each variable; a state that is called as an output gives way to it."""
    model, states = plant.model, plant.vector.states
    groups = {
        "parameter": (p.name for p in model.parameters),
        "input": model.inputs,
        "output": model.outputs,
        "state": states,
    }
    found = {(what, n): one_line(n) for what, names in groups.items() for n in names}
    found |= {("rate", n): f"der({found['state', n]})" for n in states} | {
        ("before", n): f"before({found['input', n]})" for n in model.inputs
    }
    taken: set[str] = set()
    for key, name in found.items():
        while name in taken:
            name = f"{key[0]}({name})"
        taken.add(name)
        found[key] = name
    return found
