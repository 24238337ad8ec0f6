"""The house: imports point one way, and importing the package stays light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import varos_warp

ROOT = Path(varos_warp.__file__).parent
ROOMS = ["kernels", "scene", "sim", "render", "dataset", "cli"]
"""Each may import itself and what stands before it, and errors."""


def imported(path: Path) -> set[str]:
    """Rooms of varos_warp that a file imports, inside functions too."""
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names = [node.module] if node.module != "varos_warp" else [f"varos_warp.{a.name}" for a in node.names]
        rooms |= {name.split(".")[1] for name in names if name.startswith("varos_warp.")}
    return rooms


@pytest.mark.parametrize("room", ROOMS)
def test_imports_point_one_way(room):
    allowed = {"errors", "__version__", *ROOMS[:ROOMS.index(room) + 1]}
    paths = sorted((ROOT / room).rglob("*.py"))
    assert paths
    for path in paths:
        assert imported(path) <= allowed, f"{path.relative_to(ROOT)} imports {imported(path) - allowed}"


def test_kernels_know_nothing_of_the_host():
    for path in (ROOT / "kernels").rglob("*.py"):
        assert imported(path) <= {"kernels"}, path.name


def test_every_room_is_in_the_order():
    rooms = {p.name for p in ROOT.iterdir() if (p / "__init__.py").is_file()}
    assert rooms == set(ROOMS)


def loaded_after(statement: str) -> set[str]:
    code = f"import sys; {statement}; print(' '.join(m.split('.')[0] for m in sys.modules))"
    return set(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split())


def test_importing_the_package_loads_nothing_heavy():
    heavy = {"warp", "numpy", "scipy", "trimesh", "matplotlib", "pyoidn", "OpenEXR", "skimage", "pydantic"}
    assert not loaded_after("import varos_warp") & heavy


def test_asking_the_command_line_for_help_does_not_load_warp():
    assert not loaded_after("import varos_warp.cli") & {"warp", "scipy", "trimesh", "matplotlib", "pyoidn"}


@pytest.mark.parametrize("name", varos_warp.__all__)
def test_every_public_name_is_there(name):
    assert getattr(varos_warp, name) is not None


def test_an_unknown_public_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = varos_warp.Nothing
