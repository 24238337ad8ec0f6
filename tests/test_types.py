"""Users' type checkers know the public API: what uses it well passes, what uses it wrongly fails."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import varos_warp

ROOT = Path(__file__).parents[1]
USE = ROOT / "tests" / "typed_use.py"
WRONG = {
    "spp: float | None = scene.render.spp": "spp: str = scene.render.spp",
    "vw.simulate(scene)": "vw.simulate(path)",
    "simulator.state]": "simulator.states]",
    "simulator.step(force=(0.0, 5.0, 0.0))": "simulator.step(thrust=(0.0, 5.0, 0.0))",
    "simulation.trajectory.T_w_v(0)": "simulation.course.T_w_v(0)",
    'device="cpu")': 'divice="cpu")',
    "altimeter.range": "altimeter.distance",
    "number: int = first.number": "number: str = first.number",
    "first.A, *": "several.A, *",
    "data.cameras\n": "data.camera\n",
    "error.message": "error.massage",
}
"""What is written in typed_use.py, and a mistake in its place."""


PRODUCT = ROOT / "varos_warp" / "products" / "images" / "transmittance.py"
WRONG_PRODUCT = {
    "def of_hits(self, hits: FirstHits)": "def of_hits(self, hits: FirstHits, more: int)",
    '("distance",), 3, np.float32': '("distance",), "3", np.float32',
    "TRANSMITTANCE_IMAGE = Transmittance()": 'TRANSMITTANCE_IMAGE = Transmittance("T")',
}
"""What is written in an image type, and a mistake in its place."""


def changed(path: Path, mistakes: dict[str, str]) -> str:
    """A file with mistakes in the place of what is right."""
    text = path.read_text()
    for right, wrong in mistakes.items():
        assert text.count(right) == 1, right
        text = text.replace(right, wrong)
    return text


@pytest.fixture(scope="module")
def checked(tmp_path_factory):
    """A folder with files that are wrong, and what mypy says of them and of all that defines and uses the public API.

    All are checked at once: mypy takes its seconds for what the files import.
    """
    if not os.environ.get("CI"):
        pytest.importorskip("mypy")
    place = tmp_path_factory.mktemp("typed")
    (place / "wrong_use.py").write_text(changed(USE, WRONG))
    (place / "wrong_product.py").write_text(changed(PRODUCT, WRONG_PRODUCT))
    (place / "without.py").write_text(changed(PRODUCT, {"    letter, content = ": "    letter, contents = "}))
    files = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["files"]
    result = subprocess.run(
        [sys.executable, "-m", "mypy", *files, *place.iterdir()], cwd=ROOT, text=True, capture_output=True
    )
    assert result.returncode == 1, result.stdout + result.stderr
    assert result.stderr == ""
    return place, result.stdout


def not_found(said: str, path: Path, mistakes: dict[str, str]) -> list[str]:
    """Mistakes in a file whose line mypy does not call an error."""
    text = path.read_text()
    lines = {wrong: text[: text.index(wrong)].count("\n") + 1 for wrong in mistakes.values()}
    return [wrong for wrong, line in lines.items() if f"{path.name}:{line}: error" not in said]


def test_what_defines_and_what_uses_the_public_api_passes(checked):
    place, said = checked
    wrong = {path.name for path in place.iterdir()}
    told = [line for line in said.splitlines() if ": error" in line]
    assert [line for line in told if Path(line.partition(":")[0]).name not in wrong] == []
    assert said.splitlines()[-1].startswith(f"Found {len(told)} errors in {len(wrong)} files (checked ")


def test_every_wrong_use_fails(checked):
    """Each mistake is an error, at its line."""
    place, said = checked
    assert not_found(said, place / "wrong_use.py", WRONG) == []


def test_an_image_type_that_breaks_its_protocol_fails(checked):
    """With another signature or type, and without a member that has no default."""
    place, said = checked
    assert not_found(said, place / "wrong_product.py", WRONG_PRODUCT) == []
    told = [line for line in said.splitlines() if "without.py:" in line]
    assert any('abstract attribute "content"' in line for line in told)


def test_every_public_name_is_used_there():
    text = USE.read_text()
    assert [name for name in varos_warp.__all__ if f"vw.{name}" not in text] == []
