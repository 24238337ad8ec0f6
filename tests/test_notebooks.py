"""The notebooks of examples/notebooks run from an empty folder, tiny; they are short, and stored without outputs."""

import io
import json
import re
import shutil
import subprocess
import sys
from contextlib import redirect_stdout
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from typer.testing import CliRunner

from varos_warp.cli import app

ROOT = Path(__file__).parents[1]
BOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
MOST_LINES = 60
IN_JUPYTER = "make_a_dataset"
"""The notebook that runs as users have it, as do the commands in it. The others run in the process of the tests."""


def cells(path: Path, kind: str) -> list[dict]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


def in_jupyter(path: Path, place: Path) -> tuple[int, str]:
    """How many pictures a notebook shows and what it prints, by a kernel of its own."""
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    book = nbformat.read(shutil.copy(path, place), as_version=4)
    nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(place)}}).execute()
    shown = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [output for output in shown if output.output_type == "error"]
    text = "".join(output.text for output in shown if output.output_type == "stream" and output.name == "stdout")
    return sum("image/png" in output.get("data", {}) for output in shown), text


def run_here(line, check=False, stdout=None):
    """As subprocess.run a verb of varos-warp, without the seconds in which a process starts."""
    assert line[:3] == [sys.executable, "-m", "varos_warp"]
    result = CliRunner().invoke(app, line[3:])
    assert result.exit_code == 0, result.output
    return subprocess.CompletedProcess(line, 0, result.stdout)


def in_this_process(path: Path, place: Path) -> tuple[int, str]:
    """The same of cells that are plain Python, with names of their own: each figure that is left open is shown."""
    names, said = {"__name__": "__main__"}, io.StringIO()
    plt.switch_backend("agg")
    plt.close("all")
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(said):
        patch.chdir(place)
        patch.setattr(subprocess, "run", run_here)
        for i, cell in enumerate(cells(path, "code")):
            exec(compile("".join(cell["source"]), f"{path.name}, cell {i}", "exec"), names)
    pictures = len(plt.get_fignums())
    plt.close("all")
    return pictures, said.getvalue()


@pytest.mark.parametrize("path", BOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_pictures(path, tmp_path, monkeypatch):
    """In a folder that holds nothing else."""
    monkeypatch.setenv("VAROS_NOTEBOOK", "tiny")
    pictures, text = (in_jupyter if path.stem == IN_JUPYTER else in_this_process)(path, tmp_path)
    assert pictures >= 2
    if path.stem == "depth_from_colour":
        error, constant = map(int, re.search(r"mean error (\d+) % of the depth; (\d+) %", text).groups())
        assert 0 <= error < constant
    if path.stem == "colour_by_layers":
        kept = [float(value) for value in re.findall(r"(?:red|green|blue) (\d\.\d\d)", text)]
        assert len(kept) == 9
        assert all(0.0 < value < 1.0 for value in kept)


@pytest.mark.parametrize("path", BOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_stored_without_outputs_and_is_short(path):
    code = cells(path, "code")
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    lines = [line for cell in code for line in "".join(cell["source"]).splitlines() if line.strip()]
    assert len(lines) <= MOST_LINES
    assert {line for line in lines if re.match(r"\s*(from|import) varos_warp", line)} == {"import varos_warp as vw"}


def test_the_page_lists_every_notebook():
    text = (ROOT / "docs" / "howto" / "notebooks.md").read_text(encoding="utf-8")
    assert BOOKS
    assert set(re.findall(r"notebooks/(\w+)\.ipynb", text)) == {path.stem for path in BOOKS}
