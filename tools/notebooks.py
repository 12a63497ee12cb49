"""`make notebooks`: run the notebooks of docs/ and keep what they print and draw; `executed` is also what the tests call."""

import os
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "notebooks"
KEPT = {"text/plain", "image/png"}  # what a page of the docs and a reader on the web can show


def notebooks() -> list[Path]:
    """The notebooks, by name."""
    return sorted(FOLDER.glob("*.ipynb"))


def executed(path: Path) -> nbformat.NotebookNode:
    """A notebook with new outputs, without the times and identifiers that change from run to run. Raises nbclient's CellExecutionError."""
    book = nbformat.read(path, as_version=4)
    environment = {"PYTHONPATH": str(FOLDER.parents[1] / "src"), "MPLBACKEND": "module://matplotlib_inline.backend_inline"}
    client = NotebookClient(book, timeout=900, kernel_name="python3", resources={"metadata": {"path": str(FOLDER)}})
    client.execute(env={**os.environ, **environment})
    for cell in book.cells:
        cell.metadata = {}
        for output in cell.get("outputs", []):
            if "data" in output:
                output.data = {kind: data for kind, data in output.data.items() if kind in KEPT}
                if "image/png" in output.data:
                    output.data.pop("text/plain", None)
                output.metadata = {}
        cell.outputs = [o for o in cell.get("outputs", []) if o.get("name") != "stderr"] if cell.cell_type == "code" else None
        if cell.cell_type != "code":
            del cell["outputs"]
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    book.metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    return book


if __name__ == "__main__":
    for place in [FOLDER / f"{name}.ipynb" for name in sys.argv[1:]] or notebooks():
        nbformat.write(executed(place), place)
        print(f"{place.name}: run, outputs kept")
