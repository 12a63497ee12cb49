"""Study files of published problems, made from their PEtab folders.

    python -m benchmarks.published_odes.from_petab FOLDER NAME...

Reads the part of SBML (level 2) and PEtab (version 1) that these six problems use. Time is taken in the problem's own
unit and called s. What conditions set become inputs that are constant in each recording. Estimated noise is left out;
replicates are averaged; outputs on a log10 scale are fitted as logarithms.
"""

import csv
import re
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

NAMES = (
    "Boehm_JProteomeRes2014", "Bruno_JExpBot2016", "Crauste_CellSystems2017", "Elowitz_Nature2000",
    "Perelson_Science1996",
    "Sneyd_PNAS2002",
)  # fmt: skip
OPERATORS = {"times": "*", "plus": "+", "minus": "-", "divide": "/", "power": "^"}


def converted(folder: Path, name: str, to: Path) -> None:
    """Write NAME.toml and a csv for each condition."""
    place, short = folder / name, name.split("_")[0].lower()
    sbml = ElementTree.parse(next(iter(place.glob("model*.xml")))).getroot()
    observables, parameters, conditions, measurements, published = (
        _table(place, kind)
        for kind in ("observables", "parameters", "experimentalCondition", "measurementData", "simulatedData")
    )
    observables = [o for o in observables if any(m["observableId"] == o["observableId"] for m in measurements)]
    own = [o["observableId"] for o in observables]
    estimated = {p["parameterId"]: p for p in parameters if int(float(p["estimate"]))}
    noise = {n for m in measurements for n in m.get("noiseParameters", "").split(";")}
    free = {n: p for n, p in estimated.items() if n not in noise}
    columns = [c for c in conditions[0] if c not in ("conditionId", "conditionName")]
    values = {p["parameterId"]: p["nominalValue"] for p in parameters}
    equations, states, inputs = _model(sbml, columns, conditions, free, values)
    for o in observables:
        formula = o["observableFormula"]
        given = next(m.get("observableParameters", "") for m in measurements if m["observableId"] == o["observableId"])
        for k, v in enumerate(given.split(";")):
            formula = formula.replace(f"observableParameter{k + 1}_{o['observableId']}", v)
        for n, v in values.items():
            formula = formula if n in free else re.sub(rf"\b{n}\b", v, formula)
        equations.append(
            f"y_{o['observableId']} = "
            + (f"log10({formula})" if o.get("observableTransformation") == "log10" else formula)
        )
    simulated = {_row(s): s for s in published}  # the two tables need not have one order
    text = [
        f"# {name} of the collection Benchmark-Models-PEtab "
        "(BSD-3-Clause), made by benchmarks/published_odes/from_petab.py"
    ]
    text.append(f'name = "{short}"\n')
    for condition in conditions:
        ident = condition["conditionId"]
        mine = [(m, simulated[_row(m)]) for m in measurements if m["simulationConditionId"] == ident]
        log = {o["observableId"] for o in observables if o.get("observableTransformation") == "log10"}
        constant = {k: f(condition) for k, f in inputs.items()}
        seen = _csv(to / f"{short}_{ident}.csv", own, mine, constant, log)
        first = min(float(m["time"]) for m, _ in mine)
        text.append(f'[recording.{ident}]\nfile = "{short}_{ident}.csv"\ntime = "t"')
        unmeasured = [f'"y_{o}"' for o in own if o not in seen]
        text += [f"unmeasured = [{', '.join(unmeasured)}]"] if unmeasured else []
        text += ["initial_time = 0"] if first > 0 else []
        text.append("")
    lines = "\n".join(equations)
    text.append(f'[model]\nequations = """\n{lines}\n"""')
    text.append(f"inputs = [{', '.join(f'{chr(34)}{i}{chr(34)}' for i in inputs)}]")
    text.append(f"outputs = [{', '.join(f'{chr(34)}y_{o}{chr(34)}' for o in own)}]\n\n[model.states]")
    text += [f'{n} = {{ initial = "{i}" }}' for n, i in states.items()]
    for n, p in free.items():
        low, high = float(p["lowerBound"]), float(p["upperBound"])
        scale = '\nscale = "log"' if p["parameterScale"].startswith("log") else ""
        text.append(f"\n[parameters.{n}]\nbounds = [{low:g}, {high:g}]{scale}\n# published: {p['nominalValue']}")
    (to / f"{short}.toml").write_text("\n".join(text) + "\n", encoding="utf-8")


def _table(place: Path, kind: str) -> list[dict[str, str]]:
    with next(iter(place.glob(f"{kind}*.tsv"))).open(encoding="utf-8") as file:
        return list(csv.DictReader(file, delimiter="\t"))


def _row(m: dict[str, str]) -> tuple[str, str, float]:
    return m["observableId"], m["simulationConditionId"], float(m["time"])


def _csv(path: Path, outputs, mine, constant, log) -> set[str]:
    """Means of replicates; the columns p_NAME hold the published simulation."""
    found: dict[float, dict[str, list[float]]] = {}
    for m, s in mine:
        for key, value in ((f"y_{m['observableId']}", m["measurement"]), (f"p_{m['observableId']}", s["simulation"])):
            number = float(value)
            number = float(np.log10(number)) if m["observableId"] in log else number
            found.setdefault(float(m["time"]), {}).setdefault(key, []).append(number)
    seen = {o for o in outputs if any(f"y_{o}" in row for row in found.values())}
    head = ["t", *(f"y_{o}" for o in outputs if o in seen), *(f"p_{o}" for o in outputs if o in seen), *constant]
    with path.open("w", encoding="utf-8", newline="") as file:
        write = csv.writer(file, lineterminator="\n")
        write.writerow(head)
        for t in sorted(found):
            means = {k: float(np.mean(v)) for k, v in found[t].items()} | constant
            write.writerow([f"{t:.12g}", *(f"{means[k]:.12g}" if k in means else "" for k in head[1:])])
    return seen


def _model(sbml, columns, conditions, free, values):
    """Equations, initial values by state, and inputs as functions of a condition."""
    for e in sbml.iter():
        e.tag = e.tag.split("}")[-1]
    sizes = {c.get("id"): c.get("size", "1") for c in sbml.iter("compartment")}
    species = {s.get("id"): s for s in sbml.iter("species")}
    rules = {r.get("variable"): _math(r.find("math")) for r in sbml.iter("assignmentRule")}
    starts = {r.get("symbol"): _math(r.find("math")) for r in sbml.iter("initialAssignment")}
    fixed = {p.get("id"): values.get(p.get("id"), p.get("value")) for p in sbml.iter("parameter")}
    fixed = {n: v for n, v in (fixed | sizes).items() if n not in free and n not in rules and n not in columns}
    inputs, replaced = {}, {}
    for c in columns:
        given = [row[c] for row in conditions]
        named = sorted({v for v in given if v in free})
        if not named:
            replaced[c] = c
            inputs[c] = lambda row, c=c: float(row[c])
            continue
        parts = []
        for n in named:
            inputs[f"{c}_{n}"] = lambda row, c=c, n=n: float(row[c] == n)
            parts.append(f"{n}*{c}_{n}")
        inputs[f"{c}_number"] = lambda row, c=c: 0.0 if row[c] in free else float(row[c])
        replaced[c] = f"({' + '.join([*parts, f'{c}_number'])})"

    def told(text: str) -> str:
        for n, v in {**fixed, **replaced}.items():
            text = re.sub(rf"\b{n}\b", lambda _, v=v: v, text)
        return text

    change: dict[str, list[str]] = {s: [] for s in species}
    rates = []
    for k, reaction in enumerate(sbml.iter("reaction")):
        rates.append(f"r{k} = {told(_math(reaction.find('kineticLaw').find('math')))}")
        for kind, sign in (("listOfReactants", "-"), ("listOfProducts", "+")):
            for ref in reaction.iterfind(f"{kind}/speciesReference"):
                count = float(ref.get("stoichiometry", "1"))
                size = float(sizes[species[ref.get("species")].get("compartment")])
                factor = count / size
                change[ref.get("species")].append(f"{sign} {'' if factor == 1 else f'{factor:.17g}*'}r{k}")
    equations = [f"{n} = {told(text)}" for n, text in rules.items()] + rates
    equations += [f"{s}' = {' '.join(parts).removeprefix('+ ') or '0'}" for s, parts in change.items()]
    states = {s: told(starts.get(s, e.get("initialConcentration") or "0")) for s, e in species.items()}
    return equations, states, inputs


def _math(node) -> str:
    """MathML as text."""
    if node.tag == "math":
        return _math(node[0])
    if node.tag == "ci":
        return node.text.strip()
    if node.tag == "csymbol":
        return "t"
    if node.tag == "cn":
        if node.get("type") == "e-notation":
            return f"{node.text.strip()}e{node[0].tail.strip()}"
        return node.text.strip()
    kind, parts = node[0].tag, [_math(n) for n in node[1:]]
    if kind in OPERATORS:
        return f"(-{parts[0]})" if kind == "minus" and len(parts) == 1 else f"({OPERATORS[kind].join(parts)})"
    return f"{ {'ln': 'log'}.get(kind, kind) }({', '.join(parts)})"


if __name__ == "__main__":
    for chosen in sys.argv[2:] or NAMES:
        converted(Path(sys.argv[1]), chosen, Path(__file__).parent / "studies")
