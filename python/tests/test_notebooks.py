"""The notebooks, from the first cell to the last, against a simulated cell; what they claim they assert themselves."""

import os
from pathlib import Path

import nbclient
import nbformat
import pytest
from traitlets.config import Config

FOLDER = Path(__file__).parents[1] / "notebooks"
NAMES = sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def read(name):
    return nbformat.read(FOLDER / f"{name}.ipynb", as_version=4)


def test_there_are_ten_without_outputs():
    assert len(NAMES) == 10
    for name in NAMES:
        notebook = read(name)
        nbformat.validate(notebook)
        code = [cell for cell in notebook.cells if cell.cell_type == "code"]
        assert not any(cell.outputs or cell.execution_count for cell in code), f"{name} has outputs: clear them"
        assert sum(len(cell.source.splitlines()) for cell in code) <= 60, f"{name} is too long to be read"
        assert "assert " in code[-1].source, f"{name} proves nothing"


@pytest.mark.parametrize("name", NAMES)
def test_notebook(name, request, programs, monkeypatch):
    two_arms = "two-arms" in name
    cell = request.getfixturevalue("two_arms" if two_arms else "cell_name")
    if not two_arms:
        request.getfixturevalue("cell")  # What a failed notebook leaves is cleared away.
    monkeypatch.setenv("RCC_CELL", cell)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")
    # Sockets in a folder instead of TCP.
    config = Config({"KernelManager": {"transport": "ipc"}})
    nbclient.NotebookClient(read(name), timeout=120, kernel_name="python3", config=config).execute()
