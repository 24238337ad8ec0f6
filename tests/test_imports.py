"""The house: imports point one way, no circles, and importing the package stays light."""

import ast
import json
import re
import subprocess
import sys
import tomllib
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
import standins
import yaml

import varos_warp
from varos_warp.cli.app import SECOND_WING
from varos_warp.dataset.run.produce import produce
from varos_warp.scene.file.load import load_scene

ROOT = Path(varos_warp.__file__).parent
ORDER = {
    "": [
        "kernels",
        "device",
        "scene.block",
        "scene.frames",
        "scene.seawater",
        "sim.motion",
        "products.sensors",
        "scene",
        "sim",
        "products.images",
        "render",
        "dataset",
        "cli",
    ],
    "products": ["sensors", "images"],
    "kernels": ["world", "mesh", "film", "field", "transport", "particles"],
    "kernels.world": ["lights"],
    "scene": [
        "optics",
        "calibration",
        "description",
        "file",
        "courses",
        "water",
        "spectra",
        "lights",
        "geometry",
        "materials",
    ],
    "scene.geometry": ["survey", "files", "terrain", "assets", "relief", "growth"],
    "scene.geometry.relief": ["recipes"],
    "scene.geometry.assets": ["structures"],
    "scene.geometry.files": ["gltf"],
    "scene.water": ["phase"],
    "dataset.export": ["shared"],
    "dataset.readiness": ["frames", "odometry"],
    "sim": ["sensors", "vehicle"],
    "render": ["field", "image", "particles", "planner"],
    "dataset": ["reader", "write", "export", "validate", "report", "readiness", "run", "sweep"],
}
"""Rooms inside each room: each may import itself and what stands before it. Files beside them (scene/device.py) are
held only to there being no circle. A name with a dot is a file or room whose place is not that of what it lies in."""


@cache
def imports() -> dict[str, set[str]]:
    """Modules of the package by name without ``varos_warp.``, and those each imports, inside functions too."""
    paths = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in sorted(ROOT.rglob("*.py"))}
    paths = {re.sub(r"\.?__init__$", "", name): path for name, path in paths.items()}
    return {name: {module for module in _imported(path, set(paths)) if module in paths} for name, path in paths.items()}


@cache
def statements(path: Path) -> list[ast.Import | ast.ImportFrom]:
    """Everything that a file imports, inside functions too."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    return [node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]


def _imported(path: Path, modules: set[str]) -> set[str]:
    """What a file imports of the package; ``from a import b`` is a.b where that is a module."""
    names = set()
    for node in statements(path):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        else:
            assert node.level == 0, f"{path}: relative import"
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    inside = {name.partition("varos_warp.")[2] for name in names if name.startswith("varos_warp.")}
    return {name if name in modules else name.rpartition(".")[0] for name in inside}


def against(order: list[str], parent: str) -> set[tuple[str, str]]:
    """Imports between the rooms inside ``parent`` that point from an earlier one to a later."""

    def place(module: str) -> int | None:
        inside = module.removeprefix(f"{parent}.") if parent else module
        if parent and inside == module:
            return None
        names = inside.split(".")
        known = (".".join(names[:count]) for count in range(len(names), 0, -1))  # the most exact name counts
        return next((order.index(name) for name in known if name in order), None)

    return {
        (one, other)
        for one, others in imports().items()
        for other in others
        if place(one) is not None and place(other) is not None and place(other) > place(one)
    }


def test_imports_point_one_way():
    assert set().union(*(against(order, parent) for parent, order in ORDER.items())) == set()


def test_every_room_is_in_the_order():
    rooms = {"": set()} | {parent: set() for parent in ORDER}
    for path in ROOT.rglob("__init__.py"):
        parts = path.parent.relative_to(ROOT).parts
        if parts:
            rooms.setdefault(".".join(parts[:-1]), set()).add(parts[-1])
    assert rooms == {parent: {name.split(".")[0] for name in order} for parent, order in ORDER.items()}


def contract() -> str:
    """ORDER as a table of Markdown."""
    rows = [
        f"| `{parent.replace('.', '/') or 'varos_warp'}/` | {' · '.join(order)} |" for parent, order in ORDER.items()
    ]
    return "\n".join(["| in | may import itself and what stands before it |", "|---|---|", *rows])


def test_the_architecture_page_shows_the_order():
    """Where it does not, the left side is what belongs there."""
    assert contract() in (ROOT.parent / "docs" / "architecture.md").read_text(encoding="utf-8")


def test_no_modules_import_each_other_in_a_circle():
    """Packages count as what their ``__init__`` imports; TYPE_CHECKING imports count too."""
    graph = {name: set(others) for name, others in imports().items()}
    graph.pop("", None)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" is imported by ".join(error.args[1]))


def test_kernels_know_nothing_of_the_host():
    for name, others in imports().items():
        if name.split(".")[0] == "kernels":
            assert {other.split(".")[0] for other in others} <= {"kernels"}, name


def test_the_package_knows_nothing_of_benchmarks_and_tests():
    for path in ROOT.rglob("*.py"):
        for node in statements(path):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else [node.module]
            assert not {name.split(".")[0] for name in names} & {"benchmarks", "tests"}, path


def test_nothing_changes_where_modules_are_looked_for():
    repository = ROOT.parent
    for folder in ("varos_warp", "benchmarks", "tests"):
        for path in (repository / folder).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            assert not re.search(r"sys\.path(?:\.(?:append|insert|extend)|\s*\+?=|\[)", text), path


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
    found = getattr(varos_warp, name)
    assert found.__name__ == name
    assert f"{found.__module__}.".startswith(f"{varos_warp._HOMES[name]}.")


def test_an_unknown_public_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = varos_warp.Nothing


def test_one_version_everywhere():
    repository = ROOT.parent
    project = tomllib.loads((repository / "pyproject.toml").read_text())["project"]
    cited = yaml.safe_load((repository / "CITATION.cff").read_text())
    assert varos_warp.__version__ == project["version"] == cited["version"]


def test_the_stability_map_runs_without_the_paths_of_pytest():
    """It looks through the camera of tests/physics/rig.py."""
    subprocess.run([sys.executable, "-c", "import benchmarks.stability.transport_media"], cwd=ROOT.parent, check=True)


def test_threads_that_colour_pictures_are_not_the_first_to_import_matplotlib():
    """Its parts import each other: one of two that began at once failed, as in the report of a dataset of one frame."""
    assert "matplotlib" in loaded_after("import varos_warp.dataset.write.pictures")


WITHOUT = f"""
import sys

class LeftOut:
    def find_spec(self, name, path=None, target=None):
        if name.startswith({SECOND_WING}):
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, LeftOut())
"""


def without(commands, more=""):
    """What the command line says without the second wing, (status, stdout, stderr), to each of some commands."""
    words = [[str(word) for word in command] for command in commands]
    code = f"""{WITHOUT}
import json
from typer.testing import CliRunner
from varos_warp.cli import app
results = [CliRunner().invoke(app, words) for words in {words}]
{more}
print(json.dumps([(result.exit_code, result.stdout, result.stderr) for result in results]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A scene, a dataset of it that was made and read without the second wing, and what was said to what needs that."""
    folder = tmp_path_factory.mktemp("without")
    scene, out = folder / "scene.yaml", folder / "out"
    scene.write_text("""
trajectory: {poses: [{position: [0, 0, 0]}]}
terrain: {kind: procedural, resolution: 17}
water: {coefficients: {sigma_s: [0.002, 0.02, 0.04], sigma_a: [0.12, 0.04, 0]}}
vehicle:
  cameras: [{id: M0, resolution: [32, 18]}]
  lights: [{kind: spot, position: [0.2, 0, 0], direction: [0, 1, 0]}]
render: {spp: 1, integrator: path, outputs: [A, B, C, D, S]}
""")
    read = f"import varos_warp\nassert varos_warp.Dataset({str(out)!r})[0].D.shape == (18, 32)"
    asked = needing_the_second_wing(scene, out, folder / "not")
    told, *answers = without([("run", scene, "-o", out, "--device", "cpu"), *asked.values(), ("info", scene)], read)
    assert told[0] == 0, told
    return scene, out, dict(zip([*asked, "info"], answers, strict=True))


def test_datasets_are_made_and_read_without_the_second_wing(made):
    assert (made[1] / "contact_sheet.png").exists()


def test_what_is_made_without_the_second_wing_is_what_is_made_with_it(made, tmp_path):
    scene, out, _ = made
    produce(load_scene(scene), tmp_path / "out", device="cpu", quiet=True)
    assert standins.tree(out) == standins.tree(tmp_path / "out")


def needing_the_second_wing(scene, out, to):
    """Commands that need rooms of it, by what each names."""
    run = ("run", scene, "-o", to, "--device", "cpu")
    return {
        "render.tolerance = 0.02": (*run, "--set", "render.spp=null"),
        "render.integrator = 'auto'": (*run, "--integrator", "auto"),
        "render.planner": ("plan", scene),
        "dataset.validate": ("validate", out),
        "dataset.report": ("report", out),
        "dataset.view": ("view", out),
        "dataset.export": ("export", out, "--to", "tum", "-o", to),
        "dataset.sweep": ("sweep", scene, "-o", to, "--over", "seed=1,2"),
        "dataset.preview": ("preview", scene),
    }


def test_what_needs_a_room_that_is_left_out_says_so(made):
    """A verb of that room; and a scene that leaves a choice to the planner. What `info` tells needs none of them."""
    scene, _, told = made
    status, text, _ = told["info"]
    assert (status, "dataset: 1 frame" in text) == (0, True)
    for what, (status, text, error) in told.items():
        if what == "info":
            continue
        start = f"{what}: needs the planner (varos_warp.render.planner), which this installation leaves out. Set "
        words = f"varos-warp: this installation leaves out varos_warp.{what}, which this needs\n"
        assert (status, text) == (2, "")
        assert error == words or start in error
    assert {path.name for path in scene.parent.iterdir()} == {"scene.yaml", "out"}
