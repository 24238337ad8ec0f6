"""The notebooks of examples/notebooks run from an empty folder, tiny; they are short, and stored without outputs."""

import json
import re
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))
MOST_LINES = 60
BY_PROCESSES = "make_a_dataset"
"""The notebook whose commands run as users have them."""
IN_ITS_PROCESS = """
import subprocess
import sys
from typer.testing import CliRunner
from varos_warp.cli import app

run = subprocess.run

def run_here(line, **how):
    if line[:3] != [sys.executable, "-m", "varos_warp"]:
        return run(line, **how)
    result = CliRunner().invoke(app, line[3:])
    assert result.exit_code == 0, result.output
    return subprocess.CompletedProcess(line, 0, result.stdout)

subprocess.run = run_here
"""
"""A cell before all others, after which verbs of varos-warp run without the seconds in which a process starts."""


def cells(path: Path, kind: str) -> list[dict]:
    return [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == kind]


@pytest.fixture(scope="module", params=BOOKS, ids=lambda path: path.stem)
def executed(request, tmp_path_factory):
    """A notebook after it was run in a folder that holds nothing else, and that folder."""
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    pytest.importorskip("ipykernel")
    place = tmp_path_factory.mktemp(request.param.stem)
    book = nbformat.read(shutil.copy(request.param, place), as_version=4)
    if request.param.stem != BY_PROCESSES:
        book.cells.insert(0, nbformat.v4.new_code_cell(IN_ITS_PROCESS))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VAROS_NOTEBOOK", "tiny")
        nbclient.NotebookClient(book, timeout=300, resources={"metadata": {"path": str(place)}}).execute()
    return request.param.stem, book, place


def test_a_notebook_runs_and_shows_pictures(executed):
    name, book, _ = executed
    shown = [output for cell in book.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [output for output in shown if output.output_type == "error"], name
    assert sum("image/png" in output.get("data", {}) for output in shown) >= 2, name
    text = "".join(output.text for output in shown if output.output_type == "stream" and output.name == "stdout")
    if name == "depth_from_colour":
        error, constant = map(int, re.search(r"mean error (\d+) % of the depth; (\d+) %", text).groups())
        assert 0 <= error < constant
    if name == "colour_by_layers":
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
