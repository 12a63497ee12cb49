"""The Functional Mock-up Unit as one archive: description, sources, and a binary where a C compiler is there."""

import io
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import uuid
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np

import plantfit.runtime  # noqa: F401
from plantfit.bridges.c_code import c_code
from plantfit.bridges.fmu.description import description
from plantfit.bridges.plant import Plant
from plantfit.errors import PlantfitWarning

_PRELUDE = """#include "{name}_plant.c"

#define PARAMETERS {k}
#define INPUTS {m}
#define STATES {n}
#define OUTPUTS {q}
#define DELAYS {d}
#define MODEL(what) {name}_##what
#define GUID "{guid}"

static const double first_inputs[] = {{{first}}};
static const double nominal[] = {{{nominal}}}; /* the largest size of each state in the recording */
static const int delay_places[] = {{{places}}}; /* which parameters are dead times */

"""
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the same study writes the same bytes
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-fvisibility=hidden", "-shared")


def functional_mockup_unit(plant: Plant) -> dict[str, str | bytes]:
    """Files by name: NAME.fmu, FMI 2.0 for co-simulation, and for model exchange where the plant has no dead time.

    Warns with a sentence where no binary for this machine can be compiled; the importer compiles the sources then.
    """
    # over a step an input goes on with the derivative that the importer gives it, or keeps its value
    sources: dict[str, str | bytes] = c_code(replace(plant, hold=dict.fromkeys(plant.model.inputs, "linear")))
    nominal = _sizes(plant)
    rest = resources.files("plantfit.bridges.fmu").joinpath("fmi2.c").read_text("utf-8")
    told = description(plant, nominal, "")
    guid = str(uuid.uuid5(uuid.NAMESPACE_URL, "\n".join([told, *map(str, sources.values()), rest])))
    numbers = {"first": [plant.inputs[n][0] for n in plant.model.inputs], "nominal": nominal}
    order = [p.name for p in plant.model.parameters]
    prelude = _PRELUDE.format(
        name=plant.name, guid=guid, k=len(order), m=len(plant.model.inputs), n=len(nominal),
        q=len(plant.vector.outputs),
        d=len(plant.model.delays), places=", ".join(str(order.index(d.parameter)) for d in plant.model.delays) or "0",
        **{what: ", ".join(repr(float(v)) for v in values) or "0.0" for what, values in numbers.items()},
    )  # fmt: skip
    sources[f"{plant.name}_fmu.c"] = prelude + rest
    held = {"modelDescription.xml": description(plant, nominal, guid)} | {
        f"sources/{n}": text for n, text in sources.items()
    }
    held |= _binary(plant.name, sources)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.comment = b"plantfit"
        for place, content in held.items():
            entry = zipfile.ZipInfo(place, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return {f"{plant.name}.fmu": buffer.getvalue()}


def _sizes(plant: Plant) -> list[float]:
    """The largest size of each state in the recording, 1 where it has none."""
    predictor, experiment = plant.answer.problem.predictor, plant.answer.problem.experiments[plant.recording]
    assert predictor.simulator is not None  # of a plant that is exported
    states = predictor.simulator.states(plant.p, predictor.drive(experiment))
    sizes = [float(np.max(np.abs(np.asarray(x)))) for x in states]
    return [size if np.isfinite(size) and size > 0 else 1.0 for size in sizes]


def _binary(name: str, sources: Mapping[str, str | bytes]) -> dict[str, bytes]:
    """binaries/PLATFORM/NAME.so or the like by its place, or nothing and a warning."""
    system = {"linux": ("linux", ".so"), "darwin": ("darwin", ".dylib"), "win32": ("win", ".dll")}.get(sys.platform)
    intel = platform.machine().lower() in ("x86_64", "amd64")
    compiler = next(
        (found for word in (os.environ.get("CC"), "cc", "gcc", "clang") if word and (found := shutil.which(word))), None
    )
    # FMI 2.0 has no name for Linux and Windows on other processors
    if system is None or not (intel or sys.platform == "darwin"):
        return _without(
            f"FMI 2.0 has no name for the binaries of this machine ({platform.system()} on {platform.machine()})"
        )
    if compiler is None:
        return _without("no C compiler is on this machine (cc, gcc or clang)")
    folder, ending = f"{system[0]}64", system[1]
    with tempfile.TemporaryDirectory() as place:
        for file, text in sources.items():
            (Path(place) / file).write_bytes(text if isinstance(text, bytes) else text.encode())
        made = subprocess.run(
            [compiler, *_FLAGS, "-o", f"{name}{ending}", f"{name}_fmu.c", "-lm"],
            cwd=place,
            capture_output=True,
            text=True,
            check=False,
        )
        if made.returncode:
            return _without(
                f"{compiler} did not compile it ({(made.stderr.strip().splitlines() or ['no reason given'])[0]})"
            )
        return {f"binaries/{folder}/{name}{ending}": (Path(place) / f"{name}{ending}").read_bytes()}


def _without(why: str) -> dict[str, bytes]:
    warnings.warn(
        f"The FMU has sources and no binary, because {why}; an importer "
        "has to compile them, or export it where a compiler is.",
        PlantfitWarning, stacklevel=2,
    )  # fmt: skip
    return {}
