"""The simulation of the recording and the parameters as CSV."""

import re

import numpy as np

from plantfit.bridges.plant import Plant


def csv_tables(plant: Plant) -> dict[str, str | bytes]:
    """Files by name: NAME_simulated.csv and NAME_parameters.csv."""
    predicted = plant.answer.predict(plant.recording)
    own = plant.answer.problem.experiments[plant.recording].recording
    columns = {"t [s]": plant.t}
    for names, ending in ((plant.model.inputs, ""), (plant.model.outputs, "")):
        columns |= {f"{n}{ending} [{u or '-'}]": np.asarray(own[n]) for n, u in names.items() if n in own.signals}
    columns |= {f"{n}_simulated [{plant.model.outputs[n] or '-'}]": y for n, y in predicted.items()}
    table = np.column_stack(list(columns.values()))
    rows = [
        ",".join(_cell(c) for c in columns),
        *(",".join(repr(float(v)) if np.isfinite(v) else "" for v in row) for row in table),
    ]
    found = ["parameter,value,unit,standard_error"]
    for row in plant.answer.findings["parameters"]:
        error = row["standard_error"]
        found.append(
            ",".join(
                [_cell(row["name"]), repr(row["value"]), _cell(row["unit"] or ""), "" if error is None else repr(error)]
            )
        )
    return {
        f"{plant.name}_simulated.csv": "\n".join(rows) + "\n",
        f"{plant.name}_parameters.csv": "\n".join(found) + "\n",
    }


def _cell(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if re.search(r'[",\n]', text) else text
