"""The package as users get it: a wheel, installed beside nothing of the checkout, used from an empty folder."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TINY = [
    "--device",
    "cpu",
    "--frames",
    "0:1",
    "--spp",
    "1",
    "-q",
    "--set",
    "vehicle.cameras.0.resolution=[16, 9]",
    "--set",
    "terrain.resolution=33",
    "--set",
    "render.max_triangles=20000",
    "--set",
    "growth=[]",
    "--set",
    "scatter=[]",
    "--set",
    "objects=[]",
    "--set",
    "particles=[]",
    "--set",
    "render.spp_b=1",
    "--integrator",
    "path",
    "--denoise",
    "none",
]


def call(*arguments, cwd: Path, path: Path | None = None) -> str:
    """What a Python command prints; without the checkout on the path."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment |= {"PYTHONPATH": str(path)} if path else {}
    result = subprocess.run(
        [sys.executable, *map(str, arguments)], cwd=cwd, env=environment, text=True, capture_output=True
    )
    assert result.returncode == 0, result.stderr[-3000:]
    return result.stdout


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder with the installed wheel and nothing else: built of what git would hand out, offline."""
    pytest.importorskip("setuptools", minversion="77")
    source, built, target = (tmp_path_factory.mktemp(name) for name in ("source", "built", "target"))
    shutil.copytree(ROOT / "varos_warp", source / "varos_warp", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    pip = ("-m", "pip", "--disable-pip-version-check", "--quiet")
    call(*pip, "wheel", source, "--no-deps", "--no-build-isolation", "--wheel-dir", built, cwd=source)
    (wheel,) = built.glob("varos_warp-*.whl")
    call(*pip, "install", wheel, "--no-deps", "--no-compile", "--target", target, cwd=built)
    return target


def test_the_wheel_brings_every_file_of_the_package_along(installed):
    """Data files, py.typed, and the licence."""
    here = {
        path.relative_to(ROOT)
        for path in (ROOT / "varos_warp").rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert {path for path in here if not (installed / path).is_file()} == set()
    assert list(installed.glob("varos_warp-*.dist-info/licenses/LICENSE"))


BOTH = """
import sys
import varos_warp
from varos_warp.cli import app

print(varos_warp.__file__)
assert not app(["demo", "-o", "demo", *sys.argv[1:]], standalone_mode=False)
assert not app(["validate", "demo", "-q"], standalone_mode=False)
"""
"""Two verbs in one process, each of which would take two seconds to start."""


def test_the_installed_package_makes_its_demo_from_an_empty_folder(installed, tmp_path):
    assert "validate" in call("-m", "varos_warp", "--help", cwd=tmp_path, path=installed)
    where, *_, valid = call("-c", BOTH, *TINY, cwd=tmp_path, path=installed).splitlines()
    assert valid.startswith("demo: ")
    assert valid.endswith("no problems")
    assert Path(where).is_relative_to(installed)
    assert (tmp_path / "demo" / "report.html").stat().st_size > 10_000
    assert {path.name for path in tmp_path.iterdir()} == {"demo"}
