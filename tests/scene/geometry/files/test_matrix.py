"""The table of docs/meshes.md: each of its cells is what happens.

A case makes a file in a folder and returns its path, and perhaps a function that looks at the mesh that comes of it.
"""

import re
import warnings
from pathlib import Path

import pytest
from mesh_cases import colours, damage, geometry  # noqa: F401  they register their cases
from mesh_cases.table import CASES

from varos_warp.errors import InputError
from varos_warp.scene.geometry.mesh_files import load_mesh

PAGE = Path(__file__).parents[4] / "docs" / "meshes.md"


def cells() -> list[tuple[str, str, str]]:
    """Feature, format and what happens, of all cells that say something."""
    lines = [
        [cell.strip() for cell in line.strip().strip("|").split("|")]
        for line in PAGE.read_text().splitlines()
        if line.startswith("|") and "---" not in line
    ]
    (_, *formats), *table = lines
    return [
        (feature, kind, word)
        for feature, *words in table
        for kind, word in zip(formats, words, strict=True)
        if word != "–"
    ]


def made(make, kind, folder):
    """Path and what to look at, of a case."""
    result = make(folder) if make.__code__.co_argcount == 1 else make(folder, kind)
    return result if isinstance(result, tuple) else (result, lambda mesh: None)


@pytest.mark.parametrize(("feature", "kind", "word"), cells(), ids=lambda x: x)
def test_what_the_table_says_happens(tmp_path, monkeypatch, feature, kind, word):
    monkeypatch.setenv("VAROS_WARP_MAX_TEXTURE_PIXELS", "10000")
    for number, (make, says) in enumerate(CASES[feature, kind]):
        folder = tmp_path / str(number)
        folder.mkdir()
        path, check = made(make, kind, folder)
        up = "z" if kind == "glTF" and feature != "up axis and unit" else None
        if word == "refused":
            with pytest.raises(InputError, match=says) as refusal:
                load_mesh(path, "objects.0.file", up)
            assert "objects.0.file" in refusal.value.message
            assert refusal.value.remedy
            continue
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            mesh = load_mesh(path, "objects.0.file", up)
        words = [str(warning.message) for warning in told]
        assert bool(words) == (word == "warned"), words
        assert all(text.startswith(f"objects.0.file: {path.name}: ") for text in words)
        if says:
            assert re.search(says, words[0])
        check(mesh)


def test_every_case_is_in_the_table():
    assert set(CASES) == {(feature, kind) for feature, kind, _ in cells()}
